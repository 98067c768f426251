"""Recordings as commands read them."""
import numpy as np
import pytest

from style_core.cli.recordings import named_recording, read_recording
from style_core.formats import write_motion
from style_core.motion import Motion


def test_a_recording_keeps_its_name_unless_its_file_is_to_name_it(tmp_path):
    path = tmp_path / 'file.npz'
    write_motion(Motion(('a',), np.linspace(0, 1, 5)[:, None], np.arange(5) / 60, name='inside'), path)
    assert read_recording(path).name == 'inside'
    assert named_recording(path).name == 'file'


def test_a_rate_counts_only_where_the_format_says_none(tmp_path):
    amc, npz = tmp_path / 'one.amc', tmp_path / 'one.npz'
    amc.write_text(':FULLY-SPECIFIED\n:DEGREES\n' + ''.join(f'{k + 1}\nltibia {k}\n' for k in range(5)))
    write_motion(Motion(('a',), np.zeros((5, 1)), np.arange(5) / 60), npz)
    assert [read_recording(amc, rate).rate_hz for rate in (None, 30.0)] == pytest.approx([120.0, 30.0])
    assert read_recording(npz, 30.0).rate_hz == pytest.approx(60.0)
