"""Collect a person's effort labels for the fragments and blends of a library.

motion-style label steps_effort.npz --skeleton 08.asf -o labels.csv --labeller anna

Every fragment, and every blend of fragments that the library learns from, is drawn as a strip of stick figures (joint
curves without a skeleton); you look at the picture and type flow, weight and time, each from -3 to 3. Each answer is
saved at once; run the command again to go on where you stopped. Then train again with --labels labels.csv and the same
--seed.
"""
from pathlib import Path

from style_core.cli.files import add_input, add_output, say_written
from style_core.effort import load
from style_core.effort.labels import append_label, labelled
from style_core.pictures import Line, joint_curves, save, stick_strip
from style_core.progress import progress
from style_core.skeleton import read_skeleton

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """The library, the label file, who labels."""
    add_input(parser, 'library', metavar='LIBRARY.npz', help='from motion-style train effort')
    add_output(parser, '-o', '--output', what='table', required=True, metavar='CSV',
               help='label file; rows are added to it')
    parser.add_argument('--labeller', required=True, metavar='NAME', help='who gives the labels')
    parser.add_argument('--skeleton', metavar='FILE', help='.asf, .bvh or .urdf to draw stick figures with')
    parser.add_argument('--pictures', default='out/labels', metavar='FOLDER',
                        help='where pictures go (default: out/labels)')
    parser.add_argument('--only-draw', action='store_true', help='make the pictures and ask nothing')


def run(args):
    """Draw and ask."""
    library = load(args.library)
    skeleton = read_skeleton(args.skeleton) if args.skeleton else None
    done = labelled(args.output, args.labeller)
    items = list(zip(library.names, library.fragments))
    items += [(blend.title(library.names), library.blend(blend)) for blend in library.blends]
    todo = [(name, poses) for name, poses in items if name not in done]
    print(f'{len(items) - len(todo)} of {len(items)} are labelled by {args.labeller}')
    for name, poses in progress(todo, 'drawing', 'picture', shown=args.only_draw):
        path = Path(args.pictures) / f'{name.replace("/", "_")}.png'
        if not path.exists():
            save(_picture(library, name, poses, skeleton), path)
            say_written(path, args)
        if args.only_draw:
            continue
        efforts = _ask(name, path)
        if efforts is None:
            print('stopped; run the same command to go on')
            return
        append_label(args.output, name, efforts, args.labeller)


def _picture(library, name, poses, skeleton):
    motion = library.space.decode(poses, library.rate_hz, name=name)
    title = f'{name} ({motion.duration_s:.2f} s)'
    if skeleton is not None:
        return stick_strip(skeleton, [(title, motion)], count=14, follow=False)
    names = library.space.joint_names[:12]
    return joint_curves(names, [Line('angle', motion.times, motion.joints(names).positions)], title)


def _ask(name, path):
    """Three numbers, or None where the person stops."""
    while True:
        try:
            answer = input(f'{name}: see {path}\n  flow weight time (-3 to 3, q to stop): ')
        except EOFError:
            return None
        if answer.strip().lower() in ('q', 'quit'):
            return None
        try:
            efforts = [float(word) for word in answer.replace(',', ' ').split()]
        except ValueError:
            efforts = []
        if len(efforts) == 3 and all(abs(effort) <= 3 for effort in efforts):
            return efforts
        print('  three numbers from -3 to 3, please, e.g. 1 -2 0')
