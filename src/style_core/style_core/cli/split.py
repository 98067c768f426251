"""Part a table of many recordings into one file each.

A table of LocoHub (.csv or .parquet) holds the strides of many people and tasks. Each subject, task and task_id becomes
OUT/SUBJECT/TASK_ID.npz, from which models are trained:

  motion-style split strides.parquet -o parted
  motion-style train phase-style parted/*/level*.npz --person folder -o walker.npz

How long a stride lasts follows from the table's angular velocities, or is said with --stride.
"""
import re
from pathlib import Path

from style_core.cli.number import Positive
from style_core.errors import UsageError
from style_core.formats import write_motion
from style_core.recordings import read_recordings

__all__ = ['add_arguments', 'run']

_UNFIT = re.compile(r'[^\w+.-]|^\.+')


def add_arguments(parser, argv):
    """TABLE, the folder, and how long a stride is."""
    parser.add_argument('table', metavar='TABLE', help='.csv or .parquet file of LocoHub')
    parser.add_argument('-o', '--output', metavar='OUT', required=True, help='folder, made where it is not there')
    parser.add_argument('--stride', action=Positive, metavar='S',
                        help='duration of a stride (default: from the angular velocities of the table)')
    parser.add_argument('--force', action='store_true', help='replace files that are there')


def run(args):
    """Read, part, write."""
    motions = read_recordings(args.table, args.stride)
    folder, files = Path(args.output), {}
    for motion in motions:
        subject, _, task = motion.name.partition('/')
        path = folder / _UNFIT.sub('_', subject) / f'{_UNFIT.sub("_", task)}.npz'
        if path in files:
            raise UsageError(f'{motion.name} and {files[path].name} would both be written to {path}')
        if path.exists() and not args.force:
            raise UsageError(f'{path} is there: give another folder, or --force')
        files[path] = motion
    for path, motion in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_motion(motion.replace(name=path.stem), path)
    people = len({path.parent for path in files})
    print(f'{folder}: {len(files)} recordings of {people} {"person" if people == 1 else "people"}, '
          f'{sum(motion.n_frames for motion in motions)} frames')
