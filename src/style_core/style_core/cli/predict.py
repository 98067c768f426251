"""Follow a recording and predict how it goes on.

motion-style predict MODEL.npz walk.amc -o next.csv
    follow the whole recording, then write the second after its last frame
motion-style predict MODEL.npz walk.amc -o next.csv --at 1.5 --seconds 0.5 --mask 'lfemur.*' 'ltibia.*'
    follow it to 1.5 s without the left leg, then write the next half second
motion-style predict MODEL.npz walk.amc -o ahead.csv --ahead 0.2
    what was predicted 0.2 s before, for every frame: to lay over the recording

The output is a motion file of any format that can hold the model's joints; a table (CSV) with the standard deviation
of every value is written beside it with --std FILE.csv.
"""
import numpy as np

from style_core.cli.answer import add_json, answer
from style_core.cli.files import add_output
from style_core.cli.number import Number, Positive
from style_core.cli.predictor_arguments import add_method, add_reading, fitted, hide, predictor_of
from style_core.cli.recordings import read_recording
from style_core.errors import UsageError
from style_core.formats import write_motion
from style_core.motion import Motion
from style_core.progress import progress
from style_core.sizes import demand

__all__ = ['add_arguments', 'run']

#: horizons predicted at a time
_AT_ONCE = 500


def add_arguments(parser, argv):
    """FILE, output and times."""
    parser.add_argument('file', metavar='FILE', help='recording to follow')
    add_output(parser, '-o', '--output', required=True, metavar='FILE', help='motion file to write')
    parser.add_argument('--at', action=Number, metavar='S',
                        help='time of the recording to predict from (default: its end)')
    parser.add_argument('--seconds', action=Positive, default=1.0, metavar='S', help='how far to predict (default: 1)')
    parser.add_argument('--rate', action=Positive, default=60.0, metavar='HZ', help='rate of the output (default: 60)')
    parser.add_argument('--ahead', action=Number, least=0, metavar='S',
                        help='write instead what was predicted S before each frame')
    add_output(parser, '--std', what='table', metavar='FILE.csv', help='also write the standard deviations, rad')
    add_reading(parser)
    add_method(parser)
    add_json(parser)


def run(args):
    """Predict and write."""
    predictor, _ = predictor_of(args)
    motion = fitted(read_recording(args.file, args.recorded_rate, args.unit), predictor)
    motion, _ = hide(motion, predictor.joint_names, args.mask)
    if args.at is not None:
        if not motion.times[0] <= args.at <= motion.times[-1]:
            raise UsageError(f'--at {args.at:g} lies outside the recording, '
                             f'{motion.times[0]:g} to {motion.times[-1]:g} s')
        motion = motion.slice(None, args.at + 1e-6)
    every = []
    for time, y in progress(list(zip(motion.times, motion.positions)), 'following', 'frame'):
        estimate = predictor.update(time, y)
        if args.ahead is not None:
            every.append(predictor.predict(np.array([args.ahead])))
    if args.ahead is None:
        count = max(round(args.seconds * args.rate), 1)
        demand(6 * count * len(predictor.joint_names), f'{args.seconds:g} s at {args.rate:g} Hz, {count} frames,',
               'a lower --rate, or less time (--seconds)')
        horizons = np.arange(1, count + 1) / args.rate
        every = [predictor.predict(part) for part in np.array_split(horizons, -(-count // _AT_ONCE))]
    times, mean, std = (np.concatenate([getattr(one, name) for one in every]) for name in ('times', 'mean', 'std'))
    write_motion(Motion(predictor.joint_names, mean, times, name=motion.name), args.output)
    if args.std:
        write_motion(Motion(predictor.joint_names, std, times, name=motion.name), args.std)
    likely = max(estimate.behaviours, key=estimate.behaviours.get)
    phase = '' if np.isnan(estimate.phase) else \
        f'phase {estimate.phase:.2f}, phase velocity {estimate.phase_velocity:.2f} /s, '
    ends = [{'horizon_s': float(times[k] - motion.times[-1]), 'std_deg': float(np.degrees(std[k]).mean())}
            for k in (0, -1)]
    answer(args, {'recording': motion.name, 'output': args.output, 'frames': len(times), 'status': estimate.status.name,
                  'behaviour': likely, 'behaviours': dict(estimate.behaviours), 'phase': float(estimate.phase),
                  'phase_velocity_per_s': float(estimate.phase_velocity), 'first': ends[0], 'last': ends[1]},
           f'{motion.name}: {likely}, {phase}{estimate.status.name}; standard deviation '
           + ', '.join(f'{one["std_deg"]:.1f} deg at {one["horizon_s"]:.3f} s' for one in ends))
