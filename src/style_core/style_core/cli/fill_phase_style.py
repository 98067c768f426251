"""Fill in the joints that a recording lacks, from the whole recording before and after.

motion-style fill MODEL.npz walk.csv -o whole.csv
    gaps (empty cells, NaN) are filled in; what was measured stays as it is
motion-style fill MODEL.npz walk.amc -o whole.csv --mask 'rfemur.*' 'rtibia.*' 'rfoot.*' 'rtoes.*'
    hide a leg and see how well it comes back (prints the error)
"""
import numpy as np
from tqdm import tqdm

from style_core.cli.files import add_output
from style_core.cli.predictor_arguments import add_reading, hide
from style_core.cli.recordings import read_recording
from style_core.formats import write_motion
from style_core.joint_space import space_of
from style_core.motion import Motion
from style_core.phase_style import load_behaviours
from style_core.phase_style.smoother import fill

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """FILE and output."""
    parser.add_argument('file', metavar='FILE', help='recording with gaps')
    add_output(parser, '-o', '--output', required=True, metavar='FILE', help='motion file to write')
    add_output(parser, '--std', what='table', metavar='FILE.csv', help='also write the standard deviations, rad')
    add_reading(parser)


def run(args):
    """Fill and write."""
    behaviours = load_behaviours(args.model)
    names = behaviours[0].joint_names
    motion = read_recording(args.file, args.recorded_rate, args.unit)
    masked, hidden = hide(motion, names, args.mask)
    space = space_of(args.model)
    shown = masked if space is None else space.encode_motion(masked)
    filled, std, report = fill(behaviours, shown, lambda pieces: tqdm(pieces, desc='smoothing', unit='piece',
                                                                      disable=None, leave=False))
    if space is not None:
        place = [masked.joint_names.index(name) for name in names]
        positions = masked.positions.copy()
        positions[:, place], std = space.select(names).fill_in(positions[:, place], filled.joints(names).positions, std)
        filled = masked.replace(positions=positions)
    write_motion(filled, args.output)
    if args.std:
        write_motion(Motion(names, std, motion.times, name=motion.name), args.std)
    missing = int(np.isnan(masked.joints(list(names)).positions).sum())
    print(f'filled {missing} of {masked.n_frames * len(names)} values')
    for one in report:
        end = 'converged' if one['converged'] else 'not converged'
        print(f'{one["from_s"]:.2f} to {one["to_s"]:.2f} s: {one["behaviour"]}, {len(one["log_evidence"])} iterations, '
              f'{end}, log evidence {one["log_evidence"][-1]:.1f}')
    if hidden:
        error = filled.joints(hidden).positions - motion.joints(hidden).positions
        print(f'error of the hidden joints: {np.degrees(np.sqrt(np.nanmean(error ** 2))):.2f} degrees RMS')
    print(f'wrote {args.output}')
