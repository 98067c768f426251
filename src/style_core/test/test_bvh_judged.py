"""BVH by readers that are none of ours: where the bodies stand, for every order and layout of channels."""
import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.formats import read_motion, skeleton_of, write_motion
from style_core.recordings import read_recording

pytestmark = pytest.mark.filterwarnings('ignore:.*faster than')

ORDERS = [''.join(order) for order in itertools.permutations('XYZ')]
WILD = Path(__file__).resolve().parents[4] / 'shared' / 'wild' / 'bvh'


def positions_by_bvhio(path, frames, length_m=0.01):
    """Joint -> world positions, shape (frames, 3), m: its parser gives positions and rotations of each joint, the
    chain of them is multiplied here in double precision."""
    bvhio = pytest.importorskip('bvhio')
    places = {}

    def follow(joint, parent):
        rotations, spots = [], []
        for frame in range(frames):
            key = joint.Keyframes[frame]
            turn, place = parent[frame]
            quaternion = np.array([key.Rotation.w, key.Rotation.x, key.Rotation.y, key.Rotation.z], dtype=float)
            spots.append(place + turn @ np.array([key.Position.x, key.Position.y, key.Position.z], dtype=float))
            rotations.append(turn @ matrix_of(quaternion / np.linalg.norm(quaternion)))
        places[joint.Name] = np.array(spots) * length_m
        for child in joint.Children:
            follow(child, list(zip(rotations, spots)))

    follow(bvhio.readAsBvh(str(path)).Root, [(np.eye(3), np.zeros(3))] * frames)
    return places


def matrix_of(quaternion):
    w, x, y, z = quaternion
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


@st.composite
def files(draw):
    """Text of a BVH file: a chain whose joints have any order, any layout of channels, any offsets."""
    number = st.floats(-30, 30).map(lambda value: round(value, 3))
    count, frames = draw(st.integers(1, 4)), draw(st.integers(2, 4))
    lines, columns = ['HIERARCHY'], 0
    for joint in range(count):
        pad = '  ' * joint
        turns = [f'{letter}rotation' for letter in draw(st.sampled_from(ORDERS))]
        shifts = [f'{letter}position' for letter in draw(st.sampled_from(['', 'XYZ', 'ZYX', 'Y', 'XZ']))]
        if joint == 0:
            shifts = [f'{letter}position' for letter in draw(st.sampled_from(ORDERS))]
        layout = draw(st.sampled_from(['before', 'after', 'mixed']))
        channels = {'before': shifts + turns, 'after': turns + shifts}.get(layout)
        if channels is None:
            channels = [word for pair in itertools.zip_longest(turns, shifts) for word in pair if word]
        offset = [draw(number) for _ in range(3)]
        lines += [f'{pad}{"JOINT" if joint else "ROOT"} j{joint}', pad + '{',
                  f'{pad}  OFFSET ' + ' '.join(map(str, offset)),
                  f'{pad}  CHANNELS {len(channels)} ' + ' '.join(channels)]
        columns += len(channels)
    pad = '  ' * count
    lines += [f'{pad}End Site', pad + '{', f'{pad}  OFFSET 0 -4 1', pad + '}']
    lines += ['  ' * joint + '}' for joint in reversed(range(count))]
    lines += ['MOTION', f'Frames: {frames}', 'Frame Time: 0.01']
    angle = st.floats(-179, 179).map(lambda value: round(value, 3))
    lines += [' '.join(str(draw(angle)) for _ in range(columns)) for _ in range(frames)]
    return '\n'.join(lines) + '\n'


@settings(max_examples=60, deadline=None)
@given(text=files())
def test_generated_files_stand_where_bvhio_has_them(tmp_path_factory, text):
    path = tmp_path_factory.mktemp('bvh') / 'made.bvh'
    path.write_text(text)
    motion, skeleton = read_recording(path), skeleton_of(path)
    ours = dict(zip(skeleton.body_names, np.swapaxes(skeleton.forward(motion), 0, 1)))
    for name, theirs in positions_by_bvhio(path, motion.n_frames).items():
        np.testing.assert_allclose(ours[name], theirs, atol=1e-6, err_msg=text)
    write_motion(motion, path.with_name('again.bvh'), skeleton)
    again, tree = read_motion(path.with_name('again.bvh')), skeleton_of(path.with_name('again.bvh'))
    np.testing.assert_allclose(tree.forward(again), skeleton.forward(motion), atol=1e-7)


@pytest.mark.parametrize('order', ORDERS)
def test_every_order_agrees_with_pybvh(tmp_path, order):
    pybvh = pytest.importorskip('pybvh')
    rng = np.random.default_rng(1)
    channels = ' '.join(f'{letter}rotation' for letter in order)
    rows = '\n'.join(' '.join(f'{value:.4f}' for value in rng.uniform(-170, 170, 9)) for _ in range(5))
    path = tmp_path / 'made.bvh'
    path.write_text(f'HIERARCHY\nROOT hips\n{{\n  OFFSET 0 0 0\n  CHANNELS 6 Xposition Yposition Zposition {channels}\n'
                    f'  JOINT leg\n  {{\n    OFFSET 1 -40 2\n    CHANNELS 3 {channels}\n    End Site\n    {{\n'
                    f'      OFFSET 0 -42 5\n    }}\n  }}\n}}\nMOTION\nFrames: 5\nFrame Time: 0.01\n{rows}\n')
    theirs = pybvh.read_bvh_file(str(path)).node_positions()
    ours = skeleton_of(path).forward(read_recording(path))
    np.testing.assert_allclose(ours, 0.01 * theirs, atol=1e-6)


@pytest.mark.parametrize('name', ['bandai2_walk_normal', 'ad_rokoko_dance', 'pymo_motionbuilder_8walk',
                                  'bvhpython_mocapbank', 'ad_cmu_jumpingjacks'])
def test_files_of_others_stand_where_bvhio_has_them(name):
    path = WILD / f'{name}.bvh'
    if not path.is_file():
        pytest.skip('no recordings of others here')
    motion, skeleton = read_recording(path), skeleton_of(path)
    few = motion.replace(positions=motion.positions[:20], times=motion.times[:20])
    ours = dict(zip(skeleton.body_names, np.swapaxes(skeleton.forward(few), 0, 1)))
    theirs = positions_by_bvhio(path, 20)
    assert set(theirs) <= set(ours)
    worst = max(np.abs(ours[joint] - places).max() for joint, places in theirs.items())
    assert worst < 1e-6, worst
