"""joint_trajectory_controller of ROS 2 Humble (2.54), without ROS and in lock step: what its source says it does.

Written from the semantics of its published source, not from what this suite sends. Times are whole nanoseconds, as
there. Position commands only; PID, wrap-around and trajectories without positions are left out. Kept are: replacement
of a message at the next update, the point before the message, splines whose degree follows from what both ends of a
segment have, partial goals, state and goal tolerances, the command time-out, and the life of an action's goal.
"""
from dataclasses import dataclass, field, replace

import numpy as np

__all__ = ['Goal', 'JointTrajectoryController', 'Message', 'Parameters', 'Point', 'Trajectory', 'message_of']

SECOND = 1_000_000_000
SUCCESSFUL, INVALID_GOAL, PATH_TOLERANCE_VIOLATED, GOAL_TOLERANCE_VIOLATED = 0, -1, -4, -5
EPSILON = float(np.finfo(np.float32).eps)
NONE = np.zeros(0)


@dataclass
class Point:
    """One point; velocities and accelerations have size 0 where there are none."""

    time: int
    positions: np.ndarray
    velocities: np.ndarray = field(default_factory=lambda: NONE)
    accelerations: np.ndarray = field(default_factory=lambda: NONE)


@dataclass
class Message:
    """A trajectory_msgs/JointTrajectory: stamp in ns, joint names, points."""

    stamp: int
    names: list
    points: list


def message_of(trajectory):
    """The same from a ROS message."""
    def ns(time):
        return time.sec * SECOND + time.nanosec
    return Message(ns(trajectory.header.stamp), list(trajectory.joint_names), [
        Point(ns(point.time_from_start), *(np.array(values, dtype=float) for values in (
            point.positions, point.velocities, point.accelerations))) for point in trajectory.points])


def _between(t0, first, t1, second, time):
    """Positions, velocities and accelerations between two points at ``time``."""
    now, whole = (time - t0) / SECOND, (t1 - t0) / SECOND
    has_velocity = bool(first.velocities.size and second.velocities.size)
    has_acceleration = bool(first.accelerations.size and second.accelerations.size)
    if now < 0.0 or now > whole:        # outside: held inside, and linear
        now = min(max(now, 0.0), whole)
        has_velocity = has_acceleration = False
    p0, p1 = first.positions, second.positions
    c = np.zeros((6, len(p0)))
    c[0] = p0
    if not has_velocity and not has_acceleration:
        if whole != 0.0:
            c[1] = (p1 - p0) / whole
        return c[0] + now * c[1], c[1].copy(), np.zeros_like(p0)
    if has_velocity and not has_acceleration:
        v0, v1 = first.velocities, second.velocities
        c[1] = v0
        if whole != 0.0:
            c[2] = (3 * (p1 - p0) - (2 * v0 + v1) * whole) / whole**2
            c[3] = (2 * (p0 - p1) + (v0 + v1) * whole) / whole**3
    elif has_velocity:
        v0, v1, a0, a1 = first.velocities, second.velocities, first.accelerations, second.accelerations
        c[1], c[2] = v0, 0.5 * a0
        if whole != 0.0:
            gap, t2 = p1 - p0, whole**2
            c[3] = (20 * gap - (3 * a0 - a1) * t2 - (12 * v0 + 8 * v1) * whole) / (2 * whole**3)
            c[4] = (-30 * gap + (3 * a0 - 2 * a1) * t2 + (16 * v0 + 14 * v1) * whole) / (2 * whole**4)
            c[5] = (12 * gap - (a0 - a1) * t2 - 6 * (v0 + v1) * whole) / (2 * whole**5)
    else:       # accelerations without velocities: no branch is taken, everything stays zero
        return np.zeros((3, len(p0)))
    powers = now ** np.arange(6)
    order = np.arange(6)
    rate, bend = order[1:, None] * c[1:], (order[2:] * order[1:-1])[:, None] * c[2:]
    return powers @ c, powers[:5] @ rate, powers[:4] @ bend


class Trajectory:
    """The controller's class of that name: one message, the state before it, and where it is sampled."""

    def __init__(self):
        self.message = None
        self.start = self.before_time = 0
        self.before = None
        self.sampled = False
        self._last = 0

    def update(self, message):
        """Replace the message."""
        self.message, self.start = message, message.stamp
        self.sampled, self._last = False, 0

    def set_point_before(self, time, state):
        """Keep the state that goes before the message; derivatives that its first point has begin at zero."""
        self.before_time, first = time, self.message.points[0]
        zero = {name: np.zeros_like(getattr(first, name)) for name in ('velocities', 'accelerations')
                if not getattr(state, name).size and getattr(first, name).size}
        self.before = replace(state, **zero)

    def sample(self, time):
        """The state at ``time``: a Point and the segment's two indices, or None before everything."""
        points = self.message.points
        if not points:
            return None
        if not self.sampled:
            if self.start == 0:         # zero means now, at the first sample
                self.start = time
            self.sampled = True
        if time < self.before_time:
            return None
        first = self.start + points[0].time
        if time < first:
            return Point(0, *_between(self.before_time, self.before, first, points[0], time)), 0, 0
        for i in range(self._last, len(points) - 1):
            t0, t1 = self.start + points[i].time, self.start + points[i + 1].time
            if t0 <= time < t1:
                self._last = i
                return Point(points[i + 1].time, *_between(t0, points[i], t1, points[i + 1], time)), i, i + 1
        self._last = len(points) - 1
        end, zero = points[-1], np.zeros_like(points[-1].positions)
        # a window that ends moving stands still after it, whatever its velocity says
        return Point(end.time, end.positions, end.velocities if end.velocities.size else zero,
                     end.accelerations if end.accelerations.size else zero), len(points) - 1, len(points)


@dataclass
class Parameters:
    """The controller's parameters of these names, with its defaults; tolerances for all joints alike."""

    joints: list
    open_loop_control: bool = False
    allow_partial_joints_goal: bool = False
    allow_nonzero_velocity_at_trajectory_end: bool = True
    velocity_state: bool = True
    cmd_timeout: float = 0.0
    goal_time: float = 0.0
    stopped_velocity_tolerance: float = 0.01
    trajectory: float = 0.0
    goal: float = 0.0


@dataclass(eq=False)
class Goal:
    """A goal of the action: what the controller has made of it."""

    message: Message
    status: str = 'accepted'        # executing, succeeded, canceled, aborted
    error: int = SUCCESSFUL
    text: str = ''


class JointTrajectoryController:
    """The controller with position commands; :meth:`update` is one turn of controller_manager's loop."""

    def __init__(self, parameters):
        self.parameters = parameters
        self.active = False
        self.command = np.full(len(parameters.joints), np.nan)      # the command interfaces; they outlive a restart
        self.log = []
        self.goal = None

    # --- lifecycle --------------------------------------------------------------------------------------------------

    def activate(self, position):
        """Hold where the joints stand, or at the last command where there has been one (positions only)."""
        parameters = self.parameters
        taken = self.command if np.all(np.isfinite(self.command)) and not parameters.velocity_state else position
        zero = np.zeros_like(self.command) if parameters.velocity_state else NONE
        self._current = Point(0, np.array(taken, dtype=float), zero)
        self._last_command = replace(self._current)
        self._trajectory, self._pending_goal, self.goal = Trajectory(), False, None
        self._tolerances = parameters.goal_time
        self._message = self._hold()
        self.active = True
        timeout = parameters.cmd_timeout
        self._timeout = timeout if timeout > parameters.goal_time else 0.0

    def deactivate(self):
        """Let go of the joints; an active goal is aborted."""
        if self.goal is not None:
            self._end('aborted', INVALID_GOAL, 'Current goal cancelled during deactivate transition.')
        self.active = False

    def _hold(self):
        self._holding = True
        return Message(0, list(self.parameters.joints), [Point(0, self._current.positions.copy())])

    # --- what comes in ----------------------------------------------------------------------------------------------

    def on_message(self, message, now):
        """A message of the topic; returns whether it is taken."""
        if not self._valid(message, now) or not self.active:
            return False
        self._message, self._holding = message, False
        return True

    def on_goal(self, message, now):
        """A goal of the action: a Goal, or None where it is rejected."""
        if not self.active or not self._valid(message, now):
            return None
        self._pending_goal = True
        if self.goal is not None:
            self._end('canceled', INVALID_GOAL, 'Current goal cancelled due to new incoming action.')
            self._pending_goal = True
        self._message, self._holding = message, False
        self.goal = Goal(message, 'executing')
        return self.goal

    def on_cancel(self, goal):
        """Cancel a goal: hold where the joints are."""
        if goal is self.goal and goal is not None:
            self._end('canceled', SUCCESSFUL, '')
            self._message = self._hold()

    def _end(self, status, error, text):
        goal, self.goal = self.goal, None
        goal.status, goal.error, goal.text = status, error, text
        self._pending_goal = False

    def _refuse(self, text):
        self.log.append(text)
        return False

    def _valid(self, message, now):
        parameters, points = self.parameters, message.points
        if not parameters.allow_partial_joints_goal and len(message.names) != len(parameters.joints):
            return self._refuse("Joints on incoming trajectory don't match the controller joints.")
        if not message.names:
            return self._refuse('Empty joint names on incoming trajectory.')
        if not points:
            return self._refuse('Empty trajectory received.')
        if message.stamp and message.stamp + points[-1].time < now:
            return self._refuse('Received trajectory with non-zero start time that ends in the past')
        if not set(message.names) <= set(parameters.joints):
            return self._refuse("Incoming joint doesn't match the controller's joints.")
        if not parameters.allow_nonzero_velocity_at_trajectory_end and np.any(np.abs(points[-1].velocities) > EPSILON):
            return self._refuse('Velocity of last trajectory point is not zero')
        if np.any(np.diff([point.time for point in points]) <= 0):
            return self._refuse('Time between points is not strictly increasing')
        count = len(message.names)
        for point in points:
            if point.positions.size != count or any(values.size not in (0, count) for values in (
                    point.velocities, point.accelerations)):
                return self._refuse('Mismatch between joint_names size and a field of a point.')
        return True

    def _localised(self, message):
        """All joints, in the controller's order; a joint that is not named holds its last command."""
        joints = self.parameters.joints
        if list(message.names) == list(joints):
            return message
        columns = [joints.index(name) for name in message.names]
        held = self.command if np.all(np.isfinite(self.command)) else self._current.positions

        def spread(values, fill):
            if not values.size:
                return values
            whole = np.array(fill, dtype=float)
            whole[columns] = values
            return whole
        zero = np.zeros(len(joints))
        message.names, message.points = list(joints), [
            Point(point.time, spread(point.positions, held), spread(point.velocities, zero),
                  spread(point.accelerations, zero)) for point in message.points]
        return message

    # --- the update -------------------------------------------------------------------------------------------------

    def update(self, time, position, velocity=None):
        """One update at ``time`` (ns) with the measured state; returns the commanded positions (NaN before any)."""
        if not self.active:
            return self.command
        parameters, trajectory = self.parameters, self._trajectory
        if self._message is not trajectory.message and not (self._pending_goal and self.goal is None):
            self._message = self._localised(self._message)
            trajectory.update(self._message)
        measured = NONE
        if parameters.velocity_state:
            measured = np.zeros(len(position)) if velocity is None else np.asarray(velocity, dtype=float)
        self._current = Point(0, np.array(position, dtype=float), measured)
        first = not trajectory.sampled
        if first:
            trajectory.set_point_before(time, self._last_command if parameters.open_loop_control else self._current)
        sampled = trajectory.sample(time)
        if sampled is None:
            return self.command
        desired, begin, end = sampled
        before_last = end != len(trajectory.message.points)
        late = (time - trajectory.start - trajectory.message.points[begin].time) / SECOND
        if not before_last and not self._holding and 0.0 < self._timeout < late:
            self.log.append('Aborted due to command timeout')
            self._message = self._hold()
        error = np.abs(desired.positions - self._current.positions)
        violated = outside = False
        in_time = True
        if not self._holding:
            violated = (before_last or first) and 0.0 < parameters.trajectory < error.max()
            # velocity errors exist with velocity command interfaces only
            outside = not before_last and 0.0 < parameters.goal < error.max()
            in_time = not (outside and 0.0 < parameters.goal_time < late)
        if not violated and in_time:
            self.command = desired.positions.copy()
            self._last_command = desired
        self._judge(violated, before_last, outside, in_time, late)
        return self.command

    def _judge(self, violated, before_last, outside, in_time, late):
        """What becomes of the goal, or of the motion where there is none."""
        if self.goal is not None:
            if violated:
                self._end('aborted', PATH_TOLERANCE_VIOLATED, 'Aborted due to path tolerance violation')
                self._message = self._hold()
            elif not before_last and not outside:
                self._end('succeeded', SUCCESSFUL, 'Goal successfully reached!')
                end = self._trajectory.message.points[-1]
                self._message, self._holding = Message(0, list(self.parameters.joints), [replace(end, time=0)]), True
            elif not before_last and not in_time:
                self._end('aborted', GOAL_TOLERANCE_VIOLATED,
                          f'Aborted due to goal_time_tolerance exceeding by {late:f} seconds')
                self._message = self._hold()
        elif not self._pending_goal and (violated or (not before_last and not in_time)):
            self.log.append('Holding position due to state tolerance violation' if violated else
                            'Exceeded goal_time_tolerance: holding position...')
            self._message = self._hold()
