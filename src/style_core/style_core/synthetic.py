"""A synthetic gait: walking and running made from formulas, on the joint names of the CMU recordings.

For tests and for trying the suite where no recordings are at hand. Its curves are drawn by hand to look human; figures
measured on it say nothing about people.
"""
from dataclasses import dataclass

import numpy as np

from style_core.errors import UsageError
from style_core.motion import Motion

__all__ = ['GaitStyle', 'random_style', 'synthetic_gait', 'synthetic_people']

# One row a joint channel: mean, then amplitude and phase (rad) of the first and of the second harmonic, once for
# walking and once for running; degrees. Phase zero is near the left hip's greatest flexion. Left limbs; the right ones
# follow half a cycle later with the signs of the second and third axis turned.
_LEFT = {
    'femur.rx': ((-11, 22, 3.1, 4.5, 0.8), (-22, 33, 3.1, 7, 0.9)),
    'femur.ry': ((1, 2.5, -1.1, 2, -2.2), (2, 4, -1.2, 2, -2.3)),
    'femur.rz': ((-21, 6, -0.6, 0.6, 0.5), (-21, 5, -0.6, 1, 0.4)),
    'tibia.rx': ((36, 18, -1.5, 17, 3.1), (62, 31, -1.3, 22, 2.9)),
    'foot.rx': ((-7, 9, -1.2, 8, 2.2), (-2, 15, -1.3, 10, 2.1)),
    'foot.rz': ((-5, 4, 0.6, 4, -0.9), (-8, 4, 0.6, 4, -1.0)),
    'toes.rx': ((-1, 5, 1.2, 4, -2.6), (-3, 8, 1.1, 5, -2.7)),
    'clavicle.ry': ((0, 1, 3.0, 0.3, 0.4), (0, 2, 3.0, 0.5, 0.4)),
    'clavicle.rz': ((0, 0.5, 2.6, 0.2, 1.0), (0, 1, 2.6, 0.3, 1.0)),
    'humerus.rx': ((-30, 10, -2.8, 1.5, -0.5), (-46, 22, -2.7, 3, -0.5)),
    'humerus.ry': ((4, 7, 0.4, 2, 2.1), (-6, 9, 0.4, 3, 2.2)),
    'humerus.rz': ((80, 3, -2.0, 1, -2.2), (95, 3, -2.0, 1, -2.1)),
    'radius.rx': ((26, 7, -2.5, 1.5, -0.3), (104, 9, -2.4, 3, -0.2)),
    'wrist.ry': ((5, 4, -2.6, 1.2, -1.0), (15, 3, -2.6, 1, -1.0)),
    'hand.rx': ((-25, 1, 1.1, 0.8, -2.4), (-25, 1.5, 1.1, 1, -2.4)),
    'hand.rz': ((20, 1, 0.9, 0.7, -1.6), (20, 1.5, 0.9, 1, -1.6)),
}
_TRUNK = {
    'lowerback.rx': ((8, 0.3, -1.5, 1, -2.6), (13, 0.4, -1.5, 2.5, -2.6)),
    'lowerback.ry': ((0, 2.5, 0.4, 0.1, 0), (0, 3, 0.4, 0.2, 0)),
    'lowerback.rz': ((0, 5, -0.2, 0.1, 1.7), (0, 5, -0.2, 0.2, 1.7)),
    'upperback.rx': ((0, 0.2, -1.9, 0.4, -2.0), (1, 0.2, -1.9, 0.8, -2.0)),
    'upperback.ry': ((0, 3.5, 0.3, 0.1, 0), (0, 5, 0.3, 0.1, 0)),
    'upperback.rz': ((0, 1.2, -1.4, 0.1, 1.5), (0, 1.5, -1.4, 0.1, 1.5)),
    'thorax.rx': ((-4, 0.1, 2.5, 0.5, 0), (-4, 0.2, 2.5, 0.8, 0)),
    'thorax.ry': ((0, 1.7, 0.3, 0.1, 0), (0, 2.5, 0.3, 0.1, 0)),
    'thorax.rz': ((0, 3, -2.9, 0.1, 1.2), (0, 3, -2.9, 0.1, 1.2)),
    'lowerneck.rx': ((-15, 0.3, -1.4, 0.5, -2.7), (-18, 0.4, -1.4, 1.2, -2.7)),
    'lowerneck.ry': ((0, 0.5, -2.9, 0.1, -2.0), (0, 0.7, -2.9, 0.1, -2.0)),
    'lowerneck.rz': ((0, 0.6, 0.2, 0.1, 3.1), (0, 0.8, 0.2, 0.1, 3.1)),
    'upperneck.rx': ((18, 0.3, -3.1, 0.6, 2.6), (12, 0.4, -3.1, 1.3, 2.6)),
    'upperneck.ry': ((0, 1, -2.8, 0.1, -1.5), (0, 1.2, -2.8, 0.1, -1.5)),
    'upperneck.rz': ((0, 0.4, 0.9, 0.1, -1.5), (0, 0.5, 0.9, 0.1, -1.5)),
    'head.rx': ((8, 0.1, 2.6, 0.2, 0), (6, 0.2, 2.6, 0.5, 0)),
    'head.ry': ((0, 0.4, -2.9, 0.1, -1.7), (0, 0.5, -2.9, 0.1, -1.7)),
    'head.rz': ((0, 0.1, 2.9, 0.1, -1.2), (0, 0.2, 2.9, 0.1, -1.2)),
}
_ORDER = ('lowerback', 'upperback', 'thorax', 'lowerneck', 'upperneck', 'head',
          'rclavicle', 'rhumerus', 'rradius', 'rwrist', 'rhand', 'lclavicle', 'lhumerus', 'lradius', 'lwrist', 'lhand',
          'rfemur', 'rtibia', 'rfoot', 'rtoes', 'lfemur', 'ltibia', 'lfoot', 'ltoes')
_LIMBS = {key.split('.')[0] for key in _LEFT}


@dataclass(frozen=True)
class GaitStyle:
    """How the synthetic person moves.

    Attributes
    ----------
    run : float
        0 walking, 1 running, in between a mixture.
    cadence_hz : float
        Cycles (two steps) a second.
    stride, knee_lift, arm_swing, twist : float
        Amplitude of hips, of knees and feet, of arms, of the trunk; 1 is ordinary.
    lean_deg, crouch_deg, elbow_deg, turnout_deg : float
        Constant forward lean of the trunk, bend of hips and knees, of the elbows, turn of the feet.
    asymmetry : float
        Share by which the right leg moves less than the left.
    """

    run: float = 0.0
    cadence_hz: float = 0.9
    stride: float = 1.0
    knee_lift: float = 1.0
    arm_swing: float = 1.0
    twist: float = 1.0
    lean_deg: float = 0.0
    crouch_deg: float = 0.0
    elbow_deg: float = 0.0
    turnout_deg: float = 0.0
    asymmetry: float = 0.0

    def __post_init__(self):
        if not np.isfinite([getattr(self, name) for name in self.__dataclass_fields__]).all():
            raise UsageError('a gait style needs finite numbers')
        if self.cadence_hz <= 0:
            raise UsageError(f'cadence must be positive, not {self.cadence_hz}')


def random_style(rng, run=0.0):
    """A synthetic person drawn at random.

    Parameters
    ----------
    rng : numpy.random.Generator
    run : float
        0 for a walker, 1 for a runner.
    """
    spread = rng.standard_normal(9)
    return GaitStyle(
        run=run, cadence_hz=(0.9 + 0.5 * run) * (1 + 0.08 * np.tanh(spread[0])), stride=1 + 0.12 * spread[1],
        knee_lift=1 + 0.1 * spread[2], arm_swing=max(0.2, 1 + 0.35 * spread[3]), twist=max(0.2, 1 + 0.25 * spread[4]),
        lean_deg=3 * spread[5], crouch_deg=3 * spread[6], elbow_deg=8 * spread[7], turnout_deg=3 * spread[8])


def synthetic_gait(duration_s, style=None, rate_hz=60.0, start_phase=0.0, wander=0.02, seed=0):
    """Make a motion and its true phase.

    Parameters
    ----------
    duration_s : float
    style : GaitStyle, optional
        An ordinary walk if left out.
    rate_hz : float
    start_phase : float
        Rad.
    wander : float
        Relative standard deviation of the slow drift of speed and of stride length; 0 makes every cycle the same.
    seed : int

    Returns
    -------
    motion : Motion
        The 50 body channels in the order of the CMU files, rad.
    phase : ndarray, shape (T,)
        Rad, unwrapped; zero (modulo 2 pi) is near the left hip's greatest flexion (of its first harmonic).

    Raises
    ------
    UsageError
        If the duration or the rate is not positive, or fewer than two frames result.
    """
    style = style or GaitStyle()
    if not (np.isfinite([duration_s, rate_hz]).all() and duration_s > 0 and rate_hz > 0):
        raise UsageError('duration and rate must be positive')
    times = np.arange(round(duration_s * rate_hz)) / rate_hz
    if len(times) < 2:
        raise UsageError('a gait needs at least two frames')
    rng = np.random.default_rng(seed)
    speed = 2 * np.pi * style.cadence_hz * (1 + wander * _drift(times, rng))
    phase = start_phase + np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2) / rate_hz])
    amplitude = 1 + wander * _drift(times, rng)
    names, columns = [], []
    for body in _ORDER:
        side, bone = (body[0], body[1:]) if body[1:] in _LIMBS else ('', body)
        for key, rows in (_LEFT if side else _TRUNK).items():
            if key.startswith(bone + '.'):
                names.append(side + key)
                columns.append(_channel(key, side, rows, style, phase, amplitude))
    return Motion(tuple(names), np.radians(np.stack(columns, axis=1)), times, name='synthetic gait'), phase


def _drift(times, rng):
    """A smooth random curve of about unit variance, slower than a cycle."""
    rates = 2 * np.pi * np.array([0.11, 0.23, 0.37])
    shifts = rng.uniform(0, 2 * np.pi, 3)
    weights = rng.standard_normal(3)
    return np.sqrt(2 / 3) * np.sum(weights * np.cos(times[:, None] * rates + shifts), axis=1)


def _channel(key, side, rows, style, phase, amplitude):
    bone, axis = key.split('.')
    mean, first, first_at, second, second_at = (
        (1 - style.run) * walk + style.run * running for walk, running in zip(*rows))
    gain = {'femur': style.stride, 'tibia': style.knee_lift, 'foot': style.knee_lift, 'toes': style.knee_lift,
            'clavicle': style.arm_swing, 'humerus': style.arm_swing, 'radius': style.arm_swing,
            'wrist': style.arm_swing, 'hand': style.arm_swing}.get(bone, style.twist)
    if side == 'r':
        phase = phase + np.pi
        if bone in ('femur', 'tibia', 'foot', 'toes'):
            gain = gain * (1 - style.asymmetry)
    mean = mean + {'lowerback.rx': style.lean_deg, 'femur.rx': -style.crouch_deg, 'tibia.rx': 2 * style.crouch_deg,
                   'foot.rx': -style.crouch_deg, 'radius.rx': style.elbow_deg,
                   'femur.ry': style.turnout_deg}.get(key, 0.0)
    curve = mean + gain * amplitude * (
        first * np.cos(phase - first_at) + second * np.cos(2 * phase - second_at))
    return -curve if side == 'r' and axis != 'rx' else curve


def synthetic_people(count, seed=0, run=0.0, duration_s=8.0, noise_std=0.01):
    """Gaits of people drawn at random, to learn from.

    Parameters
    ----------
    count : int
    seed : int
        Another seed makes other people.
    run : float
    duration_s : float
    noise_std : float
        Of white noise as sensors have it, rad; without any, a model learns that there is none.

    Returns
    -------
    list of Motion
        Named ``p0_gait``, ``p1_gait`` and so on: the part before the underscore is the person.
    """
    rng = np.random.default_rng(seed)
    people = []
    for number in range(count):
        gait, _ = synthetic_gait(duration_s, random_style(rng, run), seed=seed + 1000 * number + 1)
        noise = noise_std * rng.standard_normal(gait.positions.shape)
        people.append(gait.replace(name=f'p{number}_gait', positions=gait.positions + noise))
    return people
