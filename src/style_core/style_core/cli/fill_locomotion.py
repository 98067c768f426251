"""Fill in missing joints of a recording with a locomotion model.

motion-style fill gaits.npz walk.csv -o filled.csv                          every missing value (NaN) of the file
motion-style fill gaits.npz walk.amc --hide 'l*' --from 1.5 --score -o filled.amc
    hide values first and say how well they come back

Values that are there are never changed. Off line the whole recording before and after a gap is used; with --causal only
what came before.
"""
import numpy as np

from style_core.cli.answer import add_json, answer
from style_core.cli.files import add_output
from style_core.cli.number import Number
from style_core.cli.parser import Several
from style_core.cli.recordings import add_recorded_rate, named_recording
from style_core.errors import MotionError, UsageError
from style_core.formats import write_motion
from style_core.locomotion.infer import fill
from style_core.locomotion.model import load
from style_core.locomotion.online import fill_causally
from style_core.motion import matching_names

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """FILE, what to hide, where to write."""
    parser.add_argument(
        'file', metavar='FILE', help='recording; joints of the model that it lacks altogether are added'
    )
    add_output(parser, '-o', '--output', metavar='FILE', help='filled recording; the suffix says which format')
    parser.add_argument('--hide', action=Several, default=[], metavar='PATTERN', help='joints to hide first')
    parser.add_argument('--from', action=Number, dest='start', metavar='S', help='hide from this time on')
    parser.add_argument('--to', action=Number, dest='stop', metavar='S', help='hide up to this time')
    parser.add_argument('--score', action='store_true', help='compare what was hidden with what was filled in')
    parser.add_argument('--causal', action='store_true', help='use only what came before each frame, as on line')
    add_recorded_rate(parser)
    add_json(parser)


def run(args):
    """Hide, fill, score, write."""
    model = load(args.model)
    if not (args.output or args.score):
        raise UsageError('say where to write (-o) or ask for --score')
    given = named_recording(args.file, args.recorded_rate, args.unit)
    present = set(given.joint_names)
    known = [name for name in model.joint_names if name in present]
    if not known:
        raise MotionError(f'{args.file} has none of the joints of the model')
    positions = np.full((given.n_frames, len(model.joint_names)), np.nan)
    positions[:, [model.joint_names.index(name) for name in known]] = given.joints(known).positions
    whole = given.replace(joint_names=model.joint_names, positions=positions, units=model.features.units)
    frames = np.ones(whole.n_frames, bool)
    frames &= whole.times >= (-np.inf if args.start is None else args.start)
    frames &= whole.times < (np.inf if args.stop is None else args.stop)
    hidden = np.zeros(whole.positions.shape, bool)
    if args.hide:
        names = matching_names(model.joint_names, args.hide)
        hidden[np.ix_(frames, [model.joint_names.index(name) for name in names])] = True
    shown = whole.replace(positions=np.where(hidden, np.nan, whole.positions))
    filled, std = fill_causally(model, shown) if args.causal else fill(model, shown)
    missing = np.isnan(shown.positions)
    facts = {'output': args.output, 'missing': int(missing.sum()), 'values': missing.size,
             'frames': int(missing.any(axis=1).sum()), 'joints': int(missing.any(axis=0).sum())}
    lines = [f'filled {facts["missing"]} of {missing.size} values in {facts["frames"]} frames and '
             f'{facts["joints"]} joints']
    if args.score:
        scored = hidden & np.isfinite(whole.positions)
        if not scored.any():
            raise UsageError('nothing was hidden that could be scored: give --hide, and times within the recording')
        for unit, factor, shown_unit in (('rad', 180 / np.pi, 'deg'), ('m', 1.0, 'm')):
            chosen = scored & (np.array(model.features.units) == unit)
            if chosen.any():
                error = factor * (filled.positions - whole.positions)[chosen]
                score = {'mean_squared_error': float(np.mean(error**2)),
                         'within_two_std': float(np.mean(np.abs(error) < 2 * factor * std[chosen]))}
                facts.setdefault('score', {})[shown_unit] = score
                lines.append(f'{shown_unit}: mean squared error {score["mean_squared_error"]:.3f}, root '
                             f'{np.sqrt(score["mean_squared_error"]):.3f}, {score["within_two_std"]:.0%} within two '
                             'standard deviations')
    if args.output:
        write_motion(filled, args.output)
    answer(args, facts, *lines)
