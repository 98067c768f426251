"""The keys of the style slider, on a real pseudo-terminal."""
import os
import pty
import tty

import numpy as np
import pytest

from style_synth.style_slider import Mixer, read_key


@pytest.fixture
def mixer():
    return Mixer({'walk': np.array([0.0, 0.0]), 'run': np.array([2.0, 1.0]), 'sneak': np.array([1.0, -1.0])})


def test_keys_of_a_terminal():
    keyboard, terminal = pty.openpty()
    tty.setcbreak(terminal)
    try:
        assert read_key(terminal) == ''
        os.write(keyboard, b'\x1b[A\x1b[B2\x1b[C\x1b[Dq')
        assert [read_key(terminal) for _ in range(6)] == ['up', 'down', '2', 'right', 'left', 'q']
        os.write(keyboard, b'\x1b')
        assert read_key(terminal) not in ('q', 'up')
        os.close(keyboard)
        assert read_key(terminal) == 'q'        # the terminal has gone
    finally:
        os.close(terminal)


def test_a_digit_goes_over_to_a_style_and_zero_to_the_mean(mixer):
    assert mixer.press('2')
    np.testing.assert_allclose(mixer.v, [2.0, 1.0])
    assert mixer.press('0')
    np.testing.assert_allclose(mixer.v, [1.0, 0.0])
    assert not mixer.press('9')
    assert not mixer.press('x')
    assert not mixer.press('')


def test_arrows_choose_and_weigh(mixer):
    mixer.press('1')
    assert not mixer.press('down')
    assert mixer.chosen == 1
    for _ in range(5):
        assert mixer.press('right')
    np.testing.assert_allclose(mixer.weights, [1.0, 0.5, 0.0])
    for _ in range(40):
        mixer.press('left')
    assert mixer.weights[1] == -1.0
    assert mixer.lines()[1].startswith('>')
