"""Predict along recordings and compare with what came.

motion-style evaluate MODEL.npz walk.amc run.amc
motion-style evaluate MODEL.npz walk.amc --mask 'lfemur.*' 'ltibia.*'   the left leg is hidden, but scored
motion-style evaluate MODEL.npz walk.amc --method paper --json

Every recording is brought to 60 Hz, the rate of the published protocol, and the model predicts the next 25 frames at
every frame. E is the mean squared error over instants, frames ahead and joints, in degrees squared; RMS is by
horizon, in degrees; "still" is the error of expecting that nothing moves, "mean" that of the recording's own mean pose
all along: a model that does no better knows nothing of the motion. Coverage is the share of values inside the 90 %
band, which is honest from 85 to 95 %. Recordings that the model was trained on are named. Times are of this machine.
Recordings that cannot be used are counted and named; the others go on.
"""
import sys

import numpy as np

from style_core.cli.answer import add_json, answer
from style_core.cli.number import Count
from style_core.cli.predictor_arguments import add_method, add_reading, fitted, hide, predictor_of
from style_core.cli.recordings import read_recording
from style_core.errors import MotionError
from style_core.evaluation import FRAMES_AHEAD, RATE_HZ, bands_verdict, paper_horizons, roll_out, summary, verdict
from style_core.model_file import read_header, was_trained_on
from style_core.progress import progress
from style_core.sizes import demand

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """FILES and the protocol."""
    parser.add_argument('files', nargs='+', metavar='FILE', help='recordings')
    parser.add_argument('--horizon', action=Count, default=FRAMES_AHEAD, metavar='FRAMES',
                        help=f'frames to predict at {RATE_HZ:g} Hz (default: {FRAMES_AHEAD})')
    add_json(parser)
    add_reading(parser)
    add_method(parser)


def run(args):
    """Evaluate and print."""
    predictor, method = predictor_of(args)
    header = read_header(args.model)
    results, failures = {}, {}
    for path in progress(args.files, 'evaluating', 'file'):
        try:
            key, one = _scored(path, predictor, args)
        except MotionError as error:
            failures[str(path)] = error
            continue
        one.update(in_training=was_trained_on(header, path), verdict=verdict(
            one['error_deg2'], one['zero_velocity_error_deg2'], one['mean_pose_error_deg2']),
            bands=bands_verdict(float(np.mean(one['coverage']['0.9']))))
        results[key if key and key not in results else str(path)] = one
    if not results:
        raise next(iter(failures.values()))
    for error in failures.values():
        print(f'motion-style evaluate: {error}', file=sys.stderr)
    scored = [one['error_deg2'] for one in results.values() if np.isfinite(one['error_deg2'])]
    if not scored:
        raise MotionError('nothing could be scored: no value that was predicted is in the recording' +
                          ('s' if len(results) > 1 else ''))
    if args.json:
        answer(args, {'model': args.model, 'method': method, 'masked': list(args.mask), 'recordings': results,
                      'failed': {path: str(error) for path, error in failures.items()}})
        return
    shown = sorted({0, min(4, args.horizon - 1), min(9, args.horizon - 1), min(14, args.horizon - 1),
                    args.horizon - 1})
    head = ['recording', 'E', 'E still', 'E mean', *(f'RMS {k + 1}' for k in shown), f'still {shown[-1] + 1}',
            'cover 90%']
    if args.mask:
        head.append('hidden RMS')
    head += ['lost', 'update us', 'predict us']
    rows = [head]
    for name, one in results.items():
        row = [name, f'{one["error_deg2"]:.1f}', f'{one["zero_velocity_error_deg2"]:.1f}',
               f'{one["mean_pose_error_deg2"]:.1f}']
        row += [f'{one["rms_deg"][k]:.2f}' for k in shown]
        row += [f'{one["zero_velocity_rms_deg"][shown[-1]]:.2f}', f'{np.mean(one["coverage"]["0.9"]):.1%}']
        if args.mask:
            row.append(f'{one["hidden_rms_deg"]:.2f}')
        rows.append(row + [f'{one["share_lost"]:.1%}', f'{one["update_us"][0]:.0f}', f'{one["predict_us"][0]:.0f}'])
    widths = [max(len(row[k]) for row in rows) for k in range(len(head))]
    for row in rows:
        print('  '.join([row[0].ljust(widths[0])] + [cell.rjust(width) for cell, width in zip(row[1:], widths[1:])]))
    for name, one in results.items():
        print(f'{name}: {one["verdict"]}; bands {one["bands"]}'
              + ('; was in training: it says nothing of anybody new' if one['in_training'] else ''))
    print(f'mean E {np.mean(scored):.2f} degrees squared; '
          f'RMS in degrees at frames ahead of {RATE_HZ:g} Hz' + (f'; method {method}' if method else ''))
    if failures:
        print(f'{len(failures)} of {len(args.files)} recordings could not be used: {", ".join(failures)}')


def _scored(path, predictor, args):
    """Name of a recording, and `summary` of the predictions along it."""
    names = predictor.joint_names
    motion = fitted(read_recording(path, args.recorded_rate, args.unit), predictor).resample(RATE_HZ)
    if motion.n_frames <= args.horizon:
        raise MotionError(f'{path} has {motion.n_frames} frames at {RATE_HZ:g} Hz: too short to score a prediction of '
                          f'{args.horizon} frames (--horizon)')
    demand(8 * motion.n_frames * args.horizon * len(names), f'{path}: {args.horizon} frames ahead of each of '
           f'{motion.n_frames}', 'a smaller --horizon, or a shorter recording')
    _, hidden = hide(motion, names, args.mask)
    observed = np.ones(motion.positions.shape, dtype=bool)
    observed[:, [names.index(name) for name in hidden]] = False
    return motion.name, summary(roll_out(predictor, motion, paper_horizons(args.horizon), observed))
