"""Blend two motions of the same action in space and time.

motion-style blend slow_walk.amc run.amc --alpha 0.3 -o jog.csv

Alpha 0 returns the first motion, 1 the second; values from -0.25 to 1.25 go a little beyond them. Both are aligned by
dynamic time warping, so they need not have the same length or timing.
"""
from style_core.cli.answer import add_json, answer
from style_core.cli.files import add_output
from style_core.cli.number import Number
from style_core.cli.recordings import add_recorded_rate, read_recording
from style_core.effort import interpolate_motions
from style_core.formats import write_motion
from style_core.skeleton import read_skeleton

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """Two motions and alpha."""
    parser.add_argument('first', metavar='FIRST', help='motion file')
    parser.add_argument('second', metavar='SECOND', help='motion file with the same joints')
    parser.add_argument('--alpha', action=Number, required=True, metavar='-0.25..1.25',
                        help='share of the second motion')
    add_output(parser, '-o', '--output', required=True, metavar='OUT', help='motion file to write, any format')
    parser.add_argument('--skeleton', metavar='FILE', help='needed for AMC output')
    add_recorded_rate(parser)
    add_json(parser)


def run(args):
    """Read, blend, write."""
    skeleton = read_skeleton(args.skeleton) if args.skeleton else None
    first, second = (read_recording(path, args.recorded_rate, args.unit, skeleton=skeleton)
                     for path in (args.first, args.second))
    motion = interpolate_motions(first, second, args.alpha)
    write_motion(motion, args.output, skeleton=skeleton)
    answer(args, {'output': args.output, 'duration_s': motion.duration_s, 'first_s': first.duration_s,
                  'second_s': second.duration_s},
           f'{motion.duration_s:.2f} s from {first.duration_s:.2f} s and {second.duration_s:.2f} s')
