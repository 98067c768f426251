"""Build an effort library: fragments of motion, what they have in common, and how efforts mix when they are blended.

motion-style train effort --fragments fragments.csv -o dance_effort.npz
    fragments.csv has the columns fragment,file,start_s,stop_s and may have content; files are looked for beside it
motion-style train effort step1.amc step2.amc leap1.amc leap2.amc -o steps_effort.npz
    every file is one fragment
motion-style train effort --fragments fragments.csv --labels labels.csv -o dance_effort.npz
    with a person's labels, collected by motion-style label; without them the labels are computed from the kinematics

A fragment is one unit of movement (a step, a leap, a gesture), and the library wants each of them in several manners.
Which fragments show the same action is found by dynamic time warping, unless the column content says it.
"""
from pathlib import Path

from style_core.cli.files import add_output
from style_core.cli.joints import JOINTS_HELP, chosen_joints
from style_core.cli.number import Count, Positive, Seed
from style_core.cli.parser import Several
from style_core.cli.recordings import add_recorded_rate, read_recording
from style_core.cli.soundness import doubt_recordings
from style_core.effort import joint_scale, save, train_library
from style_core.effort.descriptors import EFFORTS
from style_core.effort.labels import read_labels
from style_core.effort.regression import METHODS
from style_core.errors import MotionError, UsageError
from style_core.formats.files import read_table
from style_core.model_file import training_files
from style_core.progress import progress
from style_core.skeleton import read_skeleton

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """Fragments, labels and settings."""
    parser.add_argument('files', nargs='*', metavar='FILE', help='motion files, one fragment each')
    parser.add_argument('--fragments', metavar='CSV', help='table of fragments cut out of longer recordings')
    add_output(parser, '-o', '--output', what='model', required=True, metavar='LIBRARY.npz', help='library to write')
    parser.add_argument('--labels', metavar='CSV', help="a person's labels (motion-style label); computed where absent")
    parser.add_argument('--labeller', metavar='NAME', help="use this person's labels only (default: the mean of all)")
    parser.add_argument('--joints', action=Several, metavar='PATTERN',
                        help=JOINTS_HELP.replace('no root', 'a root only if it is complete'))
    parser.add_argument('--skeleton', metavar='FILE', help='.asf, .bvh or .urdf; weighs joints by how far they move '
                                                           'the body (default: all joints weigh the same)')
    parser.add_argument('--rate', action=Positive, default=60.0, metavar='HZ', help='rate of the library (default: 60)')
    add_recorded_rate(parser)
    parser.add_argument('--interpolations', action=Count, default=105, metavar='N',
                        help='blends of matching fragments to learn from (default: 105)')
    parser.add_argument('--method', choices=METHODS, default='kernel-ridge',
                        help='how efforts of blends are predicted (default: kernel-ridge)')
    parser.add_argument('--seed', action=Seed, default=0, help='of the blends and of cross-validation (default: 0)')


def run(args):
    """Read, cut, train and save."""
    if bool(args.files) == bool(args.fragments):
        raise UsageError('give motion files, or a table with --fragments')
    rows = _table(args.fragments) if args.fragments else [(Path(f).stem, Path(f), None, None, '') for f in args.files]
    paths = sorted({path for _, path, *_ in rows})
    recordings = {}
    for path in progress(paths, 'reading', 'file'):
        recordings[path] = read_recording(path, args.recorded_rate, args.unit).resample(args.rate)
    names = chosen_joints(list(recordings.values()), list(recordings), args.joints, root=True)
    recordings = {path: motion.joints(names) for path, motion in recordings.items()}
    motions = []
    for name, path, start, stop, _ in rows:
        piece = recordings[path] if start is None else recordings[path].slice(start, stop)
        motions.append(piece.replace(name=name, times=piece.times - piece.times[0]))
    doubt_recordings(motions)
    contents = [content for *_, content in rows]
    if any(contents) and not all(contents):
        raise UsageError(f'{args.fragments}: the column content is empty for fragment {rows[contents.index("")][0]!r}')
    scale = joint_scale(motions, read_skeleton(args.skeleton)) if args.skeleton else None
    labels = read_labels(args.labels, args.labeller) if args.labels else None
    library = train_library(
        motions, groups=contents if all(contents) else None, scale=scale, labels=labels, blends=args.interpolations,
        method=args.method, seed=args.seed, rate_hz=args.rate,
        progress=lambda items: progress(items, 'matching'))
    save(library, args.output, {'training_files': training_files(paths)})
    print(f'{len(library.names)} fragments in {library.groups.max() + 1} contents, {len(library.blends)} '
          f'interpolations, labels {"computed from the kinematics" if labels is None else "by a person"}')
    for group in range(library.groups.max() + 1):
        members = [name for name, g in zip(library.names, library.groups) if g == group]
        more = f' and {len(members) - 6} more' if len(members) > 6 else ''
        print(f'  content {group}: {", ".join(members[:6])}{more}')
    spread = library.efforts.std(axis=0)
    print('spread of the labels: ' + ', '.join(f'{e} {s:.2f}' for e, s in zip(EFFORTS, spread)))


def _table(path):
    folder, rows = Path(path).parent, []
    for line, row in read_table(path, ('fragment', 'file', 'start_s', 'stop_s')):
        try:
            start, stop = float(row['start_s']), float(row['stop_s'])
        except (TypeError, ValueError):
            raise MotionError(f'{path}, line {line}: start_s and stop_s must be numbers') from None
        rows.append((row['fragment'], folder / (row['file'] or ''), start, stop, row.get('content') or ''))
    if not rows:
        raise MotionError(f'{path} has no rows')
    return rows
