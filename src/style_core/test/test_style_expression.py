"""Style expressions: what they mean, and clear errors for what they do not."""
import contextlib
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from style_core.errors import UsageError
from style_core.style_expression import evaluate_style

STYLES = {'walk': np.array([1.0, 0.0]), 'run': np.array([3.0, 1.0]), 'strut': np.array([0.0, 2.0]),
          '131_09': np.array([5.0, 5.0]), 'a b': np.array([7.0, 0.0])}


@pytest.mark.parametrize('text, expected', [
    ('walk', [1, 0]), ('generic', [0, 0]), ('1.5*run - 0.5*strut', [4.5, 0.5]), ('3/2 * run - strut / 2', [4.5, 0.5]),
    ('-walk', [-1, 0]), ('0.5*(walk + run)', [2, 0.5]), ('walk + 2*(run - walk)', [5, 2]), ('2*131_09', [10, 10]),
    ('"a b" * 2', [14, 0]), ('[0.3, -1.2]', [0.3, -1.2]), ('[0.5] + walk', [1.5, 0]), ('.5*run', [1.5, 0.5]),
    ('walk:run :: strut:X', [2, 3]), ('2*walk : run :: strut : x', [1, 3]), ('1e-1*walk', [0.1, 0]),
])
def test_meaning(text, expected):
    np.testing.assert_allclose(evaluate_style(text, STYLES, 2), expected, atol=1e-15)


@pytest.mark.parametrize('text, message', [
    ('', 'empty'), ('balet', "no style 'balet'; the styles are"), ('walk run', 'is a \\* missing'),
    ('walk +', 'ends too early'), ('2', 'a number, not a style'), ('2 + walk', 'adds a number'),
    ('walk*run', 'multiplies two styles'), ('walk/0', 'divides'), ('(walk', "lacks a '\\)'"),
    ('walk $ run', 'cannot read'),
    ('[1,2,3]', 'the model has 2'), ('[walk]', 'must be numbers'), ('walk:run', 'does not fit|cannot'),
    ('walk:run::strut', 'an analogy is written'), ('walk:run::strut:jump', 'an analogy is written'),
    ('walk::run', 'an analogy is written'), ('1e999*walk', 'too large'), ('2walk3*', 'no style|ends too early'),
])
def test_errors_say_what_is_wrong(text, message):
    with pytest.raises(UsageError, match=message):
        evaluate_style(text, STYLES, 2)


@given(st.text(alphabet='walkrun 0123456789.*/+-()[],:"', max_size=30))
def test_any_text_gives_a_style_or_a_clear_error(text):
    try:
        value = evaluate_style(text, STYLES, 2)
    except UsageError as error:
        assert 'style' in str(error)
    else:
        assert value.shape == (2,)


@pytest.mark.parametrize('text', [
    '(' * 400 + 'walk' + ')' * 400, '[' * 20_000, '[' * 2000, '-' * 5000 + 'walk', '1e6*' * 1000 + 'walk',
    '(' * 33 + 'walk' + ')' * 33, '[' * 33 + '1' + ']' * 33, 'walk' + ' ' * 1_000_000, '"' * 4096, ':' * 4096,
    '1' * 4000 + 'a', 'walk' + '*1e300' * 3, '1e308*1e308*walk - 1e308*1e308*walk', 'x' * 1_000_000, '\x1b[31m\n' * 400,
])
def test_a_text_without_measure_is_refused_in_few_words(text):
    with pytest.raises(UsageError) as caught:
        evaluate_style(text, STYLES, 2)
    assert len(str(caught.value)) < 1100 and str(caught.value).isprintable()


def test_what_is_within_the_budgets_is_evaluated():
    np.testing.assert_allclose(evaluate_style('(' * 32 + 'walk' + ')' * 32, STYLES, 2), [1, 0])
    np.testing.assert_allclose(evaluate_style('-' * 4091 + 'walk', STYLES, 2), [-1, 0])
    np.testing.assert_allclose(evaluate_style('walk' + ' ' * 4092, STYLES, 2), [1, 0])


def test_the_work_grows_with_the_length_and_not_its_square():
    """Counted in steps of the reader, so that a busy machine decides nothing."""
    def tokens_read(text):
        count = 0

        def look(frame, event, arg):
            nonlocal count
            count += 1
            return look
        sys.settrace(look)
        try:
            with contextlib.suppress(UsageError):
                evaluate_style(text, STYLES, 2)
        finally:
            sys.settrace(None)
        return count
    for piece in ('[', '-', '1e6*', '(', 'walk+', ':', '1,', '"a b" '):
        short, long = (tokens_read(piece * (size // len(piece))) for size in (1000, 4000))
        assert long < 5 * short, piece
