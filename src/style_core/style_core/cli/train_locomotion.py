"""Find styles in unlabelled recordings of walking, running or any other cyclic motion (Pan and Torresani 2009).

motion-style train locomotion recordings/*.amc --styles 4 -o gaits.npz
motion-style train locomotion recordings/*.amc --styles 2-8 -o gaits.npz      choose the number by cross-validation
motion-style train locomotion recordings/*.amc --labels labels.csv -o gaits.npz
    name each style by the most common label of its recordings (a CSV with columns trial and action)

No labels are needed to learn: recordings are grouped by how they move, and all are aligned to common phases. Missing
values (NaN, gaps) in the recordings are marginalised.
"""
from collections import Counter
from dataclasses import replace

import numpy as np

from style_core.cli.files import add_output
from style_core.cli.joints import JOINTS_HELP, chosen_joints
from style_core.cli.number import Count, Positive, Seed
from style_core.cli.parser import Several
from style_core.cli.recordings import add_recorded_rate, named_recording
from style_core.cli.soundness import doubt_fit, doubt_recordings, doubt_repetition
from style_core.errors import UsageError
from style_core.formats.files import read_table
from style_core.locomotion.choose import choose_styles
from style_core.locomotion.learn import learn
from style_core.locomotion.model import save
from style_core.model_file import training_files
from style_core.progress import progress

__all__ = ['add_arguments', 'run', 'read_recordings']


def add_arguments(parser, argv):
    """FILES, and what to find in them."""
    parser.add_argument('files', nargs='+', metavar='FILE', help='recordings of cyclic motion, of any known format')
    add_output(parser, '-o', '--output', what='model', required=True, metavar='MODEL.npz', help='model file to write')
    parser.add_argument('--styles', default='2-8', metavar='C',
                        help='number of styles, or a range (2-8) to choose from by held-out likelihood (default: 2-8)')
    parser.add_argument(
        '--joints',
        action=Several,
        metavar='PATTERN',
        help=JOINTS_HELP.replace('no root', 'a root only if it is complete'),
    )
    parser.add_argument('--rate', action=Positive, metavar='HZ',
                        help="rate to learn at (default: the recordings' lowest)")
    add_recorded_rate(parser)
    parser.add_argument('--seed', action=Seed, default=0, help='of the random starts (default: 0)')
    parser.add_argument('--restarts', action=Count, default=5, help='starts; the highest bound wins (default: 5)')
    parser.add_argument('--iterations', action=Count, default=15, help='EM iterations (default: 15)')
    parser.add_argument('--threads', action=Count, default=1, help='threads for the E-step (default: 1; same result)')
    parser.add_argument(
        '--labels', metavar='CSV', help='columns trial and action: names for the styles, never used to learn'
    )


def read_recordings(files, recorded_rate=None, joints=None, unit=None):
    """Motions of files, continuous and named by their stem; the body's joints and a root that travels unless ``joints``
    says."""
    motions = []
    for path in progress(files, 'reading', 'file'):
        motion = named_recording(path, recorded_rate, unit)
        motions.append(motion)
    names = chosen_joints(motions, files, joints, root=True)
    return [motion.joints(names) for motion in motions]


def run(args):
    """Learn, name, save."""
    counts = _counts(args.styles)
    motions = read_recordings(args.files, args.recorded_rate, args.joints, args.unit)
    options = {'seed': args.seed, 'rate_hz': args.rate, 'n_iterations': args.iterations,
               'threads': args.threads, 'progress': True}
    if len(counts) > 1:
        choice = choose_styles(motions, counts, **options)
        for row in choice.rows:
            print(f'{row.n_styles} styles: held-out log likelihood {row.held_out:.4f} +- {row.error:.4f} nats a value, '
                  f'bound {row.bound:.0f} nats')
        count = choice.best
        print(f'chosen: {count} styles')
    else:
        count = counts[0]
    model = learn(motions, count, restarts=args.restarts, **options)
    _doubt(model, motions)
    if args.labels:
        model = replace(model, style_names=_names(model, args.labels))
    save(model, args.output, training_files=training_files(args.files), seed=args.seed)
    for name, column, period in zip(model.style_names, model.labels.T, model.periods_s):
        members = [recording for recording, share in zip(model.recordings, column) if share > 0.5]
        print(f'{name}: cycle of {period:.2f} s, {len(members)} recordings'
              + (f' ({", ".join(members[:6])}{", ..." if len(members) > 6 else ""})' if members else ''))


def _doubt(model, motions):
    """Say what speaks against the recordings and the fit."""
    doubt_recordings(motions)
    doubt_repetition(motions)
    own = model.noise[model.labels.argmax(axis=1)] / model.scale**2
    moved = [np.nanvar(model.features.encode(motion), axis=0) / model.scale**2 for motion in motions]
    doubt_fit('the model', own.mean(), np.nanmean(moved))


def _counts(text):
    try:
        first, _, last = text.partition('-')
        counts = list(range(int(first), int(last or first) + 1))
    except ValueError:
        raise UsageError(f'--styles takes a number or a range like 2-8, not {text!r}') from None
    if not counts or counts[0] < 1:
        raise UsageError(f'--styles {text} names no number of styles')
    return counts


def _names(model, path):
    actions = {row['trial']: row['action'] for _, row in read_table(path, ('trial', 'action')) if row['action']}
    names = []
    for c, own in enumerate(model.style_names):
        found = Counter(
            actions[r] for r, row in zip(model.recordings, model.labels) if row.argmax() == c and r in actions
        )
        name = found.most_common(1)[0][0] if found else own
        taken = sum(n == name or (n.startswith(name + '_') and n[len(name) + 1:].isdigit()) for n in names)
        names.append(name if not taken else f'{name}_{taken + 1}')
    return tuple(names)
