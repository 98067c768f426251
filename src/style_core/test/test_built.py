"""A changed kernel that was not built again is noticed at import."""
import pytest

from style_core import built


def test_changed_kernels_are_named_with_the_command(tmp_path):
    folder = tmp_path / 'part'
    folder.mkdir()
    (folder / 'one.pyx').write_text('x = 1')
    (folder / 'loops.h').write_text('/* one */')
    (tmp_path / 'two.pyx').write_text('y = 1')
    built.check(tmp_path)  # nothing recorded: an installed wheel
    built.record(tmp_path)
    built.check(tmp_path)
    (folder / 'loops.h').write_text('/* two */')
    with pytest.raises(ImportError, match=r'part/one\.pyx changed .* pip install --no-deps -e') as caught:
        built.check(tmp_path)
    assert 'two.pyx' not in str(caught.value)
    built.record(tmp_path)
    (folder / 'three.pyx').write_text('z = 1')
    with pytest.raises(ImportError, match=r'part/three\.pyx'):
        built.check(tmp_path)
