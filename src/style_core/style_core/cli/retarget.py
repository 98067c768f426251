"""Compute how a person's joints move a robot's, by matching orientations over recordings.

PLAN says which direction of which robot link should point like which part of a person (config/robots/*_plan.yaml).
The map found is linear: every robot joint is a combination of channels. The table shows the angle between matched
directions for this map, and, as the least that the robot's axes allow, for angles found anew in every frame.

  motion-style retarget config/robots/humanoid20_plan.yaml 07_01.amc 09_01.amc --test 35_01.amc -o humanoid20.yaml
"""
import json

import numpy as np

from style_core.cli.files import add_input, add_output
from style_core.cli.number import Positive
from style_core.cli.recordings import read_recording
from style_core.datasets import BODY
from style_core.errors import UsageError
from style_core.formats import skeleton_of
from style_core.synthesis.orientation_fit import best_angles, directions_of, error_deg, fit_map, read_plan
from style_core.synthesis.retargeting import write_robot

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """PLAN, recordings, where to write."""
    add_input(parser, 'plan', what='robot', metavar='PLAN', help='YAML file of what to match')
    parser.add_argument('recordings', nargs='+', metavar='FILE', help='recordings with a skeleton (AMC, BVH)')
    parser.add_argument('--test', action='append', default=[], metavar='FILE',
                        help='recording to measure the error on that the map is not fitted to (several times)')
    parser.add_argument('--rate', action=Positive, default=20.0, metavar='HZ',
                        help='frames used (default: 20 a second)')
    parser.add_argument('--json', action='store_true', help='print the errors for machines')
    add_output(parser, '-o', '--output', what='robot', metavar='FILE', help='robot file (.yaml) to write')


def _read(path, rate_hz, mirror):
    skeleton = skeleton_of(path)
    if skeleton is None:
        raise UsageError(f'{path} has no skeleton: orientations cannot be matched')
    motion = read_recording(path, skeleton=skeleton).resample(rate_hz)
    both = [motion, motion.mirror(skeleton)] if mirror else [motion]
    return [(one.select(*BODY), skeleton) for one in both]


def run(args):
    """Fit, measure, write."""
    plan = read_plan(args.plan)
    # with its mirror image every recording counts for both sides
    fitted = [pair for path in args.recordings for pair in _read(path, args.rate, True)]
    tested = [pair for path in args.test for pair in _read(path, args.rate, False)]
    targets = [directions_of(plan, *pair) for pair in fitted]
    robot = fit_map(plan, [motion for motion, _ in fitted], targets)
    rows = {}
    for title, pairs, wanted in (('fit', fitted, targets), ('test', tested, [directions_of(plan, *p) for p in tested])):
        if pairs:
            rows[title] = _errors(plan, robot, pairs, wanted)
    if args.output:
        lines = [f'Joints of {plan.name} as combinations of the channels of the CMU skeleton (rad).',
                 'Computed by motion-style retarget; see docs/retargeting.md. Mean angle between matched directions:']
        lines += [f'{title}: {np.mean([row["map"] for row in table.values()]):.1f} degrees, of which the axes of the '
                  f'robot alone: {np.mean([row["axes"] for row in table.values()]):.1f}'
                  for title, table in rows.items()]
        write_robot(robot, args.output, '\n'.join(lines))
    if args.json:
        print(json.dumps(rows, indent=1))
        return
    for title, table in rows.items():
        print(f'{title}: degrees between matched directions, mean (95 %)')
        print(f'  {"direction":34}{"linear map":>16}{"best angles":>16}')
        for name, row in table.items():
            print(f'  {name:34}{row["map"]:9.1f} ({row["map_95"]:4.1f}){row["axes"]:9.1f} ({row["axes_95"]:4.1f})')


def _errors(plan, robot, pairs, wanted):
    by_map, by_axes = [], []
    for (motion, _), target in zip(pairs, wanted):
        bound = robot.bind(motion.joint_names)
        angles, _ = bound.limit(*bound.combine(motion.positions, np.zeros_like(motion.positions)))
        by_map.append(error_deg(plan, angles, target))
        by_axes.append(error_deg(plan, best_angles(plan, target), target))
    by_map, by_axes = np.concatenate(by_map), np.concatenate(by_axes)
    return {f'{match.link}, {match.body} {match.to}': {
        'map': float(by_map[:, m].mean()), 'map_95': float(np.percentile(by_map[:, m], 95)),
        'axes': float(by_axes[:, m].mean()), 'axes_95': float(np.percentile(by_axes[:, m], 95))}
        for m, match in enumerate(plan.matches)}
