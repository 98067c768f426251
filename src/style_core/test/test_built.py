"""A changed kernel that was not built again is noticed at import."""
import json

import pytest

from style_core import built


def record(package):
    """As setup.py does, which keeps one more thing: what it builds with."""
    built.record_path(package).write_text(json.dumps({**built.digests(package), 'setup.py': 'any'}))


def test_changed_kernels_are_named_with_the_command(tmp_path):
    folder = tmp_path / 'part'
    folder.mkdir()
    (folder / 'one.pyx').write_text('x = 1')
    (folder / 'loops.h').write_text('/* one */')
    (tmp_path / 'two.pyx').write_text('y = 1')
    built.check(tmp_path)  # nothing recorded: an installed wheel
    record(tmp_path)
    built.check(tmp_path)
    (folder / 'loops.h').write_text('/* two */')
    with pytest.raises(ImportError, match=r'part/one\.pyx changed .* pip install --no-deps -e') as caught:
        built.check(tmp_path)
    assert 'two.pyx' not in str(caught.value)
    record(tmp_path)
    (tmp_path / 'common.pxd').write_text('cdef inline int f()')
    with pytest.raises(ImportError, match=r'part/one\.pyx, two\.pyx changed'):  # what all kernels may share
        built.check(tmp_path)
    record(tmp_path)
    (folder / 'three.pyx').write_text('z = 1')
    with pytest.raises(ImportError, match=r'part/three\.pyx'):
        built.check(tmp_path)
