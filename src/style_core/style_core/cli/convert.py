"""Convert a recording to another format.

The suffix says the format: .amc .bvh .csv .npz .mcap; --storage says that a name without suffix is meant to be a ROS 2
bag (a folder).

  motion-style convert walk.amc walk.csv                  angles in radians, lengths in metres
  motion-style convert walk.amc walk.bvh                  with the skeleton from the .asf file beside it
  motion-style convert walk.amc walk_bag --storage sqlite3 --rate 100     a bag of joint states at 100 Hz
  motion-style convert my_bag legs.csv --select '*leg*' --select '!*toe*' --start 10 --stop 20
  motion-style convert walk.csv walk.bvh --skeleton walk.asf
  motion-style convert walk.amc mirrored.amc --mirror

What a format cannot hold is refused with the reason (missing values in BVH or AMC, for example); an existing file is
replaced only by a complete new one.
"""
import argparse
from pathlib import Path

import numpy as np

from style_core.cli.answer import add_json, answer
from style_core.cli.files import add_output
from style_core.cli.number import Number, Positive
from style_core.cli.recordings import add_joints_of, add_recorded_rate, read_recording
from style_core.formats import skeleton_of, write_motion
from style_core.skeleton import read_skeleton

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """IN, OUT and what to do in between."""
    parser.add_argument('input', metavar='IN', help='file, or folder of a bag')
    add_output(parser, 'output', metavar='OUT', help='file, or folder of a bag')
    parser.add_argument('--rate', action=Positive, metavar='HZ',
                        help='resample; never beyond the last frame or over gaps')
    parser.add_argument('--select', action='append', default=[], metavar='PATTERN',
                        help="joints to keep, e.g. 'l*.rx'; '!PATTERN' leaves out; may be given several times")
    parser.add_argument('--start', action=Number, metavar='S', help='leave out what is before this time (s)')
    parser.add_argument('--stop', action=Number, metavar='S', help='leave out what is from this time on (s)')
    parser.add_argument('--mirror', action='store_true', help='exchange left and right')
    parser.add_argument('--continuous', action='store_true',
                        help='unwrap angles and choose among equivalent Euler triples so that nothing jumps')
    parser.add_argument('--skeleton', metavar='FILE', help='.asf, .bvh or .urdf file; the one that belongs to IN if '
                                                           'left out')
    add_recorded_rate(parser)
    add_joints_of(parser)
    parser.add_argument('--input-rate', dest='recorded_rate', action=Positive, help=argparse.SUPPRESS)
    parser.add_argument('--length-unit', action=Positive, metavar='M',
                        help='length unit of BVH files in metres (0.01 if left out)')
    parser.add_argument('--topic', metavar='T', help='topic of a bag (/joint_states if left out)')
    add_json(parser)
    parser.add_argument('--storage', choices=('sqlite3', 'mcap'), help='write a bag, a folder, stored so')


def run(args):
    """Read, change, write."""
    if args.skeleton:
        skeleton = read_skeleton(args.skeleton, args.length_unit if args.skeleton.lower().endswith('.bvh') else None)
    else:
        skeleton = skeleton_of(args.input, args.length_unit)
    motion = read_recording(args.input, None, args.unit, skeleton=skeleton, start_s=args.start, stop_s=args.stop,
                            rate_hz=args.recorded_rate, joints_of=args.joints_of, as_filed=not args.continuous,
                            **_where(args.input, args))
    if args.mirror:
        motion = motion.mirror(skeleton)
    if args.select:
        motion = motion.select(*args.select)
    if args.rate is not None:
        motion = motion.resample(args.rate)
    write_motion(motion, args.output, skeleton, storage=args.storage, **_where(args.output, args))
    missing = int(np.isnan(motion.positions).sum())
    course = f'{motion.rate_hz:g} Hz, {motion.duration_s:.6g} s' if motion.n_frames > 1 else 'a single pose'
    answer(args, {'output': args.output, 'frames': motion.n_frames, 'joints': motion.n_joints,
                  'rate_hz': motion.rate_hz if motion.n_frames > 1 else None,
                  'duration_s': motion.duration_s if motion.n_frames > 1 else 0.0, 'missing': missing},
           f'{motion.n_frames} frames, {motion.n_joints} joints, {course}'
           + (f', {missing} values missing' if missing else ''))


def _where(path, args):
    """Options that concern one side only."""
    if path.lower().endswith('.bvh'):
        return {'length_m': args.length_unit}
    if Path(path).is_dir() or Path(path).suffix.lower() in ('.mcap', '.db3', '.bag', ''):
        return {'topic': args.topic}
    return {}
