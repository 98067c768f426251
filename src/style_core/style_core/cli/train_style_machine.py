"""Learn a style machine: one stylistic hidden Markov model of unlabelled recordings, and the space of their styles.

motion-style train style-machine walk.amc run.amc strut.amc -o machine.npz
    every recording is a style, named like its file; without labels the states find what the recordings share
motion-style train style-machine --style walk w1.amc w2.amc --style run r1.amc -o machine.npz
    several recordings of one style
motion-style train style-machine dance*.amc --states 75 --mirror -o dance.npz
    each recording's mirror image is trained on too

The skeleton beside the recordings (.asf, .bvh) weighs the joints by how far they move the body; without one all joints
weigh alike. Training is annealed: the temperature falls, then states and transitions that do not pay are removed. It
writes its state to MODEL.npz.checkpoint every few seconds; the same command after an interruption goes on from there.
"""
from pathlib import Path

from style_core.cli.files import add_output
from style_core.cli.joints import JOINTS_HELP, chosen_joints
from style_core.cli.number import Count, Number, Positive, Seed
from style_core.cli.parser import Several
from style_core.cli.recordings import add_recorded_rate, named_recording
from style_core.cli.soundness import doubt_recordings
from style_core.errors import UsageError
from style_core.formats import skeleton_of
from style_core.model_file import training_files
from style_core.progress import progress
from style_core.skeleton import read_skeleton

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """FILES or groups of them, and the settings of training."""
    parser.add_argument('files', nargs='*', metavar='FILE', help='recordings, each a style of its own')
    parser.add_argument('--style', nargs='+', action='append', default=[], metavar=('NAME', 'FILE'),
                        help='a style and its recordings; may be given several times')
    add_output(parser, '-o', '--output', what='model', required=True, metavar='MODEL.npz', help='model file to write')
    parser.add_argument('--joints', action=Several, metavar='PATTERN',
                        help=JOINTS_HELP)
    parser.add_argument('--skeleton', metavar='FILE', help='.asf, .bvh or .urdf (default: beside the first file)')
    parser.add_argument('--states', action=Count, default=75, metavar='N', help='states at the start (default: 75)')
    parser.add_argument('--dimensions', action=Count, most=10, default=10, metavar='D',
                        help='principal components to train on, at most 10 (default: 10)')
    parser.add_argument('--dof', action=Count, metavar='K',
                        help='style coordinates (default: as many as explain 95 %% of the variation)')
    parser.add_argument('--rate', action=Positive, default=60.0, metavar='HZ', help='rate to learn at (default: 60)')
    add_recorded_rate(parser)
    parser.add_argument('--mirror', action='store_true', help='train on mirror images too')
    parser.add_argument('--temperature', action=Number, least=0, metavar='T',
                        help='of the generic model at the start of annealing')
    parser.add_argument('--anneal', action=Seed, metavar='N', help='iterations of annealing')
    parser.add_argument('--heat', action=Number, metavar='T', help="largest T' of the specific models, 0 .. 1")
    parser.add_argument('--cross-entropy', action=Positive, metavar='Z',
                        help='pull between generic and specific models')
    parser.add_argument('--init', choices=('hint', 'frames', 'random'),
                        help='first models: a low-dimensional HMM, every n-th frame, or random frames')
    parser.add_argument('--seed', action=Seed, default=0, help='of all random choices (default: 0)')


def run(args):
    """Read, train, save."""
    from style_core.style_machine import Settings, learn, save
    groups = [(Path(file).stem, [file]) for file in args.files] + [(name, files) for name, *files in args.style]
    if not groups:
        raise UsageError('give recordings to learn from')
    empty = [name for name, files in groups if not files]
    if empty:
        raise UsageError(f'style {empty[0]!r} has no recordings')
    paths = [file for _, files in groups for file in files]
    if len(set(paths)) < len(paths):
        raise UsageError('a recording is given twice')
    names = [name for name, files in groups for _ in files]
    given = {'states': args.states, 'seed': args.seed, 'temperature': args.temperature, 'anneal': args.anneal,
             'heat': args.heat, 'cross_entropy': args.cross_entropy, 'init': args.init}
    settings = Settings(**{key: value for key, value in given.items() if value is not None})
    skeleton = read_skeleton(args.skeleton) if args.skeleton else skeleton_of(paths[0])
    motions = [named_recording(path, args.recorded_rate, args.unit)
               for path in progress(paths, 'reading', 'file')]
    joints = chosen_joints(motions, paths, args.joints)
    motions = [motion.joints(joints) for motion in motions]
    doubt_recordings(motions)
    checkpoint = args.output + '.checkpoint'
    with progress(desc='training') as bar:
        def told(row):
            bar.update()
            bar.set_postfix_str(f"{row['stage']}, temperature {row['temperature']:.3g}, objective "
                                f"{row['objective']:.1f}, {row['states']} states, {row['transitions']} transitions")
        machine = learn(motions, settings, names, skeleton, args.rate, args.dimensions, args.dof, mirror=args.mirror,
                        checkpoint=checkpoint, progress=told, training_files=training_files(paths))
    save(machine, args.output)
    Path(checkpoint).unlink(missing_ok=True)
    frames = sum(map(len, machine.recordings.values()))
    print(f'{len(machine.recordings)} recordings of {len(machine.styles)} styles, {frames} frames at '
          f'{machine.rate_hz:g} Hz')
    print(f'{machine.n_states} of {settings.states} states left, {int((machine.trans > 0).sum())} transitions, '
          f'{machine.parameters} parameters')
    shares = ', '.join(f'{100 * share:.0f} %' for share in machine.spectrum[:machine.dof])
    print(f'{machine.dof} style coordinates explain {shares}')
