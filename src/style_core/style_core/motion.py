"""`Motion`: named joint positions over time, and what can be done with any recording."""
import fnmatch
from dataclasses import dataclass, field, replace
from typing import Mapping, Optional, Tuple

import numpy as np

from style_core.budgets import NAME_BYTES, PATTERN_LIST_BYTES, PATTERNS
from style_core.errors import MotionError
from style_core.sizes import demand
from style_core.text import did_you_mean, shown

__all__ = ['Motion', 'USUAL_ORDER', 'concatenate', 'matching_names', 'triples_of', 'usual_units']

#: order of rotation where nothing else is said
USUAL_ORDER = 'XYZ'

#: two stamps closer than this are the same instant (far below any recording's step, above float rounding), s
SAME_INSTANT_S = 1e-7


@dataclass(frozen=True, eq=False)
class Motion:
    """Joint positions at increasing times.

    Parameters
    ----------
    joint_names : sequence of str, length D
        Names of the channels, each once. Acclaim and BVH channels are ``joint.rx``, ``root.tx`` and so on.
    positions : array_like, shape (T, D)
        Rad (or m, see ``units``); NaN means missing.
    times : array_like, shape (T,)
        Strictly increasing, s.
    units : sequence of {'rad', 'm'}, length D, optional
        All ``'rad'`` where left out.
    name : str, optional
        What the recording is called.
    epoch_ns : int, optional
        Stamp of time zero in ns (recordings from a bag); 0 where the recording has no absolute time.
    orders : mapping of str to str, optional
        Order of rotation of each joint with the three channels ``.rx``, ``.ry``, ``.rz``: ``'ZXY'`` turns about the
        fixed axis z first, then x, then y (R = Ry Rx Rz). A joint that is not listed has ``'XYZ'``, as in Acclaim.

    Raises
    ------
    MotionError
        If shapes do not fit, names repeat, there is no frame or channel, time does not increase strictly, a
        position is infinite, or an order is none.
    """

    joint_names: Tuple[str, ...]
    positions: np.ndarray
    times: np.ndarray
    units: Optional[Tuple[str, ...]] = None
    name: str = ''
    epoch_ns: int = 0
    orders: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self):
        names = tuple(str(name) for name in self.joint_names)
        positions = _as_float(self.positions, 'positions')
        times = _as_float(self.times, 'times')
        units = ('rad',) * len(names) if self.units is None else tuple(self.units)
        if times.ndim != 1 or positions.ndim != 2 or positions.shape != (len(times), len(names)):
            raise MotionError(f'{self._title()}: {len(names)} joint names and times of shape {times.shape} need '
                              f'positions of shape (T, {len(names)}), got {positions.shape}')
        if not len(times) or not names:
            raise MotionError(f'{self._title()} is empty: {len(times)} frames, {len(names)} joints')
        if len(set(names)) != len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise MotionError(f'{self._title()}: joint names given more than once: {", ".join(twice[:5])}')
        if len(units) != len(names) or set(units) - {'rad', 'm'}:
            raise MotionError(f"{self._title()}: units must be 'rad' or 'm' for each of {len(names)} joints")
        if not np.isfinite(times).all():
            frame = int(np.argmin(np.isfinite(times)))
            raise MotionError(f'{self._title()}: time of frame {frame} is not a finite number')
        steps = np.diff(times)
        if (steps <= 0).any():
            frame = int(np.argmax(steps <= 0)) + 1
            raise MotionError(f'{self._title()}: time does not increase at frame {frame} '
                              f'({times[frame - 1]:.9g} s, then {times[frame]:.9g} s)')
        if np.isinf(positions).any():
            frame, joint = np.argwhere(np.isinf(positions))[0]
            raise MotionError(f'{self._title()}: position of {names[joint]} is infinite in frame {frame}')
        orders = self._own_orders(names)
        for key, value in (('joint_names', names), ('positions', positions), ('times', times), ('units', units),
                           ('orders', orders)):
            object.__setattr__(self, key, value)

    def _own_orders(self, names):
        """The orders of joints with three angles that are there, checked; the usual order is left out."""
        if not self.orders:
            return {}
        joints = triples_of(names)
        for joint, order in self.orders.items():
            if sorted(str(order).upper()) != ['X', 'Y', 'Z']:
                raise MotionError(f'{self._title()}: the rotation order {order!r} of {joint} is not made of X, Y and Z')
        return {joint: str(order).upper() for joint, order in self.orders.items()
                if joint in joints and str(order).upper() != USUAL_ORDER}

    def _title(self):
        return f'motion {self.name!r}' if self.name else 'motion'

    def __repr__(self):
        return (f'Motion({self.name!r}, {self.n_frames} frames x {self.n_joints} joints, {self.rate_hz:.4g} Hz, '
                f'{self.duration_s:.4g} s)')

    @property
    def n_frames(self):
        """Number of frames T."""
        return len(self.times)

    @property
    def n_joints(self):
        """Number of channels D."""
        return len(self.joint_names)

    @property
    def duration_s(self):
        """Time from the first frame to the last, s."""
        return float(self.times[-1] - self.times[0])

    @property
    def rate_hz(self):
        """Frames a second, from the median step (gaps do not lower it); NaN for a single frame."""
        if self.n_frames == 1:
            return float('nan')
        # seven digits: stamps in whole nanoseconds must not turn 120 Hz into 120.0000048
        return float(f'{1.0 / np.median(np.diff(self.times)):.7g}')

    @property
    def triples(self):
        """Joint -> columns of its channels ``.rx``, ``.ry``, ``.rz``, of joints that have all three."""
        return triples_of(self.joint_names)

    def order_of(self, joint):
        """Order of rotation of a joint."""
        return self.orders.get(joint, USUAL_ORDER)

    def replace(self, **changes):
        """Return a copy with some fields changed (checked again)."""
        return replace(self, **changes)

    def select(self, *patterns):
        """Keep the channels that match.

        Parameters
        ----------
        *patterns : str
            Shell patterns (``'l*.rx'``); one with a leading ``!`` excludes. With only excluding patterns
            everything else is kept. The order of the channels stays.

        Raises
        ------
        MotionError
            If a pattern matches no channel, or nothing is left.
        """
        kept = matching_names(self.joint_names, patterns)
        columns = [index for index, name in enumerate(self.joint_names) if name in kept]
        return self._columns(columns)

    def joints(self, names):
        """Return the channels ``names`` in that order (MotionError names those that are absent)."""
        index = {name: column for column, name in enumerate(self.joint_names)}
        absent = [name for name in names if name not in index]
        if absent:
            raise MotionError(f'{self._title()} has no joint {", ".join(absent[:5])}'
                              f'{f" and {len(absent) - 5} more" if len(absent) > 5 else ""}; '
                              f'it has {", ".join(self.joint_names[:8])}{" ..." if self.n_joints > 8 else ""}')
        return self._columns([index[name] for name in names])

    def _columns(self, columns):
        return self.replace(joint_names=tuple(self.joint_names[c] for c in columns),
                            positions=self.positions[:, columns], units=tuple(self.units[c] for c in columns))

    def slice(self, start_s=None, stop_s=None):
        """Keep the frames with ``start_s <= time < stop_s``; the stamps stay as they are.

        Raises
        ------
        MotionError
            If no frame lies in the range.
        """
        kept = np.ones(self.n_frames, dtype=bool)
        if start_s is not None:
            kept &= self.times >= start_s - SAME_INSTANT_S
        if stop_s is not None:
            kept &= self.times < stop_s - SAME_INSTANT_S
        if not kept.any():
            asked = ' '.join(f'{word} {time_s:g} s' for word, time_s in (('from', start_s), ('to', stop_s))
                             if time_s is not None)
            raise MotionError(f'{self._title()} has no frame {asked}: it lasts from {self.times[0]:.6g} s to '
                              f'{self.times[-1]:.6g} s')
        return self.replace(positions=self.positions[kept], times=self.times[kept])

    def at(self, times, max_gap_s=None):
        """Interpolate by piecewise cubics through the samples.

        Parameters
        ----------
        times : array_like, shape (N,)
            Strictly increasing, s.
        max_gap_s : float, optional
            Two frames further apart than this have nothing between them. Default: 0.1 s, or three median steps
            where those are longer.

        Returns
        -------
        Motion
            With N frames. A value is NaN outside the recording, within a gap, and beside a missing sample; an
            instant that is a frame of the recording is that frame exactly.
        """
        times = _as_float(times, 'times')
        if times.ndim != 1:
            raise MotionError(f'times to interpolate at must have shape (N,), got {times.shape}')
        if max_gap_s is None:
            max_gap_s = max(0.1, 3.0 / self.rate_hz) if self.n_frames > 1 else 0.0
        nearest = _nearest(self.times, times)
        same = np.abs(self.times[nearest] - times) <= SAME_INSTANT_S
        result = np.full((len(times), self.n_joints), np.nan)
        result[same] = self.positions[nearest[same]]
        left = np.searchsorted(self.times, times, side='right') - 1
        inside = ~same & (left >= 0) & (left < self.n_frames - 1)
        left = left[inside]
        step = self.times[left + 1] - self.times[left] if left.size else np.empty(0)
        bridged = step <= max_gap_s
        left, step = left[bridged], step[bridged][:, None]
        rows = np.flatnonzero(inside)[bridged]
        u = (times[rows] - self.times[left])[:, None] / step
        slope = self.velocities()
        # cubic Hermite: values and slopes at both ends of the step
        result[rows] = ((1 + 2 * u) * (1 - u)**2 * self.positions[left] + u**2 * (3 - 2 * u) * self.positions[left + 1]
                        + step * u * (1 - u) * ((1 - u) * slope[left] - u * slope[left + 1]))
        return self.replace(positions=result, times=times)

    def resample(self, rate_hz, max_gap_s=None):
        """Return the motion at a constant rate from its first stamp on, never beyond its last (see `at`).

        Raises
        ------
        MotionError
            If the rate is no positive number.
        UsageError
            If the motion would not fit into memory.
        """
        if not (np.isfinite(rate_hz) and rate_hz > 0):
            raise MotionError(f'a rate must be a positive number of Hz, got {rate_hz}')
        count = int(np.floor(self.duration_s * rate_hz + 1e-6)) + 1
        demand(6 * count * self.n_joints, f'{self._title()} at {rate_hz:g} Hz, {count} frames,', 'a lower rate')
        return self.at(self.times[0] + np.arange(count) / rate_hz, max_gap_s)

    def velocities(self):
        """Velocities at the frames.

        Returns
        -------
        ndarray, shape (T, D)
            Rad/s (or m/s): exact for a quadratic course between unevenly spaced frames; one-sided at the ends and
            beside missing values; NaN where the value or both neighbours are missing.
        """
        slope = np.full(self.positions.shape, np.nan)
        if self.n_frames == 1:
            return slope
        step = np.diff(self.times)[:, None]
        secant = np.diff(self.positions, axis=0) / step
        before = np.concatenate([np.full((1, self.n_joints), np.nan), secant])
        after = np.concatenate([secant, np.full((1, self.n_joints), np.nan)])
        slope[1:-1] = (step[1:] * secant[:-1] + step[:-1] * secant[1:]) / (step[1:] + step[:-1])
        slope = np.where(np.isnan(slope), np.where(np.isnan(before), after, before), slope)
        if self.n_frames > 2:  # ends: continue the parabola through three frames where they are all there
            first = 2 * secant[0] - slope[1]
            last = 2 * secant[-1] - slope[-2]
            slope[0] = np.where(np.isnan(first), slope[0], first)
            slope[-1] = np.where(np.isnan(last), slope[-1], last)
        return slope

    def mirror(self, skeleton=None):
        """Exchange left and right.

        Parameters
        ----------
        skeleton : Skeleton, optional
            Gives the sign of each joint. Without it only channels named by axis (``lfemur.rx``, ``root.tz``) can be
            mirrored, about the plane x = 0, under the Acclaim convention that left and right joint frames are each
            other's mirror images.

        Raises
        ------
        MotionError
            If a joint's sign cannot be known or its partner on the other side is absent.
        """
        from style_core.mirroring import mirror_rule
        sources, signs = mirror_rule(self.joint_names, skeleton, self.orders)
        return self.replace(positions=self.positions[:, sources] * signs,
                            units=tuple(self.units[source] for source in sources))


def matching_names(names, patterns):
    """Names that match, in their own order.

    Parameters
    ----------
    names : sequence of str
    patterns : sequence of str
        Shell patterns; a leading ``!`` excludes.

    Returns
    -------
    list of str

    Raises
    ------
    MotionError
        If a pattern matches none of ``names``, or nothing is left, or there is more than `style_core.budgets` allows.
    """
    _check_patterns(patterns)
    matched = [{name for name in names if fnmatch.fnmatchcase(name, pattern.removeprefix('!'))} for pattern in patterns]
    for pattern, found in zip(patterns, matched):
        if not found:
            raise MotionError(f'no joint matches {shown(pattern.removeprefix("!"))!r}; the joints are '
                              f'{", ".join(names[:8])}{" ..." if len(names) > 8 else ""}'
                              + did_you_mean(pattern.strip('!*'), names))
    chosen = [found for pattern, found in zip(patterns, matched) if not pattern.startswith('!')]
    excluded = set().union(*(found for pattern, found in zip(patterns, matched) if pattern.startswith('!')))
    wanted = set().union(*chosen) if chosen else set(names)
    kept = [name for name in names if name in wanted and name not in excluded]
    if not kept:
        raise MotionError(f'the patterns {shown(", ".join(patterns))} leave no joint')
    return kept


def _check_patterns(patterns):
    if len(patterns) > PATTERNS:
        raise MotionError(f'{len(patterns)} patterns are refused: {PATTERNS} at most')
    sizes = [len(pattern.encode(errors='replace')) for pattern in patterns]
    if max(sizes, default=0) > NAME_BYTES:
        raise MotionError(f'a pattern of {max(sizes)} bytes is refused: {NAME_BYTES} at most')
    if sum(sizes) > PATTERN_LIST_BYTES:
        raise MotionError(f'patterns of {sum(sizes)} bytes together are refused: {PATTERN_LIST_BYTES} at most')


def triples_of(names):
    """Joint -> columns of ``joint.rx``, ``joint.ry``, ``joint.rz`` among ``names``, where all three are there."""
    column = {name: index for index, name in enumerate(names)}
    found = {}
    for name in names:
        joint, _, axis = name.rpartition('.')
        triple = tuple(column.get(f'{joint}.r{letter}') for letter in 'xyz')
        if axis.startswith('r') and joint not in found and None not in triple:
            found[joint] = triple
    return found


def usual_units(names):
    """Units of channels from their names: m for ``root.tx`` and the like, rad for all others (tuple of str)."""
    return tuple('m' if name.endswith(('.tx', '.ty', '.tz')) else 'rad' for name in names)


def concatenate(motions, name=''):
    """Put motions of the same joints one after the other.

    Parameters
    ----------
    motions : sequence of Motion
        The same joints; order may differ, that of the first is kept. Each starts one median step of the motion
        before it after that motion's last frame.
    name : str, optional

    Returns
    -------
    Motion

    Raises
    ------
    MotionError
        If the list is empty or joints or units differ.
    """
    motions = list(motions)
    if not motions:
        raise MotionError('no motions to concatenate')
    first = motions[0]
    step = next((np.median(np.diff(motion.times)) for motion in motions if motion.n_frames > 1), 1.0)
    parts, times, end = [], [], None
    for motion in motions:
        if set(motion.joint_names) != set(first.joint_names):
            differing = sorted(set(motion.joint_names) ^ set(first.joint_names))
            raise MotionError(f'cannot concatenate: {motion._title()} and {first._title()} differ in joints '
                              f'{", ".join(differing[:5])}')
        motion = motion.joints(first.joint_names)
        if motion.units != first.units:
            raise MotionError(f'cannot concatenate: {motion._title()} and {first._title()} differ in units')
        if motion.orders != first.orders:
            raise MotionError(f'cannot concatenate: {motion._title()} and {first._title()} differ in rotation orders')
        stamps = motion.times if end is None else motion.times - motion.times[0] + end
        parts.append(motion.positions)
        times.append(stamps)
        if len(stamps) > 1:
            step = np.median(np.diff(stamps))
        end = stamps[-1] + step
    return first.replace(positions=np.concatenate(parts), times=np.concatenate(times), name=name or first.name)


def _nearest(times, wanted):
    right = np.clip(np.searchsorted(times, wanted), 0, len(times) - 1)
    left = np.maximum(right - 1, 0)
    return np.where(np.abs(times[left] - wanted) <= np.abs(times[right] - wanted), left, right)


def _as_float(values, what):
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise MotionError(f'{what} must be numbers: {error}') from None
