"""Predict along recordings and compare with what came.

motion-style evaluate MODEL.npz walk.amc run.amc
motion-style evaluate MODEL.npz walk.amc --mask 'lfemur.*' 'ltibia.*'   the left leg is hidden, but scored
motion-style evaluate MODEL.npz walk.amc --method paper --json

Every recording is brought to 60 Hz, the rate of the published protocol, and the model predicts the next 25 frames at
every frame. E is the mean squared error over instants, frames ahead and joints, in degrees squared; RMS is by
horizon, in degrees; "still" is the error of expecting that nothing moves. Coverage is the share of values inside the
90 % band. Times are of this machine. Recordings that cannot be used are counted and named; the others go on.
"""
import json
import sys

import numpy as np
from tqdm import tqdm

from style_core.cli.number import Count
from style_core.cli.predictor_arguments import add_method, add_reading, fitted, hide, predictor_of
from style_core.cli.recordings import read_recording
from style_core.errors import MotionError
from style_core.evaluation import FRAMES_AHEAD, RATE_HZ, paper_horizons, roll_out, summary

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """FILES and the protocol."""
    parser.add_argument('files', nargs='+', metavar='FILE', help='recordings')
    parser.add_argument('--horizon', action=Count, default=FRAMES_AHEAD, metavar='FRAMES',
                        help=f'frames to predict at {RATE_HZ:g} Hz (default: {FRAMES_AHEAD})')
    parser.add_argument('--json', action='store_true', help='print one JSON object')
    add_reading(parser)
    add_method(parser)


def run(args):
    """Evaluate and print."""
    predictor, method = predictor_of(args)
    names = predictor.joint_names
    horizons = paper_horizons(args.horizon)
    results, failures = {}, {}
    for path in tqdm(args.files, desc='evaluating', unit='file', disable=None, leave=False):
        try:
            motion = _read(path, args, predictor)
        except MotionError as error:
            failures[str(path)] = error
            continue
        _, hidden = hide(motion, names, args.mask)
        observed = np.ones(motion.positions.shape, dtype=bool)
        observed[:, [names.index(name) for name in hidden]] = False
        key = motion.name if motion.name and motion.name not in results else str(path)
        results[key] = summary(roll_out(predictor, motion, horizons, observed))
    if not results:
        raise next(iter(failures.values()))
    for error in failures.values():
        print(f'motion-style evaluate: {error}', file=sys.stderr)
    if args.json:
        print(json.dumps({'model': args.model, 'method': method, 'masked': list(args.mask),
                          'recordings': results, 'failed': {path: str(error) for path, error in failures.items()}},
                         indent=1))
        return
    shown = sorted({0, min(4, args.horizon - 1), min(9, args.horizon - 1), min(14, args.horizon - 1),
                    args.horizon - 1})
    head = ['recording', 'E', 'E still'] + [f'RMS {k + 1}' for k in shown] + [f'still {shown[-1] + 1}', 'cover 90%']
    if args.mask:
        head.append('hidden RMS')
    head += ['lost', 'update us', 'predict us']
    rows = [head]
    for name, one in results.items():
        row = [name, f'{one["error_deg2"]:.1f}', f'{one["zero_velocity_error_deg2"]:.1f}']
        row += [f'{one["rms_deg"][k]:.2f}' for k in shown]
        row += [f'{one["zero_velocity_rms_deg"][shown[-1]]:.2f}', f'{np.mean(one["coverage"]["0.9"]):.1%}']
        if args.mask:
            row.append(f'{one["hidden_rms_deg"]:.2f}')
        rows.append(row + [f'{one["share_lost"]:.1%}', f'{one["update_us"][0]:.0f}', f'{one["predict_us"][0]:.0f}'])
    widths = [max(len(row[k]) for row in rows) for k in range(len(head))]
    for row in rows:
        print('  '.join([row[0].ljust(widths[0])] + [cell.rjust(width) for cell, width in zip(row[1:], widths[1:])]))
    print(f'mean E {np.mean([one["error_deg2"] for one in results.values()]):.2f} degrees squared; '
          f'RMS in degrees at frames ahead of {RATE_HZ:g} Hz' + (f'; method {method}' if method else ''))
    if failures:
        print(f'{len(failures)} of {len(args.files)} recordings could not be used: {", ".join(failures)}')


def _read(path, args, predictor):
    motion = fitted(read_recording(path, args.recorded_rate, args.unit), predictor).resample(RATE_HZ)
    if motion.n_frames <= args.horizon:
        raise MotionError(f'{path} has {motion.n_frames} frames at {RATE_HZ:g} Hz: too short to score a prediction '
                          f'of {args.horizon} frames (--horizon)')
    return motion
