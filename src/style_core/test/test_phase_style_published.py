"""The published method as its user sets it: lambda, Q, R, eq. (13) alone, start, behaviour; by file and command."""
import json
from pathlib import Path

import numpy as np
import pytest
from test_phase_style_learning import made_cycle, made_sequence

from style_core.cli import main
from style_core.errors import UsageError
from style_core.formats import read_motion, write_motion
from style_core.motion import Motion
from style_core.phase_style import PaperPredictor, Sequence, learn, load_behaviours, save_behaviours
from style_core.phase_style.matsubara_predictor import batch_em
from style_core.phase_style.published_learning import align_published
from style_core.predictor import Status
from style_core.predictor_file import read_predictor
from style_core.stream.loading import load_live

NAMES = tuple(f'j{k}' for k in range(6))
RATE = 60.0
MODELS = Path(__file__).resolve().parents[3] / 'config' / 'models'


@pytest.fixture(scope='module')
def behaviours():
    """A rhythmic behaviour and a discrete one, in this order."""
    walks = [made_sequence(f'p{k}_1', 5 + 0.3 * k, k, 0.3 * k, noise=0.02, seed=k)[0] for k in range(5)]
    jumps = []
    for k in range(4):
        u = np.linspace(0, 1, 70 + 10 * k)[:, None] * np.ones(6)
        jumps.append(Sequence(f'j{k}_1', f'j{k}', np.sin(3 * u + np.arange(6)) * (1 + 0.1 * k), RATE))
    return [learn(walks, NAMES, 'walk', dimension=3), learn(jumps, NAMES, 'jump', rhythmic=False, dimension=2)]


@pytest.fixture(scope='module')
def files(behaviours, tmp_path_factory):
    """Model file and the recording of a walk whose style changes half way."""
    folder = tmp_path_factory.mktemp('published')
    save_behaviours(folder / 'm.npz', behaviours, [])
    times = np.arange(240) / RATE
    y = np.where(times[:, None] < 2, made_cycle(5.6 * times, 0.1), made_cycle(5.6 * times, 1.1))
    write_motion(Motion(NAMES, y, times, name='walk'), folder / 'walk.csv')
    return str(folder / 'm.npz'), str(folder / 'walk.csv')


def followed(predictor, motion):
    """Style after every frame, shape (T, J)."""
    return np.array([predictor.update(time, y).style for time, y in zip(motion.times, motion.positions)])


def weighted_style(behaviour, phases, y, forgetting):
    """(A.10) by eqs. (16) to (18) written out: one least squares over all frames, the newest with weight 1."""
    basis = np.stack([process.evaluate(phases)[0] for process in behaviour.processes()], axis=1)     # (T, J, D)
    root = np.sqrt(forgetting ** np.arange(len(y))[::-1])
    design = (root[:, None, None] * basis).transpose(0, 2, 1).reshape(-1, basis.shape[1])
    return np.linalg.lstsq(design, (root[:, None] * y).reshape(-1), rcond=None)[0]


@pytest.mark.parametrize('forgetting', [0.8, 0.9, 1.0])
def test_lambda_of_a_file_predictor_is_that_of_equations_16_to_18(behaviours, files, forgetting):
    predictor = read_predictor(files[0], 'paper', forgetting=forgetting, start=(0.0, 5.6)).predictor
    motion = read_motion(files[1])
    found = [predictor.update(time, y) for time, y in zip(motion.times, motion.positions)]
    want = weighted_style(behaviours[0], np.array([one.phase for one in found]), motion.positions, forgetting)
    np.testing.assert_allclose(found[-1].style, want, rtol=2e-3, atol=1e-3)


def test_lambda_changes_while_it_runs_and_only_for_what_comes(files):
    motion = read_motion(files[1])
    live, steady = load_live(files[0], 'paper', np.array([0.1]), forgetting=1.0), \
        read_predictor(files[0], 'paper', forgetting=1.0).predictor
    first, second = motion.slice(None, 1.999), motion.slice(2.0, None)
    np.testing.assert_array_equal(followed(live.predictor, first), followed(steady, first))
    live.forget(0.8)
    assert live.published.forgetting == 0.8
    forgot, kept = followed(live.predictor, second)[-1], followed(steady, second)[-1]
    fresh = followed(read_predictor(files[0], 'paper').predictor, motion)[-1]
    assert np.abs(forgot - fresh).max() < 0.02 < 0.1 < np.abs(kept - fresh).max()


def test_lambda_set_during_the_search_is_that_of_the_filter_that_wins(behaviours, files):
    motion = read_motion(files[1])
    early, late = PaperPredictor(behaviours[0], 0.9), PaperPredictor(behaviours[0], 0.5)
    late.forgetting = 0.9
    np.testing.assert_array_equal(followed(early, motion), followed(late, motion))
    late.forgetting = 0.7
    late.reset()
    np.testing.assert_array_equal(followed(PaperPredictor(behaviours[0], 0.7), motion), followed(late, motion))


def test_the_full_filter_has_no_lambda_and_is_the_same_with_one_set():
    plain, other = (load_live(MODELS / 'jump.npz', 'full', np.array([0.1]), forgetting=one) for one in (None, 0.5))
    other.forget(0.6)
    assert other.published is None
    for k in range(30):
        y = 0.1 * np.sin(0.1 * k + np.arange(len(plain.predictor.joint_names)))
        one, two = (live.predictor.update(k / RATE, y) for live in (plain, other))
        np.testing.assert_array_equal(one.mean, two.mean)


@pytest.mark.parametrize('options', [
    {'forgetting': 0.0}, {'forgetting': 1.1}, {'forgetting': np.nan}, {'process_noise': -1.0}, {'process_noise': 0.0},
    {'process_noise': (1.0, 2.0, 3.0)}, {'observation_noise': 0.0}, {'observation_noise': 'eq14'},
    {'observation_noise': [1.0, 2.0]}, {'start': np.nan}, {'start': (1.0, 2.0, 3.0)}])
def test_settings_out_of_range_are_refused(behaviours, options):
    with pytest.raises(UsageError, match=next(iter(options))):
        PaperPredictor(behaviours[0], **options)


@pytest.mark.parametrize('behaviour, method, message', [('hop', 'paper', 'walk, jump'), ('walk', 'full', 'paper')])
def test_a_behaviour_that_is_not_to_be_had(files, behaviour, method, message):
    with pytest.raises(UsageError, match=message):
        read_predictor(files[0], method, behaviour=behaviour)
    with pytest.raises(UsageError, match=message):
        load_live(files[0], method, np.array([0.1]), behaviour=behaviour)


def test_any_behaviour_of_a_file(files):
    live = load_live(files[0], 'paper', np.array([0.1]), behaviour='jump')
    estimate = live.predictor.update(0.0, np.sin(np.arange(6.0)))
    assert set(estimate.behaviours) == {'jump'} and live.is_discrete(estimate) and 0 <= estimate.phase <= 1
    assert set(load_live(files[0], 'paper', np.array([0.1])).rhythmic) == {'walk'}


def dense_step(phase, velocity, p, q, r, process, style, y, dt):
    """Appendix A, (A.1) to (A.6) with the inverse of (A.4), by full matrices; Q and R as given."""
    a = np.array([[1, dt], [0, 1]])
    x, p = a @ [phase, velocity], a @ p @ a.T + q
    values, slopes, variances = zip(*(one.evaluate(np.array([x[0]])) for one in process))
    mean, slope = (sum(w * part[0] for w, part in zip(style, parts)) for parts in (values, slopes))
    h = np.stack([slope, np.zeros(len(slope))], axis=1)
    s = h @ p @ h.T + r(variances, style)
    gain = p @ h.T @ np.linalg.inv(s)
    return x + gain @ (y - mean), p - gain @ h @ p


@pytest.mark.parametrize('options', [
    {'process_noise': (1e-4, 2e-2)}, {'process_noise': 3.0}, {'observation_noise': 0.04},
    {'observation_noise': np.linspace(0.01, 0.06, 6)}, {'observation_noise': 'eq13'}], ids=str)
def test_q_and_r_are_those_of_the_printed_filter(behaviours, options):
    walk, dt = behaviours[0], 1 / behaviours[0].rate_hz
    predictor = PaperPredictor(walk, start=(1.0, 5.0), **options)
    q = options.get('process_noise', walk.acceleration)
    q = np.diag(q) if np.ndim(q) else q * np.array([[dt ** 3 / 3, dt ** 2 / 2], [dt ** 2 / 2, dt]])
    noise = options.get('observation_noise', walk.noise)

    def r(variances, style):
        if isinstance(noise, str):      # eq. (13) with k(z*, z*) of the printed kernel, which holds 1 / beta_3
            return sum(w ** 2 * (v[0] + 1 / beta[2]) for w, v, beta in zip(style, variances, walk.beta)) * np.eye(6)
        return np.diag(np.broadcast_to(noise, 6)) + sum(w ** 2 * v[0] for w, v in zip(style, variances)) * np.eye(6)

    y = made_cycle(1.05 + 5.2 * np.arange(8) * dt, 0.4)
    before = predictor.update(0.0, y[0])
    for k in range(1, len(y)):
        x, p = dense_step(before.phase, before.phase_velocity, before.phase_covariance, q, r, walk.processes(),
                          before.style, y[k], dt)
        before = predictor.update(k * dt, y[k])
        np.testing.assert_allclose([before.phase, before.phase_velocity], x, rtol=2e-4)
        np.testing.assert_allclose(before.phase_covariance, p, rtol=1e-2, atol=1e-9)


def test_a_given_start_is_followed_without_a_search(behaviours, files):
    walk, motion = behaviours[0], read_motion(files[1])
    predictor = PaperPredictor(walk, start=0.1)
    ahead = np.array([0.0, 0.2])
    values = np.stack([one.evaluate(0.1 + ahead * walk.velocity[0])[0] for one in walk.processes()])
    np.testing.assert_allclose(predictor.predict(ahead).mean, np.tensordot(walk.styles.mean(0), values, 1), atol=1e-3)
    assert predictor.update(motion.times[0], motion.positions[0]).status is Status.TRACKING
    with pytest.raises(UsageError, match='0 to 1'):
        PaperPredictor(behaviours[1], start=1.5)


@pytest.mark.parametrize('options', [{'observation_noise': 'eq13'}, {'process_noise': (1e-4, 2e-2)}], ids=str)
def test_bands_stay_finite_and_positive(behaviours, options):
    predictor = PaperPredictor(behaviours[0], **options)
    for k, y in enumerate(made_cycle(5.2 * np.arange(60) / RATE, 0.4)):
        assert (predictor.update(k / RATE, y).std > 0).all()
    std = predictor.predict(np.array([0.0, 0.2, 0.4])).std
    assert np.isfinite(std).all() and (np.diff(std.mean(axis=1)) >= 0).all() and (std > 0).all()


def test_commands_set_lambda(files, tmp_path, capsys):
    scores = {}
    for forgetting in ('0.8', '1'):
        assert main(['evaluate', *files, '--method', 'paper', '--forgetting', forgetting, '--json']) == 0
        scores[forgetting] = json.loads(capsys.readouterr().out)['recordings']['walk']['error_deg2']
    assert scores['0.8'] < 0.5 * scores['1']      # the style changes half way
    out = {name: str(tmp_path / f'{name}.csv') for name in ('a', 'b', 'c')}
    assert main(['predict', *files, '-o', out['a'], '--method', 'paper', '--behaviour', 'walk']) == 0
    assert main(['predict', *files, '-o', out['b'], '--method', 'paper', '--forgetting', '0.8']) == 0
    assert main(['predict', *files, '-o', out['c'], '--method', 'paper', '--forgetting', '1']) == 0
    first, same, other = (read_motion(path).positions for path in out.values())
    np.testing.assert_array_equal(first, same)
    assert np.abs(first - other).max() > 0.05
    capsys.readouterr()
    for wrong in (['--forgetting', '0.8'], ['--behaviour', 'walk'], ['--method', 'paper', '--forgetting', '0'],
                  ['--method', 'paper', '--forgetting', '1.5'], ['--method', 'paper', '--behaviour', 'hop']):
        for command in (['evaluate', *files], ['predict', *files, '-o', out['a'], ], ['fill', *files, '-o', out['a']],
                        ['analyze', *files]):
            assert main([*command, *wrong]) == 2
            assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_fill_on_line_by_the_published_method(files, tmp_path, capsys):
    motion = read_motion(files[1])
    holed = motion.positions.copy()
    holed[40:100, 2:4] = np.nan
    write_motion(motion.replace(positions=holed), tmp_path / 'holed.csv')
    command = ['fill', files[0], str(tmp_path / 'holed.csv'), '--method', 'paper', '--std', str(tmp_path / 's.csv')]
    assert main([*command, '-o', str(tmp_path / 'whole.csv')]) == 0
    assert 'filled 120 of 1440 values' in capsys.readouterr().out
    filled, hole = read_motion(tmp_path / 'whole.csv').positions, np.isnan(holed)
    np.testing.assert_array_equal(filled[~hole], read_motion(tmp_path / 'holed.csv').positions[~hole])
    assert np.sqrt(np.mean((filled - motion.positions)[hole] ** 2)) < 0.1
    # each frame from those before it: what comes later changes nothing
    write_motion(motion.replace(positions=holed).slice(None, 1.2), tmp_path / 'holed.csv')
    assert main([*command, '-o', str(tmp_path / 'begun.csv')]) == 0
    np.testing.assert_array_equal(read_motion(tmp_path / 'begun.csv').positions, filled[:72])


def test_alignment_is_equation_5_row_by_row():
    sequences = [made_sequence(f'p{k}_1', 5 + 0.4 * k, k, 0.2 * k, noise=0.02, seed=k)[0] for k in range(3)]
    _, aligned = align_published(sequences, True)
    periods = [round(60 * 2 * np.pi / (5 + 0.4 * k)) for k in range(3)]
    base = sequences[2].y       # the shortest period
    for sequence, length, cycle in zip(sequences, periods, aligned.cycles):
        best = None
        for j in range(len(sequence.y) - length + 1):
            total = 0.0
            for n in range(periods[2]):
                total += base[n] @ sequence.y[j + int(n * length / periods[2] + 0.5)]
            if best is None or total > best[0]:
                best = total, j
        want = [sequence.y[best[1] + int(n * length / periods[2] + 0.5)] for n in range(periods[2])]
        np.testing.assert_array_equal(cycle, want)
    np.testing.assert_allclose(aligned.grid, 2 * np.pi * np.arange(periods[2]) / periods[2])


def test_discrete_alignment_is_linear_from_start_to_goal():
    sequences = [Sequence(f'j{k}_1', f'j{k}', np.sin(3 * np.linspace(0, 1, 50 + 10 * k)[:, None] + np.arange(6)), RATE)
                 for k in range(3)]
    cut, aligned = align_published(sequences, False)
    for sequence, phase, cycle in zip(cut, aligned.phases, aligned.cycles):
        np.testing.assert_allclose(phase, np.linspace(0, 1, len(sequence.y)))
        np.testing.assert_array_equal(cycle[[0, -1]], sequence.y[[0, -1]])
    assert aligned.grid[-1] == 1


def test_a_model_learned_as_published_is_for_the_published_method(tmp_path, capsys):
    files = []
    for k in range(4):
        y = made_sequence(f'p{k}_1', 5 + 0.3 * k, k, 0.3 * k, noise=0.02, seed=k)[0].y
        files.append(str(tmp_path / f'p{k}_1.csv'))
        write_motion(Motion(NAMES, y, np.arange(len(y)) / RATE, name=f'p{k}_1'), files[-1])
    model = str(tmp_path / 'm.npz')
    assert main(['train', 'phase-style', *files[:3], '--published', '-o', model]) == 0
    assert main(['train', 'phase-style', *files[:3], '--published', '--histories', '-o', model]) == 2
    capsys.readouterr()
    assert main(['evaluate', model, files[3], '--method', 'paper', '--json']) == 0
    (found,) = json.loads(capsys.readouterr().out)['recordings'].values()
    assert found['error_deg2'] < 0.2 * found['zero_velocity_error_deg2']
    assert main(['evaluate', model, files[3]]) == 1 and "method 'paper'" in capsys.readouterr().err


def test_batch_of_the_file_is_the_least_squares_of_the_paper(files):
    motion = read_motion(files[1]).slice(None, 1.999)
    behaviour = load_behaviours(files[0])[0]
    result = batch_em(behaviour, motion.times, motion.positions)
    assert result.converged
    np.testing.assert_allclose(result.style, weighted_style(behaviour, result.phase, motion.positions, 1.0),
                               rtol=2e-3, atol=1e-3)
