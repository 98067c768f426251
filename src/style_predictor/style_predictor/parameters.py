"""The parameters of both nodes: what they are called, what they mean, and what must hold between them."""
from dataclasses import fields

import numpy as np

from style_core.errors import UsageError
from style_core.phase_style import FORGETTING, METHODS
from style_core.stream.stream import StreamSettings
from style_core.synthesis.player import STAMP_MODES, Faults
from style_node.parameter_table import Parameter, ParameterTable

__all__ = ['LOOPS', 'PLAYER', 'PREDICTOR', 'faults_of', 'horizons_of', 'settings_of']

LOOPS = ('no', 'repeat', 'seamless')
_STREAM = {field.name: field.default for field in fields(StreamSettings)}
_FAULTS = {field.name: field.default for field in fields(Faults)}


def settings_of(values):
    """Stream settings of a complete set of values."""
    return StreamSettings(**{name: values[name] for name in _STREAM})


def horizons_of(values):
    """Times ahead, s, shape (H,): now, then every ``step`` up to ``horizon``.

    The first point is over when the window arrives: a joint_trajectory_controller stands still for an update at every
    window that begins later.
    """
    return values['step'] * np.arange(max(1, round(values['horizon'] / values['step'])) + 1)


def faults_of(values):
    """Faults of a complete set of values."""
    faults = {name: values[name] for name in _FAULTS}
    return Faults(**{**faults, 'drop': tuple(pattern for pattern in values['drop'] if pattern),
                     'drop_until': values['drop_until'] or float('inf')})


def _predictor_together(values):
    settings_of(values)
    if values['step'] > values['horizon']:
        raise UsageError(f'step ({values["step"]} s) must not exceed horizon ({values["horizon"]} s)')
    if len(horizons_of(values)) > 1001:
        raise UsageError(f'horizon / step must not exceed 1000 points, got {values["horizon"]} s / {values["step"]} s')


PREDICTOR = ParameterTable((
    Parameter('model', '', 'Model file; looked for in the working folder, then among those of the suite', live=False),
    Parameter('models_folder', '', 'Folder to look for models in instead of those two; may be empty', live=False),
    Parameter('method', METHODS[0], 'Filter: the full one, or the published method alone', choices=METHODS, live=False),
    Parameter('behaviour', '', 'Behaviour of the model file that the published method follows, the first where empty; '
              'the full filter follows all and takes none', live=False),
    Parameter('forgetting', FORGETTING, 'lambda of the published method, a frame at the rate of the model; 1 forgets '
              'nothing. The full filter has none', lower=0.01, upper=1.0),
    Parameter('histories', True, 'Lean on the recorded motion that a model trained with --histories holds; the full '
              'filter alone where false', live=False),
    Parameter('joint_map', '', 'YAML file of robot joint names, signs, offsets, scales and limits; empty where the '
              'robot\'s joints are named and counted as the model\'s', live=False),
    Parameter('masked_joints', (), 'Robot joints not to use from the start (names or patterns)', live=False),
    Parameter('horizon', 0.4, 'How far ahead to predict', unit='s', lower=0.001, upper=10.0),
    Parameter('step', 1 / 60, 'Time between predicted points', unit='s', lower=0.0005, upper=1.0),
    Parameter('max_publish_rate', 0.0, 'Publish at most this often, always the newest; 0 for every update', unit='Hz',
              lower=0.0, upper=10000.0),
    Parameter('deadline', 0.005, 'Count an update that takes longer, outputs included', unit='s', lower=0.0001,
              upper=10.0),
    Parameter('joint_timeout', _STREAM['joint_timeout'], 'A joint silent for longer counts as missing', unit='s',
              lower=0.001, upper=10.0),
    Parameter('merge_window', _STREAM['merge_window'], 'Partial messages whose stamps differ by no more are one set of '
              'measurements; 0 makes every message one', unit='s', lower=0.0, upper=1.0),
    Parameter('max_stamp_age', _STREAM['max_stamp_age'], 'Drop messages whose stamps are this much older or newer than '
              'now; 0 accepts any (a bag played without its clock)', unit='s', lower=0.0, upper=3600.0),
    Parameter('max_gap', _STREAM['max_gap'], 'After a longer gap between stamps the search starts anew', unit='s',
              lower=0.01, upper=60.0),
    Parameter('reorder_window', _STREAM['reorder_window'], 'A stamp up to this far behind the newest is late; further '
              'behind, the clock has jumped and the search starts anew', unit='s', lower=0.0, upper=10.0),
), together=_predictor_together)

PLAYER = ParameterTable((
    Parameter('file', '', 'Motion file (AMC, BVH, CSV, NPZ, bag) to play', live=False),
    Parameter('skeleton', '', 'Skeleton file where the format needs one; empty to look beside the motion', live=False),
    Parameter('topic', '', 'Topic of a bag; empty where it holds one topic of joint states', live=False),
    Parameter('joints', (), 'Joints to play (patterns; a leading ! leaves out); all where empty', live=False),
    Parameter('joint_map', '', 'YAML file from the motion\'s joints to the robot\'s', live=False),
    Parameter('rate', 0.0, 'Resample to this rate; 0 keeps the recording\'s own stamps', unit='Hz', lower=0.0,
              upper=2000.0, live=False),
    Parameter('start', 0.0, 'Skip the beginning of the recording', unit='s', lower=0.0, upper=1e6, live=False),
    Parameter('stop', 0.0, 'Stop at this time of the recording; 0 for its end', unit='s', lower=0.0, upper=1e6,
              live=False),
    Parameter('speed', 1.0, 'How fast to play; 1 as recorded', lower=0.01, upper=100.0, live=False),
    Parameter('loop', 'no', 'Play once; again and again; or again and again cut at the best matching poses',
              choices=LOOPS, live=False),
    Parameter('await_subscribers', 0, 'Wait until so many listen to the joint states', lower=0, upper=100, live=False),
    Parameter('delay', 0.5, 'Then wait so long before the first sample', unit='s', lower=0.0, upper=60.0, live=False),
    Parameter('stamps', 'clock', 'Stamps of the clock, zero stamps, or those of the recording', choices=STAMP_MODES,
              live=False),
    Parameter('exit_at_end', True, 'Leave when everything has been played', live=False),
    Parameter('drop', (), 'Joints whose sensors go dark (patterns)', live=False),
    Parameter('drop_from', 0.0, 'When they go dark, after the start', unit='s', lower=0.0, upper=1e6, live=False),
    Parameter('drop_until', 0.0, 'When they come back; 0 for never', unit='s', lower=0.0, upper=1e6, live=False),
    Parameter('drop_as_nan', False, 'Dark joints are sent as NaN instead of being left out', live=False),
    Parameter('drop_as_zero', False, 'Dark joints are sent as 0, as by an encoder without a signal', live=False),
    Parameter('glitch', 0.0, 'Probability that one joint of a sample is off by a normal number of radians', lower=0.0,
              upper=0.99, live=False),
    Parameter('noise_std', 0.0, 'Standard deviation of white noise on every joint', unit='rad', lower=0.0, upper=10.0,
              live=False),
    Parameter('jitter', 0.0, 'Share of the sample interval by which samples come late at random', lower=0.0, upper=0.99,
              live=False),
    Parameter('lose', 0.0, 'Probability that a sample is lost', lower=0.0, upper=0.99, live=False),
    Parameter('gap_every', 0.0, 'Every so often nothing is sent for gap_length; 0 for no gaps', unit='s', lower=0.0,
              upper=1e6, live=False),
    Parameter('gap_length', 0.0, 'Length of the gaps', unit='s', lower=0.0, upper=1e6, live=False),
    Parameter('jump_at', 0.0, 'When the stamps jump, after the start', unit='s', lower=0.0, upper=1e6, live=False),
    Parameter('jump_by', 0.0, 'By how much they jump; 0 for no jump', unit='s', lower=-1e6, upper=1e6, live=False),
    Parameter('seed', 0, 'Of everything random', lower=0, upper=2**31 - 1, live=False),
), together=faults_of)
