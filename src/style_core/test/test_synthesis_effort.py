"""The synthesizer takes effort as a style: a recording restyled while it is performed."""
import numpy as np
import pytest
from test_effort import made_motion

from style_core.effort import restyle, save, train_library
from style_core.errors import MotionError, UsageError
from style_core.formats import write_motion
from style_core.motion import concatenate
from style_core.synthesis.performer import window_times
from style_core.synthesis.repertoire import list_models, load_repertoire
from style_core.synthesis.retargeting import plain_robot
from style_core.synthesis.sources.effort import RestyledSource
from style_core.synthesis.stage import Stage

AHEAD = window_times(0.02, 0.4)


@pytest.fixture(scope='module')
def made():
    """A library of two contents, and a recording of five fragments."""
    generator = np.random.default_rng(5)
    motions = [made_motion(f'c{content}m{manner}', generator.uniform(0.7, 1.4), generator.uniform(0.7, 1.3),
                           generator.uniform(0.2, 1.8), seed=content, travel=0.5)
               for content in range(2) for manner in range(8)]
    return train_library(motions, blends=40, seed=1), concatenate([motions[k] for k in (1, 9, 4, 12, 3)])


def performed(source, tick=0.02):
    """Every joint and its velocity until rest."""
    rows = []
    while source.remaining > 1e-9:
        rows.append(np.stack([part[0] for part in source.window(np.array([0.0, 0.1]))]))
        source.advance(tick)
    return np.array(rows)


def test_what_is_performed_is_the_restyled_recording(made):
    library, motion = made
    source = RestyledSource(library, motion)
    source.set_style([0.0, 0.0, 0.0], 0.5)
    tick = 1 / library.rate_hz
    rows = performed(source, tick)
    whole = restyle(library, motion, (0.0, 0.0, 0.0)).motion.select('!root.*')
    assert len(rows) == pytest.approx(whole.n_frames + 0.3 / tick, abs=2)
    np.testing.assert_allclose(rows[:whole.n_frames, 0], whole.positions, atol=1e-6)
    assert np.abs(rows[-1, 1]).max() < 0.1 and source.phase <= 1.0


def test_velocities_are_the_derivative_and_nothing_jumps(made):
    library, motion = made
    source = RestyledSource(library, motion, loop=True)
    rows = []
    for step in range(1500):
        if step in (300, 700, 701, 1100):
            source.set_style([2.0, -2.0, 1.0] if step % 200 else [-2.0, 2.0, 0.0], 0.2)
        rows.append([part[0] for part in source.window(np.array([0.0]))])
        source.advance(0.004)
    positions, velocities = np.array(rows).transpose(1, 0, 2)
    middle = (positions[2:] - positions[:-2]) / 0.008
    assert np.abs(middle - velocities[1:-1]).max() < 0.15 * np.abs(velocities).max()
    steps = np.abs(np.diff(positions, axis=0)).max()
    assert steps < 1.5 * 0.004 * np.abs(motion.select('!root.*').velocities()).max()


def test_asked_effort_arrives_with_the_next_fragments(made, tmp_path):
    library, motion = made
    save(library, tmp_path / 'library.npz')
    write_motion(motion, tmp_path / 'steps.csv')
    repertoire = load_repertoire(tmp_path / 'library.npz', tmp_path / 'steps.csv')
    assert repertoire.modes == ('effort', 'file') and list_models(tmp_path) == [('library.npz', 'effort')]
    stage = Stage(repertoire, plain_robot())
    stage.choose('effort', loop=True)
    energies = []
    for text in ('light', 'strong'):
        np.testing.assert_array_equal(stage.set_style(text), stage.source.styles[text])
        for _ in range(200):
            stage.advance(0.02)
        np.testing.assert_array_equal(stage.source.style, stage.source.target)
        speeds = []
        for _ in range(200):
            speeds.append(stage.window(AHEAD)[1][0])
            stage.advance(0.02)
        energies.append(np.mean(np.square(speeds)))
    assert energies[1] > 1.3 * energies[0]
    np.testing.assert_allclose(stage.set_style('2*flow - weight'), [2, -1, 0])
    for wrong in ('4*flow', 'gloomy', [0.0, 1.0]):
        with pytest.raises(UsageError):
            stage.set_style(wrong)
    np.testing.assert_allclose(stage.source.target, [2, -1, 0])


def test_what_cannot_be_restyled_is_refused(made, tmp_path):
    library, motion = made
    save(library, tmp_path / 'library.npz')
    write_motion(motion, tmp_path / 'steps.csv')
    with pytest.raises(UsageError, match='give a motion file too'):
        load_repertoire(tmp_path / 'library.npz')
    with pytest.raises(UsageError, match='needs a model of kind effort and a motion file'):
        load_repertoire(file=tmp_path / 'steps.csv').source('effort')
    with pytest.raises(MotionError, match='missing'):
        RestyledSource(library, motion.replace(positions=np.where(motion.positions > 1, np.nan, motion.positions)))
    with pytest.raises(MotionError):
        RestyledSource(library, motion.select('root.*'))
