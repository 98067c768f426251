"""Style machines on made motion: training, style space, synthesis, streaming, choreography, analysis, files."""
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.errors import ModelError, MotionError, UsageError
from style_core.hmm import check_hmm
from style_core.motion import Motion
from style_core.style_machine import (
    Settings,
    StreamingSynthesizer,
    analyze,
    graph_dot,
    learn,
    load,
    primitives,
    random_walk,
    save,
    scale_dwell,
    sequence,
    synthesize,
    synthesize_visits,
    take,
)
from style_core.style_machine.choreography import bridge, runs, visits_to_path
from style_core.style_machine.training import train

FAST = Settings(states=10, anneal=12, max_iterations=25)
JOINTS = ('hip', 'knee', 'ankle', 'arm', 'neck')


def cycle(name, frequency, amplitude, lean, seconds=4.0, seed=0, rate=60.0):
    """A made gait: the same cycle at another speed, size and posture."""
    rng = np.random.default_rng(seed)
    times = np.arange(int(seconds * rate)) / rate
    phase = 2 * np.pi * frequency * times
    shape = np.stack([np.sin(phase), np.sin(phase - 0.8) + 0.3 * np.sin(2 * phase), 0.5 * np.cos(phase),
                      -0.7 * np.sin(phase) + 0.1 * np.cos(2 * phase), 0.1 * np.sin(2 * phase)], axis=1)
    return Motion(JOINTS, amplitude * shape + lean + 0.01 * rng.standard_normal(shape.shape), times, name=name)


@pytest.fixture(scope='module')
def motions():
    return [cycle('walk', 0.9, 0.4, 0.0), cycle('run', 1.5, 0.7, 0.2, seed=1), cycle('strut', 0.7, 0.6, -0.2, seed=2)]


@pytest.fixture(scope='module')
def machine(motions):
    return learn(motions, FAST, leading=3, dof=3)


def test_objective_never_rises_at_fixed_temperatures(machine):
    assert len(machine.history) > 12
    assert all(row['rise'] <= 1e-9 * abs(row['objective']) for row in machine.history)
    assert {'anneal', 'settle', 'trim'} <= {row['stage'] for row in machine.history}


def test_extinction_only_ever_removes(machine):
    after = [row for row in machine.history if row['stage'] != 'anneal']
    assert all(a['states'] >= b['states'] and a['transitions'] >= b['transitions']
               for a, b in itertools.pairwise(after))
    assert after[-1]['transitions'] < 100  # of a dense 10 x 10 little is left in a cycle


def test_training_coordinates_invert_exactly(machine, motions):
    c = machine.coordinates
    np.testing.assert_allclose(c.decode(c.encode(motions[0].positions)), motions[0].positions, atol=1e-12)
    np.testing.assert_allclose(c.basis.T @ c.basis, np.eye(5), atol=1e-12)


def test_origin_is_the_generic_model_and_training_styles_are_reproduced(machine, motions):
    assert machine.at('generic') is machine.generic
    packed = machine.layout.pack(machine.generic)
    round_trip = machine.layout.unpack(packed, *machine.generic.positions.shape, machine.generic.leading)
    for name in ('pose', 'positions', 'velocities', 'covs', 'tails', 'dwell'):
        np.testing.assert_allclose(getattr(round_trip, name), getattr(machine.generic, name), rtol=1e-9, atol=1e-12)
    assert machine.spectrum.sum() == pytest.approx(1.0)
    np.testing.assert_allclose((np.array(list(machine.styles.values())) ** 2).mean(axis=0), 1.0)  # units of the axes


def test_coordinates_of_a_training_style_reproduce_its_model(motions):
    """With as many degrees of freedom as styles nothing is lost."""
    from style_core.style_machine import machine as module
    seen = {}
    original = module.style_space

    def spy(layout, generic, specifics, dof, explained):
        seen['specifics'] = specifics
        return original(layout, generic, specifics, dof, explained)

    module.style_space = spy
    try:
        machine = learn(motions, FAST, leading=3, dof=3)
    finally:
        module.style_space = original
    for specific, name in zip(seen['specifics'], machine.styles):
        again = machine.at(name)
        for field in ('pose', 'positions', 'velocities', 'covs', 'tails', 'dwell'):
            np.testing.assert_allclose(getattr(again, field), getattr(specific, field), rtol=1e-7, atol=1e-9)


@settings(max_examples=15)
@given(st.lists(st.floats(-8, 8), min_size=3, max_size=3))
def test_any_style_is_a_model(machine, v):
    emission = machine.at(np.array(v))
    assert (np.linalg.eigvalsh(emission.covs) > 0).all() and (np.linalg.eigvalsh(emission.tails) > 0).all()
    assert (emission.dwell >= 1).all() and np.isfinite(emission.positions).all()
    motion = synthesize_visits(machine, take(random_walk(machine, 0), machine, np.array(v), 0.5), np.array(v))
    assert np.isfinite(motion.positions).all()


@settings(max_examples=12)
@given(st.integers(0, 1000), st.integers(1, 12), st.integers(1, 3), st.sampled_from(['hint', 'frames', 'random']),
       st.sampled_from(['noise', 'constant', 'duplicates', 'holes', 'ramp']))
def test_training_on_anything_gives_a_valid_model(seed, states, number, init, kind):
    rng = np.random.default_rng(seed)
    sequences = []
    for length in rng.integers(1, 25, size=number):
        x = rng.standard_normal((length, 2))
        if kind == 'constant':
            x[:, 0] = 0.0
        elif kind == 'duplicates':
            x[:] = x[0]
        elif kind == 'holes':
            x[1:][rng.random(length - 1) < 0.5] = np.nan
        elif kind == 'ramp':
            x = np.linspace(0, 1, length)[:, None] * [1.0, 2.0]
        sequences.append(x)
    trained = train(sequences, Settings(states=states, anneal=6, max_iterations=10, init=init, seed=seed))
    family = trained.family
    from style_core.hmm import Hmm
    check_hmm(Hmm(family.start, family.trans, family.means, family.covs))
    for means, covs in zip(family.specific_means, family.specific_covs):
        check_hmm(Hmm(family.start, family.trans, means, covs))
    for gamma, path, x in zip(trained.gammas, trained.paths, sequences):
        assert len(path) == len(x) and (path < family.n_states).all()
        np.testing.assert_allclose(gamma.sum(axis=1), 1.0, atol=1e-8)
    assert all(row['rise'] <= 1e-7 * abs(row['objective']) + 1e-7 for row in trained.history)


def test_resynthesis_and_analysis_of_training_recordings(machine, motions):
    for motion in motions:
        found = analyze(machine, motion)
        assert found.nearest == motion.name
        assert not found.out_of_range
        again = synthesize(machine, found.gamma, motion.name)
        assert np.sqrt(((again.positions - motion.positions) ** 2).mean()) < 0.35 * motion.positions.std()


def test_analysis_of_new_recordings(machine):
    new = analyze(machine, cycle('another run', 1.45, 0.68, 0.19, seed=9))
    assert new.nearest == 'run' and not new.out_of_range
    strange = analyze(machine, cycle('wild', 4.0, 2.5, 1.5, seed=10))
    assert strange.out_of_range and strange.reasons


def test_analysis_with_joints_missing(machine, motions):
    motion = motions[1]
    positions = motion.positions.copy()
    positions[:, 3] = np.nan
    positions[40:50] = np.nan
    partial = analyze(machine, motion.replace(positions=positions))
    whole = analyze(machine, motion)
    assert partial.nearest == 'run'
    assert (partial.path == whole.path).mean() > 0.7
    without = analyze(machine, motion.joints(['hip', 'knee', 'ankle', 'neck']))  # the joint is not there at all
    assert without.nearest == 'run'
    with pytest.raises(ModelError, match='none of the model'):
        analyze(machine, motion.replace(positions=np.full_like(positions, np.nan)))
    with pytest.raises(ModelError, match='lacks'):
        analyze(machine, motion.replace(joint_names=('a', 'b', 'c', 'd', 'e')))


def test_changing_style_changes_speed_and_size(machine, motions):
    found = analyze(machine, motions[0])
    run = synthesize(machine, found.path, 'run', dwell=found.emission.dwell)
    assert run.n_frames < 0.8 * motions[0].n_frames           # a run takes less time
    assert run.positions[:, 0].std() > 1.3 * motions[0].positions[:, 0].std()
    assert run.positions.mean() > 0.1                         # and leans forward


def test_scale_dwell_of_occupancies_equals_that_of_states():
    path = np.repeat([0, 1, 2, 0], [4, 6, 2, 4])
    before, after = np.ones(3), np.array([2.0, 0.5, 1.0])
    scaled = scale_dwell(path, before, after)
    np.testing.assert_array_equal(scaled, np.repeat([0, 1, 2, 0], [8, 3, 2, 8]))
    soft = scale_dwell(np.eye(3)[path], before, after)
    assert soft.shape == (21, 3)
    np.testing.assert_allclose(soft.sum(axis=1), 1.0)
    assert (soft.argmax(axis=1) == scaled).mean() > 0.9


def test_runs_and_visits_are_inverse():
    path = np.array([3, 3, 1, 2, 2, 2, 3])
    np.testing.assert_array_equal(visits_to_path(runs(path)), path)
    assert len(visits_to_path([(0, 0.4)] * 10)) == 4  # rounding is carried along


def test_streaming_agrees_with_batch(machine):
    path = np.concatenate([machine.recordings['walk'][:70], machine.recordings['run'][:50]])
    batch = synthesize(machine, path, 'walk').positions
    worst = {}
    for lag in (5, 15, 40):
        stream = StreamingSynthesizer(machine, 'walk', lag=lag)
        frames = [frame for state in path if (frame := stream.push(state)) is not None] + stream.flush()
        assert [frame.time for frame in frames] == [k / 60.0 for k in range(len(path))]
        worst[lag] = np.abs(np.array([frame.positions for frame in frames]) - batch).max()
    assert worst[40] < 1e-3  # the stated tolerance at the default lag, rad
    assert worst[40] < worst[15] < worst[5]
    stream = StreamingSynthesizer(machine, 'walk', lag=len(path))
    assert all(frame is None for frame in [stream.push(state) for state in path])
    np.testing.assert_allclose([frame.positions for frame in stream.flush()], batch, atol=1e-10)


def test_streaming_occupancies_equals_streaming_states(machine):
    path = machine.recordings['walk'][:60]
    one, other = StreamingSynthesizer(machine, lag=10), StreamingSynthesizer(machine, lag=10)
    for state in path:
        a, b = one.push(state), other.push(np.eye(machine.n_states)[state])
        if a is not None:
            np.testing.assert_allclose(a.positions, b.positions, atol=1e-10)
            np.testing.assert_allclose(a.velocities, b.velocities, atol=1e-8)


def test_style_changes_while_streaming_are_continuous(machine, motions):
    stream = StreamingSynthesizer(machine, 'walk', source=random_walk(machine, seed=4))
    frames = []
    for k in range(400):
        if k == 100:
            stream.set_style('run', seconds=0.5)
        if k == 110:
            stream.set_style('1.5*strut - 0.5*walk', seconds=0.3)  # again, on the way
        if k == 250:
            with pytest.raises(UsageError, match='no style'):
                stream.set_style('ballet')
        frames.append(stream.step())
    np.testing.assert_allclose(frames[-1].v, machine.style('1.5*strut - 0.5*walk'))
    poses = np.array([frame.positions for frame in frames])
    largest = max(np.abs(np.diff(motion.positions, axis=0)).max() for motion in motions)
    assert np.abs(np.diff(poses, axis=0)).max() < 1.5 * largest
    velocities = np.array([frame.velocities for frame in frames])
    np.testing.assert_allclose(velocities[1:-1], (poses[2:] - poses[:-2]) * 30.0, atol=0.05)


def test_a_finite_source_ends(machine):
    visits = [(int(state), 1.0) for state in range(3)]
    stream = StreamingSynthesizer(machine, source=iter(visits))
    frames = []
    while (frame := stream.step()) is not None:
        frames.append(frame)
    expected = synthesize_visits(machine, visits)
    np.testing.assert_allclose([frame.positions for frame in frames], expected.positions, atol=1e-10)


def test_streaming_refuses_nonsense(machine):
    stream = StreamingSynthesizer(machine)
    for content in (-1, machine.n_states, np.full(machine.n_states, np.nan), np.ones(machine.n_states)):
        with pytest.raises(ModelError):
            stream.push(content)
    with pytest.raises(UsageError):
        StreamingSynthesizer(machine, lag=0)


def test_cycles_are_found_and_sequences_connect(machine):
    pieces = primitives(machine)
    assert any(piece.cyclic for piece in pieces)
    first = next(piece for piece in pieces if piece.cyclic)
    visits = sequence(machine, f'{first.name}*2, run@0.5-1.5 s0')
    states = [state for state, _ in visits]
    assert tuple(states[:len(first.states)]) == first.states
    for a, b in itertools.pairwise(states):
        assert a == b or machine.trans[a, b] > 0
    assert np.isfinite(synthesize_visits(machine, visits, 'strut').positions).all()
    for text, message in (('', 'empty'), ('jump', "no 'jump'"), ('c1@1-2', 'no training recording'),
                          ('run@9-12', 'no stretch'), ('run*x', 'cannot read|no ')):
        with pytest.raises(UsageError, match=message):
            sequence(machine, text)


def test_bridge_is_the_most_probable_path(machine):
    """Against enumeration of all simple paths of up to four steps."""
    moves = machine.trans * (1 - np.eye(machine.n_states))
    with np.errstate(invalid='ignore'):
        moves = np.nan_to_num(moves / moves.sum(axis=1, keepdims=True))
    n = machine.n_states
    checked = 0
    for a, b in itertools.permutations(range(n), 2):
        if machine.trans[a, b] > 0:
            assert bridge(machine, a, b) == []
            continue
        best = 0.0
        for length in (1, 2, 3):
            for middle in itertools.permutations([s for s in range(n) if s not in (a, b)], length):
                best = max(best, np.prod([moves[x, y] for x, y in itertools.pairwise((a, *middle, b))]))
        if best > 0:
            found = bridge(machine, a, b)
            if len(found) <= 3:
                checked += 1
            assert np.prod([moves[x, y] for x, y in itertools.pairwise((a, *found, b))]) >= best - 1e-15
    assert checked


def test_random_walks_have_a_seed_and_follow_arcs(machine):
    one = list(itertools.islice(random_walk(machine, 7), 50))
    assert one == list(itertools.islice(random_walk(machine, 7), 50))
    assert one != list(itertools.islice(random_walk(machine, 8), 50))
    followed = [machine.trans[a, b] > 0 for (a, _), (b, _) in itertools.pairwise(one)]
    assert np.mean(followed) > 0.9


def test_graph_in_dot(machine):
    text = graph_dot(machine)
    assert text.startswith('digraph') and text.count('->') >= machine.n_states - 1


def test_files_round_trip_and_damage_is_refused(machine, tmp_path):
    path = tmp_path / 'machine.npz'
    save(machine, path)
    again = load(path)
    assert again.styles.keys() == machine.styles.keys() and again.settings == machine.settings
    content = machine.recordings['walk']
    np.testing.assert_allclose(synthesize(again, content, 'run').positions,
                               synthesize(machine, content, 'run').positions, atol=1e-5)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(ModelError):
        load(path)


def test_training_is_reproducible_and_resumes_after_a_kill(motions, machine, tmp_path, monkeypatch):
    from style_core.style_machine import training
    monkeypatch.setattr(training, '_CHECKPOINT_EVERY_S', 0.0)
    rows = []

    class Kill(Exception):
        pass

    def die(row):
        rows.append(row)
        if len(rows) == 17:
            raise Kill

    checkpoint = tmp_path / 'run.checkpoint.npz'
    with pytest.raises(Kill):
        learn(motions, FAST, leading=3, dof=3, checkpoint=checkpoint, progress=die)
    resumed_rows = []
    resumed = learn(motions, FAST, leading=3, dof=3, checkpoint=checkpoint, progress=resumed_rows.append)
    assert len(resumed_rows) == len(machine.history) - 16
    np.testing.assert_array_equal(resumed.generic.positions, machine.generic.positions)
    np.testing.assert_array_equal(resumed.trans, machine.trans)
    with pytest.raises(ModelError, match='other recordings or settings'):
        learn(motions[:2], FAST, leading=3, checkpoint=checkpoint)
    checkpoint.write_bytes(b'nonsense')
    with pytest.raises(ModelError, match='damaged'):
        learn(motions, FAST, leading=3, checkpoint=checkpoint)


def test_styles_shared_by_recordings_and_bad_requests(motions):
    grouped = learn([*motions, cycle('walk2', 0.92, 0.41, 0.0, seed=5)], FAST, leading=3,
                    style_names=['walk', 'run', 'strut', 'walk'])
    assert list(grouped.styles) == ['walk', 'run', 'strut']
    for arguments, message in (
            ({'motions': []}, 'no recordings'),
            ({'motions': [motions[0], motions[0]]}, 'share a name'),
            ({'motions': motions, 'style_names': ['a']}, '1 style names for 3'),
            ({'motions': motions, 'style_names': ['a', 'b', 'generic']}, "called 'generic'"),
            ({'motions': [motions[0], motions[1].joints(['hip', 'knee'])]}, 'differ in joints'),
            ({'motions': [motions[0].replace(positions=np.zeros((240, 5)))]}, 'do not move'),
            ({'motions': [motions[0].replace(positions=np.full((240, 5), np.nan))]}, 'never shows')):
        with pytest.raises((ModelError, MotionError, UsageError), match=message):
            learn(settings=FAST, **arguments)


def test_recordings_with_gaps_train_and_resynthesise(motions):
    positions = motions[0].positions.copy()
    positions[30:60] = np.nan
    positions[100, 2] = np.nan
    machine = learn([motions[0].replace(positions=positions), *motions[1:]], FAST, leading=3, dof=3)
    again = synthesize(machine, machine.recordings['walk'], 'walk').positions
    assert np.sqrt(((again - motions[0].positions)[30:60] ** 2).mean()) < 0.25  # the gap is filled by the model
