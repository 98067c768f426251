"""Learn a phase-style model: bases over phase, one Gaussian process each, and styles.

motion-style train phase-style walk1.amc walk2.amc run.amc -o locomotion.npz
    one rhythmic behaviour; every recording is a style of it
motion-style train phase-style jump*.amc --discrete -o jump.npz
    one discrete behaviour, from start to goal
motion-style train phase-style --behaviour walk w*.amc --behaviour run r*.amc --discrete-behaviour jump j*.amc -o m.npz
    several behaviours; the predictor weighs them against each other

motion-style train phase-style walk*.amc --histories -o with_recordings.npz
    also keep the recordings in the model file: predictions then lean on what the nearest recorded motion did next.
    Such a file holds recorded motion of people: share it only where the recordings may be shared

Recordings may be of any known format, with their own rates. A recording is one style. The uncertainty about a new
person is learned by leaving one person out after the other, so it matters who is who: the part of the file name
before the first "_" or "-" (35_01, 35_02), unless --person says otherwise.
"""

import numpy as np

from style_core.cli.files import add_input, add_output
from style_core.cli.joints import JOINTS_HELP, chosen_joints
from style_core.cli.number import Count, Positive
from style_core.cli.parser import Several
from style_core.cli.people import add_person, people_of
from style_core.cli.recordings import add_recorded_rate, named_recording
from style_core.cli.soundness import doubt_fit, doubt_recordings, doubt_repetition
from style_core.errors import UsageError
from style_core.joint_space import fit_space
from style_core.phase_style import learn_correction, save_behaviours
from style_core.phase_style.published_learning import train_published
from style_core.phase_style.training import RATE_HZ, to_sequence, train
from style_core.progress import progress

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """FILES or groups of them, and the model's settings."""
    parser.add_argument('files', nargs='*', metavar='FILE', help='recordings of one behaviour')
    add_output(parser, '-o', '--output', what='model', required=True, metavar='MODEL.npz', help='model file to write')
    parser.add_argument('--name', default='motion', help='name of the behaviour (default: motion)')
    parser.add_argument('--discrete', action='store_true', help='the behaviour has a start and a goal (a jump)')
    parser.add_argument('--behaviour', nargs='+', action='append', default=[], metavar=('NAME', 'FILE'),
                        help='a rhythmic behaviour and its recordings; may be given several times')
    parser.add_argument('--discrete-behaviour', nargs='+', action='append', default=[], metavar=('NAME', 'FILE'),
                        help='a discrete behaviour and its recordings; may be given several times')
    parser.add_argument('--joints', action=Several, metavar='PATTERN',
                        help=JOINTS_HELP)
    parser.add_argument('--styles', action=Count, metavar='J',
                        help='dimension of the style (default: chosen from the singular values)')
    parser.add_argument('--rate', action=Positive, default=RATE_HZ, metavar='HZ',
                        help=f'rate to learn at (default: {RATE_HZ:g}; the predictor takes any rate)')
    parser.add_argument('--histories', action='store_true',
                        help='keep the recordings in the model file and learn their weight beside the filter')
    parser.add_argument('--published', action='store_true',
                        help='learn as published: one cycle a recording, aligned by whole frames. Such a model is for '
                             '--method paper only')
    add_input(parser, '--aligned-by', metavar='LOCOMOTION.npz',
              help='take the phases of rhythmic recordings from this locomotion model (which must know joints of '
                   'theirs) instead of their auto-correlation')
    add_person(parser)
    add_recorded_rate(parser)


def run(args):
    """Train and save."""
    groups = [(name_and_files, True) for name_and_files in args.behaviour] \
        + [(name_and_files, False) for name_and_files in args.discrete_behaviour]
    if args.files:
        groups.insert(0, ([args.name, *args.files], not args.discrete))
    if not groups:
        raise UsageError('give recordings to learn from')
    for (name, *files), _ in groups:
        if not files:
            raise UsageError(f'behaviour {name!r} has no recordings')
    if args.published and (args.histories or args.aligned_by):
        raise UsageError('--published learns for the published method, which has no --histories and no --aligned-by')
    paths = sorted({file for (_, *files), _ in groups for file in files})
    motions = {}
    for path in progress(paths, 'reading', 'file'):
        motions[path] = named_recording(path, args.recorded_rate, args.unit)
    people = people_of(paths, args.person)
    joints = chosen_joints(list(motions.values()), list(motions), args.joints)
    space, motions = _in_joint_space(motions, joints)
    phase_of = None
    if args.aligned_by:
        from style_core.locomotion import analyze, load
        aligner = load(args.aligned_by)
        recorded = {motion.name: space.decode_motion(motion) for motion in motions.values()}

        def phase_of(motion):
            found = analyze(aligner, recorded[motion.name])
            return found.times, found.phase

    def learned(name, files, rhythmic):
        given = [motions[file] for file in files], name, rhythmic, joints, args.styles, args.rate
        groups = [people[file] for file in files]
        if args.published:
            return train_published(*given, groups=groups)
        return train(*given, progress=True, phase_of=phase_of if rhythmic else None, groups=groups)

    behaviours = [
        learned(name, files, rhythmic)
        for (name, *files), rhythmic in progress(groups, 'learning', 'behaviour')]
    correction = None
    if args.histories:
        correction = learn_correction(behaviours, [[to_sequence(motions[file], joints, args.rate, people[file])
                                                    for file in files]
                                                   for (_, *files), _ in groups], progress=True)
    doubt_recordings(motions.values())
    for ((_, *files), rhythmic), behaviour in zip(groups, behaviours):
        own = [motions[file].joints(joints) for file in files]
        if rhythmic:
            doubt_repetition(own)
        doubt_fit(behaviour.name, behaviour.noise.sum(),
                  np.mean([np.nanvar(motion.positions, axis=0).sum() for motion in own]))
    save_behaviours(args.output, behaviours, paths, correction, space)
    for behaviour in behaviours:
        print(f'{behaviour.name}: {len(behaviour.sequences)} recordings, {len(set(behaviour.groups))} people, '
              f'{len(behaviour.joint_names)} joints, {behaviour.style_dimension} styles')
    if correction is not None:
        kept = correction.histories
        print(f'histories: {len(kept.positions)} frames of {len(kept.names)} recordings, weight '
              '{:.2f} while tracking, {:.2f} while searching'.format(*correction.weight.mean(axis=1)))
        print('the file holds recorded motion: share it only where the recordings may be shared')


def _in_joint_space(motions, joints):
    """What is learned in, and the recordings' joints in it."""
    chosen = {path: motion.joints(joints) for path, motion in motions.items()}
    space = fit_space(list(chosen.values()))
    return space, {path: space.encode_motion(motion) for path, motion in chosen.items()}
