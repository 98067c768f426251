"""Restyle a recording: freer or more bound, stronger or lighter, more sudden or more sustained.

motion-style effort walk.amc --library steps_effort.npz --flow 2 --weight -1 -o restyled.csv
    Flow 2 (free), Weight -1 (rather light), Time as it comes
motion-style effort walk.amc --library steps_effort.npz --time 3 -o restyled.amc --skeleton 08.asf --picture strip.png

The recording is cut into pieces that match the fragments of the library (motion-style train effort); each piece is
replaced by the blend of two like fragments whose effort is nearest to what was asked. Efforts range from -3 to 3.
"""
import json

import numpy as np

from style_core.cli.files import add_input, add_output
from style_core.cli.number import Count, Number
from style_core.cli.recordings import add_recorded_rate, read_recording
from style_core.effort import EFFORTS, load, restyle
from style_core.errors import UsageError
from style_core.formats import write_motion
from style_core.skeleton import read_skeleton

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """The recording, the efforts, the library."""
    parser.add_argument('file', metavar='FILE', help='recording to restyle')
    add_input(parser, '--library', required=True, metavar='LIBRARY.npz', help='from motion-style train effort')
    parser.add_argument('--flow', action=Number, metavar='-3..3', help='free (3) or bound (-3)')
    parser.add_argument('--weight', action=Number, metavar='-3..3', help='strong (3) or light (-3)')
    parser.add_argument('--time', action=Number, metavar='-3..3', help='sudden (3) or sustained (-3)')
    add_output(parser, '-o', '--output', required=True, metavar='OUT', help='motion file to write, any format')
    parser.add_argument('--neighbours', action=Count, least=2, default=6, metavar='K',
                        help='like fragments to try (default: 6)')
    parser.add_argument('--skeleton', metavar='FILE', help='needed for AMC output and for --picture')
    add_output(parser, '--picture', what='picture', metavar='PNG',
               help='draw the recording and the result as stick figures')
    add_recorded_rate(parser)
    parser.add_argument('--json', action='store_true', help='print what was chosen as JSON')


def run(args):
    """Restyle, write, say what was done."""
    target = np.array([np.nan if value is None else value for value in (args.flow, args.weight, args.time)])
    if args.picture and not args.skeleton:
        raise UsageError('--picture needs --skeleton')
    library = load(args.library)
    skeleton = read_skeleton(args.skeleton) if args.skeleton else None
    motion = read_recording(args.file, None, args.unit, skeleton=skeleton, rate_hz=args.recorded_rate)
    motion = motion.replace(name=args.file)
    result = restyle(library, motion, target, args.neighbours)
    write_motion(result.motion, args.output, skeleton=skeleton)
    kind = 'measured' if library.labeller == 'computed' else 'predicted'
    choices = [{'from_s': choice.segment.start / library.rate_hz, 'to_s': choice.segment.stop / library.rate_hz,
                'matches': library.names[choice.segment.fragment], 'first': library.names[choice.blend.first],
                'second': library.names[choice.blend.second], 'alpha': choice.blend.alpha, 'distance': distance,
                **{f'{kind}_{name}': float(value) for name, value in zip(EFFORTS, choice.effort)}}
               for choice, distance in zip(result.choices, result.distances)]
    if args.picture:
        from style_core.pictures import save, stick_strip
        save(stick_strip(skeleton, [('recorded', motion), ('restyled', result.motion)]), args.picture)
    if args.json:
        print(json.dumps({'output': args.output, 'labels': library.labeller, 'threshold': library.threshold,
                          'pieces': choices}, indent=1))
        return
    print(f'{"from":>7} {"to":>7}  {"matches":<20} {"blend":<44} {kind} ' + ' '.join(EFFORTS))
    for choice in choices:
        blend = f'{choice["first"]} ~ {choice["second"]} @ {choice["alpha"]:.2f}'
        print(f'{choice["from_s"]:6.2f}s {choice["to_s"]:6.2f}s  {choice["matches"]:<20} {blend:<44} '
              + ' '.join(f'{choice[f"{kind}_{name}"]:+.2f}' for name in EFFORTS))
    unlike = [choice for choice in choices if choice['distance'] > library.threshold]
    if unlike:
        print(f'{len(unlike)} of {len(choices)} pieces are unlike every fragment (the first at '
              f'{unlike[0]["from_s"]:.2f} s): their content is not in the library')
    print(f'{result.motion.duration_s:.2f} s, was {motion.duration_s:.2f} s')
