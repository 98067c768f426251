"""Say what a model file or a motion file holds.

motion-style info MODEL.npz                kind, joints, rate, what it was trained on, its parameters
motion-style info walk.amc                 joints, rate, duration, gaps, range of every joint
motion-style info walk.amc --picture walk.png
"""
import importlib
import json

import numpy as np

from style_core.cli.registry import KIND_COMMANDS
from style_core.errors import ModelError
from style_core.formats import read_motion
from style_core.model_file import load_model

__all__ = ['add_arguments', 'run', 'describe_motion']


def add_arguments(parser, argv):
    """FILE and how to show it."""
    parser.add_argument('file', metavar='FILE', help='model file (.npz) or motion file of any known format')
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(args):
    """Print the description."""
    description = _describe_model(args.file) if args.file.endswith('.npz') else None
    if description is None:
        description = describe_motion(read_motion(args.file))
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
    for name, unit, values in zip(motion.joint_names, motion.units, (motion.positions * scale).T):
        there = values[~np.isnan(values)]
        low, high = (float(there.min()), float(there.max())) if there.size else (None, None)
        rows.append({'joint': name, 'min': low, 'max': high, 'unit': 'deg' if unit == 'rad' else 'm',
                     'missing_frames': int(np.isnan(values).sum())})
    return {'kind': 'motion', 'name': motion.name, 'frames': motion.n_frames,
            'rate_hz': motion.rate_hz if motion.n_frames > 1 else None,
            'duration_s': motion.duration_s, 'gaps_s': gaps, 'joints': rows}


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
        return f'{item:.6g}'
    if isinstance(item, (list, tuple)):
        return '-'.join(map(_shown, item))
    return '-' if item is None else str(item)
