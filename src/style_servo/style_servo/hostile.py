"""Trajectories that no sender should send, for the safety tests: seeded, of every kind, among legal ones."""
import numpy as np

__all__ = ['KINDS', 'hostile_fields', 'legal_fields']


def legal_fields(chain, now, seconds=0.5, points=8):
    """One window of an endless motion through the middle of every joint's range, at ``now`` (s).

    Returns
    -------
    fields : dict
        ``names``, ``times`` (K,), ``positions`` and ``velocities`` (K, D), ``stamp`` (s from now).
    """
    times = np.linspace(0.0, seconds, points)
    middle, span = (chain.array('upper') + chain.array('lower')) / 2, chain.array('upper') - chain.array('lower')
    # half the speed and less than half the acceleration allowed, a quarter of the range
    frequency = 3.0
    amplitude = np.minimum(0.25 * span, np.minimum(0.5 * chain.array('velocity') / frequency,
                                                   0.4 * chain.array('acceleration') / frequency ** 2))
    angle = frequency * (now + times)[:, None] + np.arange(len(middle))
    return {'names': list(chain.names), 'times': times, 'positions': middle + amplitude * np.sin(angle),
            'velocities': amplitude * frequency * np.cos(angle), 'stamp': 0.0}


def _nan(f, rng):
    f['positions'][_cell(f, rng)] = np.nan


def _infinite(f, rng):
    f['positions'][_cell(f, rng)] = rng.choice([np.inf, -np.inf])


def _huge(f, rng):
    f['positions'][_cell(f, rng)] = rng.choice([1e300, -1e300, 1e8, -1e8, 1e3])


def _jump(f, rng):
    f['positions'] += rng.normal(0, 3, f['positions'].shape[1])


def _steps(f, rng):
    f['positions'] += rng.normal(0, 2, f['positions'].shape)


def _creeping_jump(f, rng):
    f['positions'] += 0.3 * rng.uniform(-1, 1, f['positions'].shape)


def _nan_velocity(f, rng):
    f['velocities'][_cell(f, rng)] = rng.choice([np.nan, np.inf])


def _huge_velocity(f, rng):
    f['velocities'] *= 10.0 ** rng.uniform(1, 7)


def _no_velocity(f, rng):
    f['velocities'] = None
    _steps(f, rng)


def _unknown_joint(f, rng):
    f['names'][int(rng.integers(len(f['names'])))] = 'third_arm'


def _missing_joint(f, rng):
    f['names'].pop()
    f['positions'], f['velocities'] = f['positions'][:, :-1], f['velocities'][:, :-1]


def _joint_twice(f, rng):
    f['names'][0] = f['names'][-1]


def _no_joints(f, rng):
    f['names'] = []


def _wrong_width(f, rng):
    f['positions'] = f['positions'][:, :-1]


def _reversed(f, rng):
    f['times'] = f['times'][::-1]


def _shuffled(f, rng):
    rng.shuffle(f['times'])


def _duplicate_points(f, rng):
    f['times'][1:] = f['times'][:-1].copy()


def _all_at_once(f, rng):
    f['times'] = 1e-5 * np.arange(len(f['times']))


def _negative_times(f, rng):
    f['times'] -= rng.uniform(0.1, 10)


def _no_points(f, rng):
    f['times'] = f['times'][:0]


def _long_ago(f, rng):
    f['stamp'] = -float(rng.uniform(1, 1000))


def _far_ahead(f, rng):
    f['stamp'] = float(rng.uniform(3, 1e6))


def _soon(f, rng):
    f['stamp'] = float(rng.uniform(0.01, 0.3))
    _creeping_jump(f, rng)


def _one_point_at_once(f, rng):
    f['times'] = np.array([1e-3])
    f['positions'] = f['positions'][:1] + rng.normal(0, 1, f['positions'].shape[1])
    f['velocities'] = None


def _beyond_the_limits(f, rng):
    f['positions'] += rng.choice([-1, 1]) * np.linspace(0, 4, len(f['times']))[:, None]
    f['velocities'] = None


def _cell(f, rng):
    return int(rng.integers(f['positions'].shape[0])), int(rng.integers(f['positions'].shape[1]))


#: name -> function that spoils legal fields in place
KINDS = {function.__name__.strip('_').replace('_', ' '): function for function in (
    _nan, _infinite, _huge, _jump, _steps, _creeping_jump, _nan_velocity, _huge_velocity, _no_velocity, _unknown_joint,
    _missing_joint, _joint_twice, _no_joints, _wrong_width, _reversed, _shuffled, _duplicate_points, _all_at_once,
    _negative_times, _no_points, _long_ago, _far_ahead, _soon, _one_point_at_once, _beyond_the_limits)}


def hostile_fields(chain, now, kind, rng):
    """Legal fields (see :func:`legal_fields`) spoiled in one way of :data:`KINDS`."""
    fields = legal_fields(chain, now)
    KINDS[kind](fields, rng)
    return fields
