"""A predictor fed with messages as they come: names in any order, parts missing, clocks of all kinds."""
from dataclasses import dataclass
from time import perf_counter
from typing import Optional, Tuple

import numpy as np

from style_core.budgets import REMEMBERED_BYTES, UNKNOWN_BYTES, UNKNOWN_NAMES
from style_core.errors import UsageError
from style_core.motion import matching_names
from style_core.predictor import Estimate, Status
from style_core.stream.bound_map import all_finite
from style_core.stream.frames import FrameAssembler, usable
from style_core.stream.stamp_policy import NANOSECONDS, StampPolicy
from style_core.stream.tally import Tally
from style_core.text import shown

__all__ = ['StreamSettings', 'Step', 'Outlook', 'PredictorStream', 'warm_up']

#: robot angles beyond this (rad) are broken sensors, whatever the joint
IMPLAUSIBLE_RAD = 100.0
#: bytes that a remembered name takes besides its text, and a list of names besides them, about
_NAME_COST, _LIST_COST = 64, 512


@dataclass(frozen=True)
class StreamSettings:
    """How to treat messages; every time in s.

    Attributes
    ----------
    joint_timeout : float
        A joint silent for longer is timed out.
    merge_window : float
        Partial messages whose stamps differ by no more are one frame; 0 makes every message a frame.
    max_stamp_age : float
        Stamps this much older or newer than the arrival are dropped; 0 accepts any.
    max_gap : float
        A longer gap between stamps starts the search anew.
    reorder_window : float
        Stamps up to this far behind the newest are late; further behind, the clock has jumped.
    """

    joint_timeout: float = 0.1
    merge_window: float = 0.004
    max_stamp_age: float = 0.5
    max_gap: float = 1.0
    reorder_window: float = 0.1

    def __post_init__(self):
        for name in ('joint_timeout', 'merge_window', 'max_stamp_age', 'max_gap', 'reorder_window'):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise UsageError(f'{name} must be finite and not negative, not {value}')
        if self.joint_timeout <= self.merge_window:
            raise UsageError(f'joint_timeout ({self.joint_timeout} s) must be longer than merge_window '
                             f'({self.merge_window} s)')
        if self.max_gap <= self.joint_timeout:
            raise UsageError(f'max_gap ({self.max_gap} s) must be longer than joint_timeout ({self.joint_timeout} s)')
        if self.reorder_window >= self.max_gap:
            raise UsageError(f'reorder_window ({self.reorder_window} s) must be shorter than max_gap '
                             f'({self.max_gap} s)')


@dataclass(frozen=True, eq=False)
class Step:
    """One update, in robot joints.

    Attributes
    ----------
    stamp : int
        Of the frame, ns.
    estimate : Estimate
        In model channels.
    positions : ndarray, shape (R,)
        Robot angles: measured where observed, else the filter's.
    std : ndarray, shape (R,)
        Of the filter's pose.
    observed : ndarray of bool, shape (R,)
    doubted : ndarray of bool, shape (R,)
        Measured, but not believed by the filter; not ``observed`` then.
    """

    stamp: int
    estimate: Estimate
    positions: np.ndarray
    std: np.ndarray
    observed: np.ndarray
    doubted: np.ndarray


@dataclass(frozen=True, eq=False)
class Outlook:
    """Future robot poses.

    Attributes
    ----------
    stamp : int
        Of the frame the horizons count from, ns.
    mean, std, velocity : ndarray, shape (H, R)
        Rad, rad, rad/s.
    """

    stamp: int
    mean: np.ndarray
    std: np.ndarray
    velocity: np.ndarray


class PredictorStream:
    """Feed a predictor from messages and speak to it in robot joints.

    Parameters
    ----------
    predictor : OnlinePredictor
    joint_map : BoundMap
        Bound to ``predictor.joint_names``.
    settings : StreamSettings
    """

    def __init__(self, predictor, joint_map, settings):
        self.predictor = predictor
        self.joint_map = joint_map
        self.tally = Tally()
        self.unknown = {}
        self._numbers = {name: i for i, name in enumerate(joint_map.robot_joints)}
        self._lookups, self._lookup_bytes = {}, 0
        self._newest_names = self._newest_lookup = None
        self._allowed = np.ones(len(joint_map.robot_joints), dtype=bool)
        self._frames = FrameAssembler(len(self._allowed), 0, 0)
        self._stamps = StampPolicy(0, 0, 0)
        self._pose = np.full(len(predictor.joint_names), np.nan)
        self.configure(settings)
        self.reset()

    @property
    def robot_joints(self) -> Tuple[str, ...]:
        """Robot joints in the order of every array here."""
        return self.joint_map.robot_joints

    def configure(self, settings):
        """Use other settings from the next message on."""
        self.settings = settings
        self._stamps.max_age = round(settings.max_stamp_age * NANOSECONDS)
        self._stamps.max_gap = round(settings.max_gap * NANOSECONDS)
        self._stamps.reorder_window = round(settings.reorder_window * NANOSECONDS)
        self._frames.merge_window = round(settings.merge_window * NANOSECONDS)
        self._frames.timeout = round(settings.joint_timeout * NANOSECONDS)

    def reset(self):
        """Forget everything observed; the masks stay."""
        self.predictor.reset()
        self._stamps.reset()
        self._frames.reset()
        self._epoch: Optional[int] = None
        self.last: Optional[Step] = None

    def set_mask(self, patterns, allowed):
        """Use (``allowed``) or ignore the sensors of the robot joints that match any of the patterns.

        Raises
        ------
        MotionError
            If a pattern matches no joint; then nothing is changed.
        """
        for name in matching_names(self.robot_joints, patterns):
            self._allowed[self._numbers[name]] = allowed

    @property
    def allowed(self):
        """Which sensors may be used, ndarray of bool, shape (R,)."""
        return self._allowed.copy()

    def receive(self, names, positions, stamp, arrival):
        """Take one message.

        Parameters
        ----------
        names : sequence of str
        positions : sequence of float
            Robot angles, rad; NaN where a sensor has nothing.
        stamp, arrival : int
            Ns; a stamp of 0 means the arrival.

        Returns
        -------
        list of Step
            One for every frame this message completed; usually one, sometimes none or two.
        """
        count = self.tally.count
        count('messages')
        if len(positions) != len(names):
            count('no positions' if len(positions) == 0 else 'wrong length')
            return []
        if len(names) == 0:
            count('no positions')
            return []
        joints, places, clean = self._look_up(names)
        if not clean:
            count('duplicate names')
            return []
        if not len(joints):
            count('no known joint')
            return []
        verdict = self._stamps.judge(stamp, arrival)
        if verdict.reason:
            count(verdict.reason)
        if verdict.stamp is None:
            return []
        if verdict.reset:
            count('clock resets')
            self.predictor.reset()
            self._frames.reset()
            self._epoch = None
        values, absent, implausible = usable(np.asarray(positions, dtype=float), places, IMPLAUSIBLE_RAD)
        if absent or implausible:
            count('NaN values', absent)
            count('implausible values', implausible)
        frames, dropped = self._frames.add(joints, values, verdict.stamp)
        if dropped:
            count(dropped)
        steps = [self._update(frame) for frame in frames]
        return [step for step in steps if step is not None]

    def _look_up(self, names):
        """Robot joint numbers, their places in the message, and whether no joint comes twice."""
        if names is self._newest_names:  # readers give the same object for the same names
            return self._newest_lookup
        names = tuple(names)
        found = self._lookups.get(names)
        if found is None:
            known = [(self._numbers[name], place) for place, name in enumerate(names) if name in self._numbers]
            for name in names:
                if name not in self._numbers:
                    self._note_unknown(shown(name))
            table = np.array(known, dtype=np.intp).reshape(-1, 2)
            found = table[:, 0].copy(), table[:, 1].copy(), len({number for number, _ in known}) == len(known)
            cost = sum(map(len, names)) + _NAME_COST * len(names) + _LIST_COST
            if self._lookup_bytes + cost > REMEMBERED_BYTES:
                self._lookups.clear()
                self._lookup_bytes = 0
            if cost <= REMEMBERED_BYTES:
                self._lookups[names] = found
                self._lookup_bytes += cost
        self._newest_names, self._newest_lookup = names, found
        return found

    def _note_unknown(self, name):
        """Remember a name to be reported, as long as there is room."""
        if name not in self.unknown and len(self.unknown) < UNKNOWN_NAMES \
                and sum(map(len, self.unknown)) + len(name) <= UNKNOWN_BYTES:
            self.unknown[name] = None

    def _update(self, frame):
        if self._epoch is None:
            self._epoch = frame.stamp
        started = perf_counter()
        observed = self.joint_map.observe(frame.values, self._allowed.view(np.int8), self._pose)
        try:
            estimate = self.predictor.update((frame.stamp - self._epoch) * 1e-9, self._pose)
            sound = all_finite(estimate.mean, estimate.std)
        except (ArithmeticError, np.linalg.LinAlgError):
            sound = False
        self.tally.time('update', perf_counter() - started)
        if not sound:  # numerically broken: say so and search again rather than publish it
            self.tally.count('filter failures')
            self.predictor.reset()
            self._epoch = None
            return None
        doubted = observed & ~estimate.observed[self.joint_map.channels]
        if doubted.any():
            self.tally.count('values not believed', int(np.count_nonzero(doubted)))
            observed = observed & ~doubted
        filled = self.joint_map.to_robot(estimate.mean)
        np.copyto(filled, frame.values, where=observed)
        self.last = Step(frame.stamp, estimate, filled, self.joint_map.spread_to_robot(estimate.std), observed, doubted)
        self.tally.count('updates')
        return self.last

    def predict(self, horizons):
        """Predict from the last step; ``horizons`` shape (H,), s. None before the first step or if it is not finite."""
        if self._epoch is None or self.last is None:
            return None
        started = perf_counter()
        ahead = self.predictor.predict(horizons)
        if not all_finite(ahead.mean, ahead.std, ahead.velocity):
            self.tally.count('filter failures')
            self.predictor.reset()
            self._epoch = None
            return None
        mean = self.joint_map.to_robot(ahead.mean)
        outlook = Outlook(self.last.stamp, mean, self.joint_map.spread_to_robot(ahead.std),
                          self.joint_map.velocity_to_robot(ahead.velocity, mean))
        self.tally.time('predict', perf_counter() - started)
        return outlook

    def sensors(self, now):
        """State of every robot joint's sensor at ``now`` (ns): a dict of state to list of names.

        The states are ``used``, ``masked`` (by request), ``timed out``, ``never seen``, ``not believed`` (by the
        filter, in the last frame) and ``not measured`` (absent from the last frame, or NaN).
        """
        timeout = self.settings.joint_timeout
        nothing = np.zeros(len(self.robot_joints), dtype=bool)
        observed, doubted = (nothing, nothing) if self.last is None else (self.last.observed, self.last.doubted)
        found = {state: [] for state in ('used', 'masked', 'timed out', 'never seen', 'not believed', 'not measured')}
        ages = self._frames.ages(now).tolist()
        for name, age, seen, doubt, allowed in zip(
                self.robot_joints, ages, observed.tolist(), doubted.tolist(), self._allowed.tolist()):
            state = ('masked' if not allowed else 'never seen' if age == np.inf else 'timed out' if age > timeout
                     else 'used' if seen else 'not believed' if doubt else 'not measured')
            found[state].append(name)
        return found

    def status(self):
        """Status of the last step; ACQUIRING before the first."""
        return self.last.estimate.status if self.last is not None else Status.ACQUIRING


def warm_up(predictor, horizons, updates=3):
    """Put a predictor through its paces so that the first message costs what every message costs; then reset it."""
    pose = np.zeros(len(predictor.joint_names))
    for number in range(updates):
        predictor.update(number * 0.01, pose)
        predictor.predict(horizons)
    predictor.reset()
