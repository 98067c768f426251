"""Make motion from the styles of a locomotion model.

motion-style synthesize gaits.npz --blend walk -o walk.csv
motion-style synthesize gaits.npz --blend "0.3*run + 0.7*walk" --duration 10 -o jog.amc
motion-style synthesize gaits.npz --blend "walk @ 0; run @ 5" -o change.csv --picture change.png --skeleton 07.asf
    from walking to running in five seconds

Styles are called by their names (motion-style info gaits.npz) or numbers. Weights sum to one; a weight above one
exaggerates a style ("1.5*run - 0.5*walk").
"""
import numpy as np

from style_core.cli.answer import add_json, answer
from style_core.cli.exaggeration import add_exaggeration, check_far
from style_core.cli.files import add_output
from style_core.cli.number import Number, Positive
from style_core.errors import UsageError
from style_core.formats import write_motion
from style_core.locomotion.model import load
from style_core.locomotion.synthesis import parse_blend, synthesize

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """The blend and where to write it."""
    parser.add_argument(
        '--blend', required=True, metavar='BLEND', help='weights of the styles, e.g. "0.3*run + 0.7*walk"'
    )
    add_exaggeration(parser)
    parser.add_argument('--duration', action=Positive, most=3600, default=6.0, metavar='S', help='default: 6 s')
    parser.add_argument('--rate', action=Positive, metavar='HZ', help="of the motion (default: the model's)")
    parser.add_argument('--phase', action=Number, default=0.0, metavar='RAD', help='to start at (default: 0)')
    add_output(parser, '-o', '--output', metavar='FILE', help='motion file; the suffix says which format')
    add_output(parser, '--picture', what='picture', metavar='PNG',
               help='draw a strip of stick figures (needs --skeleton)')
    parser.add_argument('--skeleton', metavar='FILE', help='.asf, .bvh or .urdf file of the body')
    add_json(parser)


def run(args):
    """Synthesize, write, draw."""
    model = load(args.model)
    if not (args.output or args.picture):
        raise UsageError('say where to write (-o) or to draw (--picture)')
    if args.picture and not args.skeleton:
        raise UsageError('--picture needs --skeleton')
    blend = parse_blend(args.blend, model)
    styles = dict(zip(model.style_names, np.eye(model.n_styles)))
    for weights in blend.weights:
        check_far(styles, model.n_styles, weights, args.max_exaggeration, model.style_names)
    motion, _ = synthesize(model, blend, args.duration, args.rate, args.phase)
    if args.output:
        write_motion(motion, args.output)
    answer(args, {'output': args.output, 'frames': motion.n_frames, 'rate_hz': motion.rate_hz},
           f'{motion.n_frames} frames at {motion.rate_hz:g} Hz')
    if args.picture:
        from style_core.pictures import save, stick_strip
        from style_core.skeleton import read_skeleton
        save(stick_strip(read_skeleton(args.skeleton), [(args.blend, motion)], count=12), args.picture)
