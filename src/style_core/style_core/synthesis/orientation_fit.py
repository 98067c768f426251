"""Compute how a person's joints move a robot's: least-squares matching of orientations over recordings.

A match says which direction of a robot link should point where which direction of a human body part points, both seen
from a base (pelvis or chest). Joint angles that match best in every frame show what the robot's axes can do at all; a
linear map from the recording's joints to the robot's is what remains when no frame may be looked up.
"""
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Mapping, Tuple

import numpy as np

from style_core.errors import ModelError, MotionError
from style_core.motion import Motion, matching_names
from style_core.skeleton import Skeleton, read_skeleton
from style_core.synthesis.retargeting import Robot, RobotJoint
from style_core.yaml_file import read_yaml

__all__ = ['Match', 'Plan', 'read_plan', 'directions_of', 'best_angles', 'fit_map', 'error_deg']

_ITERATIONS = 25
#: ridge on gains, in units of the summed squared residual of one frame a radian off
_RIDGE = 1e-3


@dataclass(frozen=True)
class Match:
    """One pair of directions.

    Attributes
    ----------
    link : str
        Of the robot.
    along : tuple of three float
        Direction in the link.
    body : str
        Of the recording's skeleton.
    to : str
        ``bone`` (the body's own bone), ``forward``, ``left``, ``up`` (as the body stands at rest), or the name of a
        rotation channel, whose axis is meant.
    base : str
        Body from which the direction is seen; the robot's root link stands for it.
    weight : float
    """

    link: str
    along: Tuple[float, float, float]
    body: str
    to: str = 'bone'
    base: str = 'root'
    weight: float = 1.0


@dataclass(frozen=True, eq=False)
class Plan:
    """What to match, on which robot, from which channels.

    Attributes
    ----------
    name, urdf : str
    robot : Skeleton
    matches : tuple of Match
    inputs : mapping of str to tuple of str
        Pattern of robot joints -> patterns of the channels that may move them.
    motors : mapping of str to mapping
        Pattern of robot joints -> ``velocity`` (rad/s) and ``acceleration`` (rad/s^2) of their motors.
    """

    name: str
    urdf: str
    robot: Skeleton
    matches: Tuple[Match, ...]
    inputs: Mapping[str, Tuple[str, ...]]
    motors: Mapping[str, Mapping[str, float]]

    def channels(self, joint, names):
        """Channels among ``names`` that move a robot joint."""
        return matching_names(names, _first_match(self.inputs, joint, ()))

    def motor(self, joint):
        """What the motor of a joint can do: ``velocity`` and ``acceleration`` where known."""
        return _first_match(self.motors, joint, {})


def _first_match(entries, joint, otherwise):
    return next((entry for pattern, entry in entries.items() if fnmatchcase(joint, pattern)), otherwise)


def read_plan(path):
    """Read a plan from YAML: ``name``, ``urdf`` (beside it), ``match`` (a list of mappings), ``inputs``, ``motors``.

    Raises
    ------
    ModelError
        If the file cannot be read or does not have this form.
    """
    path = Path(path)
    try:
        content = read_yaml(path, 'plan')
        if not isinstance(content, dict):
            raise ModelError(f'{path} is no plan of what to match: it must have the keys name, urdf, match and inputs')
        robot = read_skeleton(path.parent / content['urdf'])
        matches = tuple(Match(one['link'], tuple(float(x) for x in one['along']), one['body'], one.get('to', 'bone'),
                              one.get('base', 'root'), float(one.get('weight', 1.0))) for one in content['match'])
        inputs = {str(joint): tuple(channels) for joint, channels in content['inputs'].items()}
        motors = {str(joint): {key: float(motor[key]) for key in motor}
                  for joint, motor in content.get('motors', {}).items()}
        plan = Plan(str(content['name']), str(content['urdf']), robot, matches, inputs, motors)
    except (ModelError, MotionError):
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ModelError(f'{path} is no plan of what to match: {error!r}') from None
    if not all(set(motor) <= {'velocity', 'acceleration'} for motor in motors.values()):
        raise ModelError(f'{path}: motors have velocity and acceleration, and nothing else')
    unknown = [match.link for match in matches if match.link not in robot.body_names]
    if unknown:
        raise ModelError(f'{path}: the robot has no link {unknown[0]}')
    return plan


def _rest_direction(skeleton, match):
    """The match's direction on the human body at rest, in the world, shape (3,)."""
    compass = {'y': {'forward': (0, 0, 1), 'left': (1, 0, 0), 'up': (0, 1, 0)},
               'z': {'forward': (1, 0, 0), 'left': (0, 1, 0), 'up': (0, 0, 1)}}[skeleton.up]
    if match.to in compass:
        return np.array(compass[match.to], dtype=float)
    if match.to == 'bone':
        index = skeleton.body_names.index(match.body)
        places = skeleton.rest()[0]
        bone = places[index] - places[skeleton.parents[index]]
        return bone / np.linalg.norm(bone)
    axes = skeleton.rest_axes()
    if match.to not in axes or axes[match.to][0] != 'r':
        raise ModelError(f'{match.to} is neither bone, forward, left, up nor a rotation channel of the skeleton')
    return axes[match.to][1]


def directions_of(plan, motion, skeleton):
    """Where the matched directions of a person point, shape (T, M, 3), in the robot's axes (x forward, z up)."""
    names = skeleton.body_names
    unknown = sorted({part for match in plan.matches for part in (match.body, match.base)} - set(names))
    if unknown:
        raise MotionError(f'the skeleton has no body {", ".join(unknown)}')
    _, rest = skeleton.rest()
    known = [name for name in motion.joint_names if name in skeleton.channel_names]
    turns = skeleton.poses(motion.joints(known))[1]
    # y up: forward z, left x
    to_robot = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], dtype=float) if skeleton.up == 'y' else np.eye(3)
    result = []
    for match in plan.matches:
        body, base = names.index(match.body), names.index(match.base)
        # rotations since rest; a rotation channel's axis belongs to the parent's frame of its joint
        turn = turns[:, body] @ rest[body].T
        seen = np.swapaxes(turns[:, base] @ rest[base].T, -1, -2) @ turn
        result.append(seen @ _rest_direction(skeleton, match) @ to_robot.T)
    return np.stack(result, axis=1)


def _reach(plan, angles):
    """Directions of the robot's links, shape (T, M, 3), and their derivatives by the joints, (T, M, 3, J)."""
    robot = plan.robot
    motion = Motion(robot.channel_names, angles, np.arange(len(angles), dtype=float))
    turns = robot.poses(motion)[1]
    index = {name: k for k, name in enumerate(robot.body_names)}
    column = {name: k for k, name in enumerate(robot.channel_names)}
    directions = np.stack([turns[:, index[match.link]] @ np.array(match.along) for match in plan.matches], axis=1)
    slopes = np.zeros(directions.shape + (len(column),))
    for m, match in enumerate(plan.matches):
        link = index[match.link]
        while link >= 0:
            for channel in robot.bodies[link].channels:
                axis = turns[:, link] @ np.array(channel.axis)
                slopes[:, m, :, column[channel.name]] = np.cross(axis, directions[:, m]) * channel.scale
            link = robot.bodies[link].parent
    return directions, slopes


def _residuals(plan, angles, targets):
    """Weighted residuals, shape (T, 3 M), and their derivatives, (T, 3 M, J)."""
    directions, slopes = _reach(plan, angles)
    weight = np.sqrt([match.weight for match in plan.matches])[:, None]
    count = len(angles)
    return ((weight * (directions - targets)).reshape(count, -1),
            (weight[..., None] * slopes).reshape(count, -1, angles.shape[1]))


def best_angles(plan, targets):
    """Robot angles that match best in every frame by itself, shape (T, J), within the limits of the joints.

    Levenberg-Marquardt, all frames at once; each frame keeps its own damping.
    """
    low, high = plan.robot.limits(plan.robot.channel_names)
    joints = len(low)
    angles = np.zeros((len(targets), joints))
    angles = np.clip(angles, low, high)
    damping = np.full(len(targets), 1e-1)
    residual, slope = _residuals(plan, angles, targets)
    for _ in range(_ITERATIONS):
        normal = np.swapaxes(slope, 1, 2) @ slope + damping[:, None, None] * np.eye(joints)
        step = np.linalg.solve(normal, np.einsum('trj,tr->tj', slope, residual)[..., None])[..., 0]
        tried = np.clip(angles - step, low, high)
        new_residual, new_slope = _residuals(plan, tried, targets)
        better = np.sum(new_residual**2, axis=1) < np.sum(residual**2, axis=1)
        angles[better], residual[better], slope[better] = tried[better], new_residual[better], new_slope[better]
        damping = np.where(better, damping * 0.3, damping * 4.0)
    return angles


def fit_map(plan, motions, targets):
    """The linear map with the least orientation error.

    Parameters
    ----------
    plan : Plan
    motions : sequence of Motion
    targets : sequence of ndarray, shape (T, M, 3)
        `directions_of` each.

    Returns
    -------
    Robot
    """
    names = motions[0].joint_names
    angles = np.concatenate([best_angles(plan, one) for one in targets])
    poses = np.concatenate([motion.joints(names).positions for motion in motions])
    wanted = np.concatenate(targets)
    joints = plan.robot.channel_names
    columns = [[names.index(channel) for channel in plan.channels(joint, names)] for joint in joints]
    inputs = [np.concatenate([poses[:, own], np.ones((len(poses), 1))], axis=1) for own in columns]
    # start from a regression of the best angles, then improve what counts: the directions
    theta = np.concatenate([_regress(x, angles[:, j]) for j, x in enumerate(inputs)])
    ends = np.cumsum([x.shape[1] for x in inputs])
    starts = ends - [x.shape[1] for x in inputs]
    ridge = np.ones(len(theta)) * _RIDGE * len(poses)
    ridge[ends - 1] = 1e-6

    def evaluate(theta):
        q = np.stack([x @ theta[a:b] for x, a, b in zip(inputs, starts, ends)], axis=1)
        residual, slope = _residuals(plan, q, wanted)
        return residual, slope, np.sum(residual**2) + ridge @ theta**2

    damping, (residual, slope, cost) = 1e-3, evaluate(theta)
    for _ in range(_ITERATIONS):
        normal, gradient = np.diag(ridge), ridge * theta
        for part in np.array_split(np.arange(len(poses)), max(1, len(poses) // 500)):
            wide = np.concatenate([slope[part, :, j, None] * inputs[j][part, None, :] for j in range(len(joints))],
                                  axis=2).reshape(-1, len(theta))
            normal += wide.T @ wide
            gradient += wide.T @ residual[part].reshape(-1)
        tried = theta - np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
        new = evaluate(tried)
        if new[2] < cost:
            done = cost - new[2] < 1e-6 * cost
            theta, (residual, slope, cost), damping = tried, new, damping * 0.3
            if done:
                break
        else:
            damping *= 5.0
    low, high = plan.robot.limits(joints)
    return Robot(plan.name, {
        joint: RobotJoint({names[c]: float(g) for c, g in zip(columns[j], theta[starts[j]:])},
                          float(theta[ends[j] - 1]),
                          (float(low[j]), float(high[j])) if np.isfinite(low[j] + high[j]) else None,
                          **plan.motor(joint))
        for j, joint in enumerate(joints)}, plan.urdf)


def _regress(x, y):
    normal = x.T @ x + np.diag([_RIDGE * len(x)] * (x.shape[1] - 1) + [1e-9])
    return np.linalg.solve(normal, x.T @ y)


def error_deg(plan, angles, targets):
    """Angles between matched directions, shape (T, M), in degrees, for robot angles (T, J)."""
    directions = _reach(plan, angles)[0]
    sine = np.linalg.norm(np.cross(directions, targets), axis=-1)
    return np.degrees(np.arctan2(sine, np.sum(directions * targets, axis=-1)))
