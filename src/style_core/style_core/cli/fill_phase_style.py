"""Fill in the joints that a recording lacks, from the whole recording before and after.

motion-style fill MODEL.npz walk.csv -o whole.csv
    gaps (empty cells, NaN) are filled in; what was measured stays as it is
motion-style fill MODEL.npz walk.amc -o whole.csv --mask 'rfemur.*' 'rtibia.*' 'rfoot.*' 'rtoes.*'
    hide a leg and see how well it comes back (prints the error)
"""
import numpy as np

from style_core.angles import reordered
from style_core.cli.answer import add_json, answer
from style_core.cli.files import add_output
from style_core.cli.predictor_arguments import add_published, add_reading, fitted, hide
from style_core.cli.recordings import read_recording
from style_core.errors import UsageError
from style_core.formats import write_motion
from style_core.joint_space import space_of
from style_core.motion import Motion
from style_core.phase_style import METHODS, load_behaviours
from style_core.phase_style.analysis import follow
from style_core.phase_style.smoother import fill
from style_core.predictor_file import read_predictor
from style_core.progress import progress

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """FILE and output."""
    parser.add_argument('file', metavar='FILE', help='recording with gaps')
    add_output(parser, '-o', '--output', required=True, metavar='FILE', help='motion file to write')
    add_output(parser, '--std', what='table', metavar='FILE.csv', help='also write the standard deviations, rad')
    add_reading(parser)
    parser.add_argument('--method', choices=METHODS, default=METHODS[0],
                        help='full: the full model, from both sides of a gap (default); paper: the published method on '
                             'line, each frame from those before it')
    add_published(parser)
    add_json(parser)


def run(args):
    """Fill and write."""
    behaviours = load_behaviours(args.model)
    names = behaviours[0].joint_names
    motion = read_recording(args.file, args.recorded_rate, args.unit)
    masked, hidden = hide(motion, names, args.mask)
    if args.method == METHODS[0] and (args.forgetting is not None or args.behaviour):
        raise UsageError('--forgetting and --behaviour are for --method paper')
    filled, std, said = (_smoothed if args.method == METHODS[0] else _on_line)(args, behaviours, masked)
    write_motion(filled, args.output)
    if args.std:
        write_motion(Motion(names, std, motion.times, name=motion.name), args.std)
    missing = int(np.isnan(masked.joints(list(names)).positions).sum())
    facts = {'output': args.output, 'missing': missing, 'values': masked.n_frames * len(names), 'course': said}
    lines = [f'filled {missing} of {facts["values"]} values', *said]
    if hidden:
        error = filled.joints(hidden).positions - motion.joints(hidden).positions
        facts['hidden_rms_deg'] = float(np.degrees(np.sqrt(np.nanmean(error ** 2))))
        lines.append(f'error of the hidden joints: {facts["hidden_rms_deg"]:.2f} degrees RMS')
    answer(args, facts, *lines)


def _smoothed(args, behaviours, masked):
    """Filled motion, standard deviations (T, D), and a line a piece."""
    names = behaviours[0].joint_names
    space = space_of(args.model)
    shown = masked if space is None else space.encode_motion(masked)
    filled, std, report = fill(behaviours, shown, lambda pieces: progress(pieces, 'smoothing', 'piece'))
    if space is not None:
        place = [masked.joint_names.index(name) for name in names]
        positions = masked.positions.copy()
        positions[:, place], std = space.select(names).fill_in(positions[:, place], filled.joints(names).positions, std)
        filled = masked.replace(positions=positions)
    return filled, std, [
        f'{one["from_s"]:.2f} to {one["to_s"]:.2f} s: {one["behaviour"]}, {len(one["log_evidence"])} iterations, '
        f'{"converged" if one["converged"] else "not converged"}, log evidence {one["log_evidence"][-1]:.1f}'
        for one in report]


def _on_line(args, behaviours, masked):
    """The same by the published method."""
    found = read_predictor(args.model, args.method, forgetting=args.forgetting, behaviour=args.behaviour)
    names = list(found.predictor.joint_names)
    shown = fitted(masked, found.predictor)
    course = follow(found.predictor, shown, lambda frames: progress(frames, 'following', 'frame'))
    missing = np.isnan(shown.positions)
    # the order in which the file's joints turn; what was measured stays as it was
    whole = reordered(shown.replace(positions=np.where(missing, course.mean, shown.positions)), masked.orders)
    positions = masked.positions.copy()
    place = [masked.joint_names.index(name) for name in names]
    positions[:, place] = np.where(np.isnan(positions[:, place]), whole.joints(names).positions, positions[:, place])
    return masked.replace(positions=positions), np.where(missing, course.std, 0.0), [
        f'{course.behaviour[-1]}, at the end {course.status[-1].name}']
