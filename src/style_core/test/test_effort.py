"""The effort model against brute force, known limits and made motions."""
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from style_core.effort import ALPHA_RANGE, LiveRestyler, interpolate_motions, restyle, segment, train_library, warp
from style_core.effort import load as load_library
from style_core.effort import save as save_library
from style_core.effort.content import content_distances, content_groups, content_space, content_threshold
from style_core.effort.descriptors import _derivatives, effort_scale, raw_descriptors
from style_core.effort.interpolation import sample_frames
from style_core.effort.joins import join
from style_core.effort.library import Blend, EffortLibrary
from style_core.effort.pose import Poses, pose_space
from style_core.effort.regression import _ESTIMATORS, METHODS, fit_regression
from style_core.effort.restyle import choose_blend
from style_core.effort.segmentation import Segmenter
from style_core.effort.warping import SLOPE_LIMIT, smooth_warp, squared_distances
from style_core.errors import ModelError, MotionError, UsageError
from style_core.motion import Motion

NAMES = ('hip.rx', 'hip.ry', 'hip.rz', 'knee.rx', 'ankle.rx')


def every_path(n, m):
    """All warping paths of (4)-(5)."""
    def extend(path):
        p, q = path[-1]
        if (p, q) == (n - 1, m - 1):
            yield path
            return
        for step in ((1, 0), (1, 1), (0, 1)):
            nxt = (p + step[0], q + step[1])
            if nxt[0] < n and nxt[1] < m:
                yield from extend([*path, nxt])
    yield from extend([(0, 0)])


@given(st.integers(1, 5), st.integers(1, 5), st.integers(0, 10_000))
def test_warp_is_the_best_of_all_paths(n, m, seed):
    generator = np.random.default_rng(seed)
    first, second = generator.normal(size=(n, 3)), generator.normal(size=(m, 3))
    distances = np.sum((first[:, None] - second)**2, axis=-1)
    best = min(sum(distances[p, q] for p, q in path) for path in every_path(n, m))
    found = warp(first, second)
    assert found.cost == pytest.approx(best, rel=1e-9, abs=1e-12)
    assert distances[found.rows, found.columns].sum() == pytest.approx(best, rel=1e-9, abs=1e-12)


@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 10_000))
def test_warp_path_is_monotone_with_the_right_ends(n, m, seed):
    generator = np.random.default_rng(seed)
    path = warp(generator.normal(size=(n, 2)).cumsum(0), generator.normal(size=(m, 2)).cumsum(0))
    assert (path.rows[0], path.columns[0], path.rows[-1], path.columns[-1]) == (0, 0, n - 1, m - 1)
    steps = set(zip(np.diff(path.rows), np.diff(path.columns)))
    assert steps <= {(1, 0), (1, 1), (0, 1)}


def test_warp_of_a_motion_with_itself_costs_nothing():
    motion = np.random.default_rng(0).normal(size=(30, 4)) + 100.0
    path = warp(motion, motion)
    assert path.cost == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_array_equal(path.rows, path.columns)


def test_squared_distances_far_from_zero():
    generator = np.random.default_rng(1)
    first, second = 1e3 + generator.normal(size=(20, 5)), 1e3 + generator.normal(size=(25, 5))
    np.testing.assert_allclose(squared_distances(first, second), np.sum((first[:, None] - second)**2, -1), rtol=1e-9)


@pytest.mark.parametrize('bad', [np.empty((0, 2)), np.full((3, 2), np.nan), np.zeros(4)])
def test_warp_refuses_bad_motion(bad):
    with pytest.raises(MotionError):
        warp(bad, np.zeros((3, 2)))
    with pytest.raises(MotionError):
        warp(np.zeros((3, 2)), bad)


@given(st.integers(2, 60), st.integers(2, 60), st.integers(0, 10_000))
def test_smooth_warp_keeps_time_running_for_every_alpha(n, m, seed):
    generator = np.random.default_rng(seed)
    path = warp(generator.normal(size=(n, 2)).cumsum(0), generator.normal(size=(m, 2)).cumsum(0))
    if abs(n - m) > SLOPE_LIMIT * (n + m - 2):
        with pytest.raises(MotionError):
            smooth_warp(path)
        return
    s, delta = smooth_warp(path)
    assert np.abs(np.diff(delta) / np.diff(s)).max() <= SLOPE_LIMIT + 1e-9
    for alpha in (*ALPHA_RANGE, 0.0, 0.5, 1.0):
        clock = s + (2 * alpha - 1) * delta
        assert (np.diff(clock) > 0).all()
        assert clock[0] == 0.0
        assert clock[-1] == pytest.approx((1 - alpha) * (n - 1) + alpha * (m - 1))


def made_motion(name, seconds=1.0, size=1.0, sharp=1.0, seed=0, rate=60.0, travel=0.0):
    """A reaching-like movement: joints swing out and back; ``sharp`` warps its timing."""
    count = round(seconds * rate)
    u = np.linspace(0, 1, count)
    u = u + 0.1 * (sharp - 1) * np.sin(2 * np.pi * u)
    generator = np.random.default_rng(seed)
    a, b = generator.normal(size=(2, len(NAMES)))
    positions = size * (0.5 * a * np.sin(np.pi * u)[:, None] + 0.2 * b * np.sin(2 * np.pi * u)[:, None]) + 0.1 * a
    if not travel:
        return Motion(NAMES, positions, np.arange(count) / rate, name=name)
    root = np.column_stack([0.02 * np.sin(6 * u), 1 + 0.01 * np.cos(6 * u), travel * u, 0.1 * np.sin(3 * u), 0.8 * u,
                            0.05 * np.cos(5 * u)])
    names = tuple(f'root.{k}{a}' for k in 'tr' for a in 'xyz')
    return Motion(names + NAMES, np.hstack([root, positions]), np.arange(count) / rate,
                  units=('m',) * 3 + ('rad',) * (3 + len(NAMES)), name=name)


@given(st.integers(0, 10_000))
def test_pose_space_returns_the_same_rotations(seed):
    generator = np.random.default_rng(seed)
    motion = made_motion('m', travel=1.0)
    noise = generator.normal(size=(1, motion.n_joints)) * np.where(np.array(motion.units) == 'm', 0.1, 0.7)
    motion = motion.replace(positions=motion.positions + noise)
    space = pose_space([motion])
    back = space.decode(space.encode(motion), 60.0)
    again = space.decode(space.encode(back), 60.0)
    np.testing.assert_allclose(again.positions, back.positions, atol=1e-8)
    from scipy.spatial.transform import Rotation
    for joint in ('root', 'hip'):
        names = [f'{joint}.r{axis}' for axis in 'xyz']
        one = Rotation.from_euler('xyz', motion.joints(names).positions).as_matrix()
        two = Rotation.from_euler('xyz', back.joints(names).positions).as_matrix()
        np.testing.assert_allclose(one, two, atol=1e-8)
    ground = ['root.tx', 'root.ty', 'root.tz', 'knee.rx']
    np.testing.assert_allclose(back.joints(ground).positions, motion.joints(ground).positions, atol=1e-8)


def test_ends_of_the_interpolation_are_the_inputs():
    first = made_motion('a', 1.0, seed=3, travel=1.0)
    second = made_motion('b', 1.5, seed=3, size=1.3, sharp=2.0, travel=0.6)
    at_first, at_second = interpolate_motions(first, second, 0.0), interpolate_motions(first, second, 1.0)
    np.testing.assert_allclose(at_first.joints(first.joint_names).positions, first.positions, atol=1e-9)
    relative = second.joints(NAMES)
    np.testing.assert_allclose(at_second.joints(NAMES).positions, relative.positions, atol=1e-9)
    assert (at_first.n_frames, at_second.n_frames) == (60, 90)
    # the blend starts where the first motion does; its course is the second's
    travelled = at_second.joints(['root.tz']).positions[-1] - at_second.joints(['root.tz']).positions[0]
    assert travelled == pytest.approx(second.positions[-1, 2] - second.positions[0, 2], abs=0.05)


@pytest.mark.parametrize('alpha', [-0.25, 0.3, 0.5, 1.25])
def test_interpolation_of_a_motion_and_its_slower_self_is_that_motion_slower(alpha):
    first = made_motion('a', 1.0, seed=1)
    second = first.replace(times=2 * first.times).resample(60.0)
    blend = interpolate_motions(first, second, alpha)
    assert blend.n_frames == pytest.approx((1 - alpha) * first.n_frames + alpha * second.n_frames, abs=1)
    u = np.linspace(0, first.n_frames - 1, blend.n_frames)
    expected = sample_frames(first.positions, u)
    span = np.ptp(first.positions, axis=0).max()
    assert np.abs(blend.positions - expected).max() < 0.05 * span


def test_interpolation_refuses():
    first, second = made_motion('a'), made_motion('b', seed=2)
    with pytest.raises(UsageError, match='alpha'):
        interpolate_motions(first, second, 1.5)
    with pytest.raises(MotionError, match='joints'):
        interpolate_motions(first, second.select('!knee*'), 0.5)
    broken = first.positions.copy()
    broken[3, 1] = np.nan
    with pytest.raises(MotionError, match='missing'):
        interpolate_motions(first.replace(positions=broken), second, 0.5)
    with pytest.raises(MotionError, match='length'):
        interpolate_motions(made_motion('a', 0.2), made_motion('b', 3.0), 0.5)


def brute_segmentation(frames, sequences):
    """Least cost over every split of the input and every choice of fragments."""
    count = len(frames)
    best = np.full(count + 1, np.inf)
    best[0] = 0.0
    for stop in range(1, count + 1):
        for start in range(stop):
            for sequence in sequences:
                best[stop] = min(best[stop], best[start] + warp(frames[start:stop], sequence).cost)
    return best[-1]


@given(st.integers(0, 10_000), st.integers(1, 7), st.integers(1, 3))
def test_segmentation_is_the_best_of_all_splits(seed, count, fragments):
    generator = np.random.default_rng(seed)
    frames = generator.normal(size=(count, 2))
    sequences = [generator.normal(size=(generator.integers(1, 4), 2)) for _ in range(fragments)]
    found, cost = segment(frames, sequences)
    assert cost == pytest.approx(brute_segmentation(frames, sequences), rel=1e-9)
    assert [s.start for s in found] == [0] + [s.stop for s in found][:-1]
    assert found[-1].stop == count
    parts = sum(warp(frames[s.start:s.stop], sequences[s.fragment]).cost for s in found)
    assert parts == pytest.approx(cost, rel=1e-9)


@given(st.integers(0, 10_000), st.lists(st.integers(1, 40), min_size=1, max_size=6))
def test_streaming_segmentation_agrees_with_the_whole(seed, cuts):
    generator = np.random.default_rng(seed)
    sequences = [generator.normal(size=(k, 3)).cumsum(0) for k in (12, 9, 15)]
    order = generator.integers(3, size=8)
    frames = np.concatenate([sequences[i] for i in order]) + 0.01 * generator.normal(size=(1, 3))
    segmenter, settled, pushed = Segmenter(sequences), [], 0
    for cut in cuts:
        segmenter.push(frames[pushed:pushed + cut])
        pushed += len(frames[pushed:pushed + cut])
        settled += segmenter.settled()
    if pushed < len(frames):
        segmenter.push(frames[pushed:])
    whole, cost = segment(frames, sequences)
    final, streamed_cost = segmenter.finish()
    assert final == whole
    assert streamed_cost == pytest.approx(cost)
    assert settled == whole[:len(settled)]
    assert [s.fragment for s in whole] == list(order)


def test_segments_settle_while_the_stream_runs():
    generator = np.random.default_rng(2)
    sequences = [generator.normal(size=(20, 3)).cumsum(0) for _ in range(3)]
    segmenter, settled = Segmenter(sequences), 0
    for sequence in [sequences[k] for k in (0, 1, 2, 1, 0, 2)]:
        for frame in sequence:
            segmenter.push(frame)
            settled += len(segmenter.settled())
    assert settled >= 4


def test_segmenter_refuses():
    with pytest.raises(MotionError):
        Segmenter([])
    segmenter = Segmenter([np.zeros((3, 2))])
    with pytest.raises(MotionError, match='channels'):
        segmenter.push(np.zeros((2, 3)))
    with pytest.raises(MotionError, match='missing'):
        segmenter.push(np.full((2, 2), np.nan))
    with pytest.raises(MotionError, match='no input'):
        segmenter.finish()


@given(st.integers(0, 10_000), st.lists(st.integers(26, 60), min_size=2, max_size=5))
def test_joins_are_continuous_in_position_and_velocity(seed, lengths):
    generator = np.random.default_rng(seed)
    parts = []
    for length in lengths:
        u = np.linspace(0, 1, length)[:, None]
        course = generator.normal(size=3) + 0.3 * np.sin(3 * u + generator.normal(size=3))
        parts.append(Poses(course, None, np.zeros(3)))
    joined = join(parts, 60.0).joints
    plain = np.concatenate([part.joints for part in parts])
    assert len(joined) == len(plain)
    for seam in np.cumsum(lengths)[:-1]:
        gap = np.abs(plain[seam] - plain[seam - 1]).max()
        # a jump is spread over 0.2 s on both sides: no frame changes the velocity by more than a quintic over it must
        change = np.abs(np.diff(joined[seam - 13:seam + 13], 2, axis=0)).max()
        assert change < 0.05 * gap + 0.02
    # what lies further from a seam than the fade is untouched
    middle = slice(13, lengths[0] - 13)
    np.testing.assert_array_equal(joined[middle], plain[middle])


@pytest.mark.parametrize('lengths', [(1, 1), (2, 3), (1, 30), (5, 2, 9)])
def test_joins_of_short_pieces_stay_finite_and_near(lengths):
    generator = np.random.default_rng(0)
    parts = [Poses(generator.normal(size=(length, 2)), None, np.zeros(3)) for length in lengths]
    joined = join(parts, 60.0).joints
    plain = np.concatenate([part.joints for part in parts])
    assert joined.shape == plain.shape
    assert np.abs(joined - plain).max() < 2 * np.ptp(plain)


def test_join_of_a_motion_cut_in_two_changes_little():
    u = np.linspace(0, 3, 90)[:, None]
    whole = np.sin(u + np.arange(3))
    cut = join([Poses(whole[:40], None, np.zeros(3)), Poses(whole[40:], None, np.zeros(3))], 60.0)
    step = np.abs(np.diff(whole, axis=0)).max()
    np.testing.assert_allclose(cut.joints, whole, atol=0.05 * step)


@pytest.mark.parametrize('frames, window', [(7, 7), (8, 7), (60, 9), (61, 19)])
def test_derivatives_are_those_of_the_savitzky_golay_filter(frames, window):
    values = np.random.default_rng(0).normal(size=(frames, 3))
    for order, derivative in enumerate(_derivatives(values, window, 60.0), 1):
        np.testing.assert_allclose(
            derivative, savgol_filter(values, window, 5, deriv=order, delta=1 / 60, axis=0),
            atol=1e-9 * 60.0**order)


def test_descriptors_order_motions_as_they_should():
    rate = 120.0
    t = np.arange(0, 2, 1 / rate)[:, None]
    calm, quick = np.sin(2 * np.pi * t), np.sin(4 * np.pi * t)
    jerk, energy, acceleration = raw_descriptors(quick, rate) - raw_descriptors(calm, rate)
    # a sine at twice the frequency: 2^6 in squared jerk, 2^2 in squared speed, 2^2 in acceleration
    assert jerk == pytest.approx(np.log(16), abs=0.1)
    assert energy == pytest.approx(np.log(4), abs=0.02)
    assert acceleration == pytest.approx(np.log(4), abs=0.02)
    np.testing.assert_allclose(raw_descriptors(2 * calm, rate) - raw_descriptors(calm, rate),
                               np.log([1, 4, 2]), atol=1e-9)
    with pytest.raises(MotionError, match='frames'):
        raw_descriptors(calm[:4], rate)
    with pytest.raises(MotionError, match='moves'):
        raw_descriptors(np.zeros((60, 2)), rate)


def test_effort_labels_are_relative_to_content():
    raw = np.array([[0, 0, 0], [1, 1, 1], [2, 2, 2], [10, 10, 10], [11, 11, 11], [12, 12, 12.0]])
    groups = np.array([0, 0, 0, 1, 1, 1])
    measure = effort_scale(raw, groups)
    labels = measure.labels(raw, groups)
    np.testing.assert_allclose(labels[:3], labels[3:])
    assert labels[2, 1] > 0 > labels[2, 0]  # more jerk is less flow
    assert np.abs(measure.labels(raw + 100, groups)).max() == 3.0


@pytest.fixture(scope='module')
def made_library():
    """Three contents, eight manners each."""
    generator = np.random.default_rng(5)
    motions, truth = [], []
    for content in range(3):
        for manner in range(8):
            motions.append(made_motion(f'c{content}m{manner}', generator.uniform(0.7, 1.4), generator.uniform(0.7, 1.3),
                                       generator.uniform(0.2, 1.8), seed=content, travel=0.5))
            truth.append(content)
    return train_library(motions, blends=60, seed=1), motions, np.array(truth)


def test_contents_are_found_without_labels(made_library):
    library, _, truth = made_library
    np.testing.assert_array_equal(library.groups, truth)


def test_regression_beats_the_mean(made_library):
    library, _, _ = made_library
    blends = library.blends
    predicted = library.predicted_efforts([b.first for b in blends], [b.second for b in blends],
                                          [b.alpha for b in blends])
    error = np.mean((predicted - library.blend_efforts)**2, axis=0)
    assert (error < 0.5 * library.blend_efforts.var(axis=0)).all()


def test_library_survives_its_file(made_library, tmp_path):
    library, _, _ = made_library
    save_library(library, tmp_path / 'library.npz')
    again = load_library(tmp_path / 'library.npz')
    blend = Blend(0, 3, 0.4)
    np.testing.assert_array_equal(again.blend(blend).joints, library.blend(blend).joints)
    np.testing.assert_allclose(again.predicted_efforts([0], [3], [0.4]), library.predicted_efforts([0], [3], [0.4]),
                               atol=1e-12)
    (tmp_path / 'cut.npz').write_bytes((tmp_path / 'library.npz').read_bytes()[:5000])
    with pytest.raises(ModelError):
        load_library(tmp_path / 'cut.npz')


def test_choice_is_as_good_as_a_fine_grid(made_library):
    library, _, _ = made_library
    target = np.array([1.0, -1.0, np.nan])
    blend, predicted, poses = choose_blend(library, 2, target, verify=False)
    np.testing.assert_array_equal(poses.joints, library.blend(blend).joints)
    near = library.neighbours(2, 6)
    grid = np.linspace(*ALPHA_RANGE, 301)
    misses = [np.sum((library.predicted_efforts([i] * 301, [j] * 301, grid) - target)[:, :2]**2, axis=1).min()
              for i, j in itertools.permutations(near, 2)]
    assert np.sum((predicted - target)[:2]**2) <= min(misses) + 1e-4
    assert ALPHA_RANGE[0] <= blend.alpha <= ALPHA_RANGE[1]


def test_a_verified_choice_is_the_nearest_that_was_made_and_is_made_once(made_library, monkeypatch):
    library, motions, _ = made_library
    made, target = [], np.array([np.nan, 1.0, 0.5])
    blend_of = EffortLibrary.blend
    monkeypatch.setattr(EffortLibrary, 'blend', lambda self, blend: made.append(blend) or blend_of(self, blend))
    blend, effort, _ = choose_blend(library, 2, target)
    assert len(set(made)) == len(made) == 12
    efforts = [library.computed_effort(blend_of(library, one), library.groups[2]) for one in made]
    nearest = int(np.argmin([np.nansum((one - target)**2) for one in efforts]))
    assert blend == made[nearest]
    np.testing.assert_array_equal(effort, efforts[nearest])
    made.clear()
    result = restyle(library, motions[2], target)
    assert len(made) == 12 * len(result.choices)


def test_restyling_moves_effort_towards_what_was_asked(made_library):
    library, motions, truth = made_library
    order = [1, 9, 20, 4]
    from style_core.motion import concatenate
    source = concatenate([motions[k] for k in order])
    light, strong = (restyle(library, source, target) for target in ((np.nan, -2, np.nan), (np.nan, 2, np.nan)))
    for result in (light, strong):
        assert [truth[choice.segment.fragment] for choice in result.choices] == [truth[k] for k in order]
        assert np.isfinite(result.motion.positions).all()
    efforts = [np.mean([library.computed_effort(library.blend(c.blend), library.groups[c.segment.fragment])[1]
                        for c in result.choices]) for result in (light, strong)]
    assert efforts[0] < -0.5 < 0.5 < efforts[1]
    assert max(light.distances) < library.threshold
    # content that the library lacks is said to be so
    strange = restyle(library, made_motion('strange', seed=77, travel=0.5), (0, 0, 0))
    assert min(strange.distances) > library.threshold


def test_restyled_motion_leads_where_the_input_leads(made_library):
    library, motions, _ = made_library
    from style_core.motion import concatenate
    source = concatenate([motions[k] for k in (1, 9, 20, 4)])
    bend = source.positions.copy()
    bend[:, source.joint_names.index('root.ry')] = np.linspace(0.3, 4.0, source.n_frames)
    source = source.replace(positions=bend)
    result = restyle(library, source, (2.0, np.nan, np.nan))
    headings = [library.space.encode(motion) for motion in (source, result.motion)]
    turned = [poses.root[1:, 3].sum() for poses in headings]
    assert turned[1] == pytest.approx(turned[0], abs=0.1)
    assert headings[1].start[2] == pytest.approx(headings[0].start[2], abs=1e-6)


def test_live_restyling_is_the_recorded_one(made_library):
    library, motions, _ = made_library
    from style_core.motion import concatenate
    source = concatenate([motions[k] for k in (1, 9, 20, 4, 12)])
    target = (1.0, -1.0, 0.0)
    restyler, parts = LiveRestyler(library, target), []
    for first in range(0, source.n_frames, 7):
        stop = min(first + 7, source.n_frames)
        parts += restyler.push(source.replace(positions=source.positions[first:stop], times=source.times[first:stop]))
    early = len(parts)
    parts += restyler.finish()
    whole = restyle(library, source, target)
    assert early > 0
    assert [c.segment for c in restyler.choices] == [c.segment for c in whole.choices]
    live = np.concatenate([part.joints for part in parts])
    np.testing.assert_allclose(live, library.space.encode(whole.motion).joints, atol=1e-8)


def test_restyling_refuses(made_library):
    library, motions, _ = made_library
    with pytest.raises(UsageError):
        restyle(library, motions[0], (4, 0, 0))
    with pytest.raises(UsageError):
        restyle(library, motions[0], (np.nan,) * 3)
    with pytest.raises(MotionError, match='no joint'):
        restyle(library, motions[0].select('!knee*'), (0, 0, 0))


def test_training_refuses(made_library):
    _, motions, _ = made_library
    with pytest.raises(ModelError, match='two fragments'):
        train_library(motions[:1])
    with pytest.raises(ModelError, match='same name'):
        train_library([motions[0], motions[0]])
    with pytest.raises(ModelError, match='nothing to interpolate'):
        train_library([motions[0], motions[8]], groups=[0, 1])
    still = motions[1].replace(positions=np.zeros_like(motions[1].positions))
    with pytest.raises(MotionError, match='c0m1'):
        train_library([motions[0], still])
    with pytest.raises(ModelError, match='no label'):
        train_library(motions, labels={'c0m0': (0, 0, 0)})


def test_a_persons_labels_are_used(made_library):
    _, motions, _ = made_library
    motions = motions[:4]
    generator = np.random.default_rng(0)
    blends = [Blend(int(i), int(j), float(a)) for i, j, a in
              zip(generator.integers(2, size=15), 2 + generator.integers(2, size=15), generator.uniform(size=15))]
    names = [motion.name for motion in motions]
    labels = {name: (k - 1.0, 0.5 * k, -1.0) for k, name in enumerate(names)}
    labels.update({blend.title(names): (0.1 * k, 1.0, -1.0) for k, blend in enumerate(blends)})
    library = train_library(motions, groups=[0] * 4, labels=labels, blends=blends)
    assert library.labeller == 'person'
    np.testing.assert_allclose(library.efforts[2], labels[names[2]])


def test_content_tools():
    generator = np.random.default_rng(3)
    base = [generator.normal(size=(20, 3)).cumsum(0) for _ in range(2)]
    sequences = [base[k % 2] + 0.05 * generator.normal(size=(20, 3)) for k in range(8)]
    distances = content_distances(sequences)
    np.testing.assert_array_equal(distances, distances.T)
    groups = content_groups(distances, content_threshold(distances))
    np.testing.assert_array_equal(groups, np.arange(8) % 2)
    space = content_space(sequences, components=1)
    coefficients = np.array([space.coefficients(s)[0] for s in sequences])
    assert np.abs(coefficients[::2].mean() - coefficients[1::2].mean()) > 5 * coefficients[::2].std()


@pytest.mark.parametrize('method', METHODS)
def test_regressions_predict_a_linear_truth(method):
    generator = np.random.default_rng(0)
    z = generator.uniform(-1, 1, size=(80, 13))
    alpha = generator.uniform(size=(80, 1))
    z[:, -1:] = alpha
    truth = (1 - alpha) * z[:, -7:-4] + alpha * z[:, -4:-1]
    model, settings = fit_regression(method, z[:60], truth[:60])
    error = np.mean((model.predict(z[60:]) - truth[60:])**2)
    assert error < 0.6 * truth.var()
    inputs = (z - z[:60].mean(axis=0)) / z[:60].std(axis=0)
    for column, chosen in enumerate(settings):      # what the library that fits it would say
        fitted = _ESTIMATORS[method](**chosen).fit(inputs[:60], (truth[:60] - truth[:60].mean(axis=0))[:, [column]])
        np.testing.assert_allclose(model.predict(z)[:, column],
                                   fitted.predict(inputs).reshape(-1) + truth[:60, column].mean(), atol=1e-9)
    if method == 'linear-interpolation':
        assert error < 1e-20
    else:
        again, _ = fit_regression(method, z[:60], truth[:60], settings)
        np.testing.assert_allclose(again.predict(z), model.predict(z))
