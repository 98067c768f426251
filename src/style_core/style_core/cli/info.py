"""Say what a model file or a motion file holds.

motion-style info MODEL.npz                kind, joints, rate, what it was trained on, its parameters
motion-style info walk.amc                 joints, rate, duration, gaps; range and greatest speed of every joint
motion-style info walk.amc --picture walk.png --select '*femur*' --select '*tibia*'
motion-style info my_bag --topic /leg_states

The picture shows stick figures where a skeleton is known, and the course of the joints.
"""
import argparse
import importlib
import json

import numpy as np

from style_core.cli.files import add_output, say_written
from style_core.cli.number import Positive
from style_core.cli.recordings import add_joints_of, add_recorded_rate, read_recording
from style_core.cli.registry import KIND_COMMANDS
from style_core.errors import ModelError, UsageError
from style_core.formats import read_motion, skeleton_of
from style_core.model_file import load_model
from style_core.places import find_file

__all__ = ['add_arguments', 'run', 'describe_motion']

#: joints in a picture at most, those that move most
_CURVES = 16


def add_arguments(parser, argv):
    """FILE and how to show it."""
    parser.add_argument('file', metavar='FILE', help='model file (.npz), motion file of any known format, or bag')
    parser.add_argument('--json', action='store_true', help='print one JSON object')
    add_output(parser, '--picture', what='picture', metavar='PNG',
               help='draw the motion (.png, .pdf or .svg; a second file with '
                                                         '_pose in its name if a skeleton is known)')
    parser.add_argument('--select', action='append', default=[], metavar='PATTERN',
                        help="joints of a motion to show, e.g. 'l*'; '!PATTERN' leaves out")
    parser.add_argument('--skeleton', metavar='FILE', help='.asf, .bvh or .urdf file for the picture')
    add_recorded_rate(parser)
    add_joints_of(parser)
    parser.add_argument('--input-rate', dest='recorded_rate', action=Positive, help=argparse.SUPPRESS)
    parser.add_argument('--topic', metavar='T', help='topic of a bag')


def run(args):
    """Print the description and draw the picture."""
    if args.file.endswith('.npz'):
        args.file = find_file(args.file, 'model')
    description = _describe_model(args.file) if args.file.endswith('.npz') else None
    if description is not None:
        if args.picture or args.select:
            raise UsageError('--picture and --select are for motion files; this is a model')
    else:
        motion = read_recording(args.file, None, args.unit, as_filed=True, topic=args.topic, rate_hz=args.recorded_rate,
                                joints_of=args.joints_of)
        shown = motion.select(*args.select) if args.select else motion
        description = describe_motion(shown)
        if args.picture:
            _draw(args, motion, shown)
    if args.json:
        print(json.dumps(description, indent=1))
    else:
        for line in _lines(description):
            print(line)


def describe_motion(motion):
    """Facts about a motion as a dict of plain values; angles in degrees."""
    steps = np.diff(motion.times)
    gaps = [(float(motion.times[k]), float(motion.times[k + 1]))
            for k in np.flatnonzero(steps > 3 / motion.rate_hz)] if motion.n_frames > 1 else []
    scale = np.array([180 / np.pi if unit == 'rad' else 1.0 for unit in motion.units])
    rows = []
    for name, unit, values, speeds in zip(motion.joint_names, motion.units, (motion.positions * scale).T,
                                          np.abs(motion.velocities() * scale).T):
        there, moving = values[~np.isnan(values)], speeds[~np.isnan(speeds)]
        rows.append({'joint': name, 'min': float(there.min()) if there.size else None,
                     'max': float(there.max()) if there.size else None, 'unit': 'deg' if unit == 'rad' else 'm',
                     'fastest_per_s': float(moving.max()) if moving.size else None,
                     'missing_frames': int(np.isnan(values).sum())})
    return {'kind': 'motion', 'name': motion.name, 'frames': motion.n_frames,
            'rate_hz': motion.rate_hz if motion.n_frames > 1 else None,
            'duration_s': motion.duration_s, 'gaps_s': gaps, 'joints': rows}


def _draw(args, motion, shown):
    from pathlib import Path

    from style_core import pictures
    from style_core.skeleton import read_skeleton
    picture = Path(args.picture)
    skeleton = read_skeleton(args.skeleton) if args.skeleton else skeleton_of(args.file)
    angles = [name for name, unit in zip(shown.joint_names, shown.units) if unit == 'rad']
    part = shown.joints(angles) if angles else shown
    with np.errstate(invalid='ignore'):
        spread = np.nan_to_num(np.nanmax(part.positions, axis=0) - np.nanmin(part.positions, axis=0))
    most = np.sort(np.argsort(-spread, kind='stable')[:_CURVES])
    part = part.joints([part.joint_names[index] for index in most])
    title = f'{motion.name}: {motion.rate_hz:g} Hz, {motion.duration_s:.3g} s'
    recorded = [pictures.Line('recorded', part.times, part.positions)]
    pictures.save(pictures.joint_curves(part.joint_names, recorded, title,
                                        unit='deg' if angles else 'm'), picture)
    if skeleton is not None:
        pose = picture.with_name(f'{picture.stem}_pose{picture.suffix}')
        pictures.save(pictures.stick_strip(skeleton, [(title, motion)]), pose)
        say_written(pose, args)


def _describe_model(path):
    """Description of a model file, None for an .npz file that is a motion."""
    try:
        header, arrays = load_model(path)
    except ModelError:
        try:
            read_motion(path)
        except ValueError:
            pass
        else:
            return None
        raise
    kind = KIND_COMMANDS['info'].get(header['kind'])
    if kind is not None:
        header = dict(header, **importlib.import_module(kind).describe(header, arrays))
    return header


def _lines(value, indent=''):
    for key, item in value.items():
        if isinstance(item, dict):
            yield f'{indent}{key}:'
            yield from _lines(item, indent + '  ')
        elif isinstance(item, list) and item and isinstance(item[0], dict):
            yield f'{indent}{key}:'
            columns = list(item[0])
            cells = [columns] + [[_shown(row.get(column)) for column in columns] for row in item]
            widths = [max(len(row[k]) for row in cells) for k in range(len(columns))]
            for row in cells:
                yield f'{indent}  ' + '  '.join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip()
        elif isinstance(item, list):
            yield f'{indent}{key}: {", ".join(map(_shown, item)) or "none"}'
        else:
            yield f'{indent}{key}: {_shown(item)}'


def _shown(item):
    if isinstance(item, float):
        return f'{item + 0.0:.6g}'     # no -0
    if isinstance(item, (list, tuple)):
        return ' '.join(map(_shown, item))
    return '-' if item is None else str(item)
