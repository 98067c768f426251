"""The parameters of the synthesizer: what they are called, what they mean, and what must hold between them."""
from style_core.errors import UsageError
from style_core.synthesis.performer import window_times
from style_core.synthesis.repertoire import MODES, FollowSettings
from style_core.synthesis.stage import StageSettings
from style_node.parameter_table import Parameter, ParameterTable

__all__ = ['SYNTHESIZER', 'options_of', 'settings_of', 'window_of']

_FOLLOW, _STAGE = FollowSettings(), StageSettings()
MOST_POINTS = 500


def window_of(values):
    """Times ahead of the points of a window, s, shape (K,)."""
    return window_times(values['step'], values['horizon'])


def settings_of(values):
    """Stage settings of a complete set of values."""
    return StageSettings(values['transition_time'], values['blend_time'], values['max_exaggeration'], values['lag'],
                         FollowSettings(values['phase_stiffness'], values['estimate_timeout'], values['coast_time'],
                                        values['stop_time']))


def options_of(values, mode):
    """What a mode needs to make its source."""
    wanted = {'cycle': ('behaviour', 'speed'), 'follow': ('behaviour',), 'sequence': ('speed',),
              'random_walk': ('speed', 'seed'), 'effort': ('speed', 'loop'), 'file': ('speed', 'loop')}[mode]
    return {name: values[name] for name in wanted}


def _together(values):
    if values['step'] > values['horizon']:
        raise UsageError(f'step ({values["step"]} s) must not exceed horizon ({values["horizon"]} s)')
    if len(window_of(values)) > MOST_POINTS:
        raise UsageError(f'horizon / step must not exceed {MOST_POINTS} points')
    if values['horizon'] < 2.0 / values['rate']:
        raise UsageError(f'the horizon ({values["horizon"]} s) must reach over two publications '
                         f'({2.0 / values["rate"]:.3f} s), or the robot would run out of trajectory')


SYNTHESIZER = ParameterTable((
    Parameter('model', '', 'Model file; looked for in the working folder, then among those of the suite; empty where '
              'only a motion file is played', live=False),
    Parameter('models_folder', '', 'Folder to look for models in instead of those two; may be empty', live=False),
    Parameter('robot', '', 'Robot file (joint names, combinations, limits); looked for in the working folder, then in '
              'config/robots; empty where the robot has the joints of the model', live=False),
    Parameter('file', '', 'Motion file to play or to restyle (AMC, BVH, CSV, NPZ, bag)', live=False),
    Parameter('skeleton', '', 'Skeleton file where the motion file needs one', live=False),
    Parameter('mode', 'cycle', 'What is performed', choices=tuple(MODES)),
    Parameter('behaviour', '', 'Behaviour of a phase-style model; its first where empty, when following the most '
              'probable one'),
    Parameter('style', '', 'Style as an expression over named styles, e.g. 1.5*walk - 0.5*run; empty for the '
              "model's mean"),
    Parameter('speed', 1.0, 'How fast; 1 as learned, 0 stands still', lower=0.0, upper=5.0),
    Parameter('seed', 0, 'Of a random walk', lower=0, upper=2**31 - 1),
    Parameter('loop', True, 'Play the motion file for ever, cut at its best matching poses (restyled: from end to '
              'start)'),
    Parameter('rate', 50.0, 'Windows a second; when following, every estimate is answered at once', unit='Hz',
              lower=1.0, upper=500.0, live=False),
    Parameter('horizon', 0.4, 'How far a window reaches', unit='s', lower=0.01, upper=10.0, live=False),
    Parameter('step', 0.02, 'Time between points of a window', unit='s', lower=0.001, upper=1.0, live=False),
    Parameter('transition_time', _STAGE.transition_time, 'Of a change of style or speed where none is given', unit='s',
              lower=0.02, upper=60.0),
    Parameter('blend_time', _STAGE.blend_time, 'From one mode or model to the next', unit='s', lower=0.05, upper=10.0),
    Parameter('max_exaggeration', _STAGE.max_exaggeration, 'A style coordinate may lie this many training ranges '
              'outside the styles learned', lower=0.0, upper=100.0),
    Parameter('lag', _STAGE.lag, 'Frames of future that a style machine weighs', lower=1, upper=1000, live=False),
    Parameter('phase_stiffness', _FOLLOW.stiffness, 'How fast the phase is pulled to that of the person', unit='rad/s',
              lower=0.5, upper=50.0, live=False),
    Parameter('estimate_timeout', _FOLLOW.patience, 'After a longer silence estimates are missing', unit='s',
              lower=0.01, upper=5.0, live=False),
    Parameter('coast_time', _FOLLOW.coast, 'Go on at the last speed for so long without estimates', unit='s', lower=0.0,
              upper=10.0, live=False),
    Parameter('stop_time', _FOLLOW.stop, 'Then slow down to a stop within', unit='s', lower=0.05, upper=10.0,
              live=False),
    Parameter('deadline', 0.01, 'Count a window that takes longer', unit='s', lower=0.0001, upper=1.0),
), together=_together)
