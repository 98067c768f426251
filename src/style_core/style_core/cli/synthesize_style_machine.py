"""Make new motion with a style machine: content from a recording, a choreography or a random walk, in any style.

motion-style synthesize machine.npz --content walk.amc --style run -o walk_as_run.amc
motion-style synthesize machine.npz --sequence 'c1*4 p2' --style '1.5*strut - 0.5*walk' -o new.csv
motion-style synthesize machine.npz --random-walk 20 --seed 3 --style 'walk:run :: strut:X' -o new.bvh --skeleton s.asf

A style is a trained name, arithmetic on names, an analogy, coordinates such as [0.5, -1], or generic. A sequence holds
cycles and primitives (motion-style info lists them), states (s12), recordings (walk) or stretches of them in seconds
(walk@0.5-2.0), each repeated if wished (c1*4); what does not connect is connected by the most probable path.

With --content, channels the model does not have (the root) come from the recording; they follow its new timing.
"""
from pathlib import Path

import numpy as np

from style_core.cli.answer import add_json, answer
from style_core.cli.exaggeration import add_exaggeration, check_far
from style_core.cli.files import add_output
from style_core.cli.number import Positive, Seed
from style_core.cli.recordings import add_recorded_rate, named_recording
from style_core.errors import UsageError
from style_core.formats import skeleton_of, write_motion
from style_core.skeleton import read_skeleton

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """Content, style, output."""
    content = parser.add_mutually_exclusive_group(required=True)
    content.add_argument('--content', metavar='FILE', help='do what this recording does; it may lack joints')
    content.add_argument('--sequence', metavar='NAMES', help='a choreography by name')
    content.add_argument('--random-walk', action=Positive, most=3600, metavar='SECONDS',
                         help='a random choreography of this length')
    parser.add_argument('--style', default=None, metavar='EXPR',
                        help="style of the result (default: the recording's own with --content, else generic)")
    add_output(parser, '-o', '--output', required=True, metavar='OUT', help='motion file of any known format')
    parser.add_argument('--keep-timing', action='store_true',
                        help="with --content: keep the recording's timing instead of the style's dwell times")
    add_exaggeration(parser)
    parser.add_argument('--seed', action=Seed, default=0, help='of a random walk (default: 0)')
    parser.add_argument('--rate', action=Positive, metavar='HZ',
                        help="rate of the result (default: the model's; AMC: 120)")
    add_recorded_rate(parser)
    add_json(parser)
    parser.add_argument('--skeleton', metavar='FILE', help='.asf or .bvh to write AMC or BVH with (default: the one '
                                                           "beside the recording; for AMC CMU's)")
    add_output(parser, '--picture', what='picture', metavar='PICTURE',
               help='draw a strip of stick figures; needs a skeleton')


def run(args):
    """Synthesise and write."""
    from style_core.style_machine import analyze, load, random_walk, sequence, synthesize, synthesize_visits, take
    machine = load(args.model)
    skeleton = read_skeleton(args.skeleton) if args.skeleton else skeleton_of(args.content) if args.content else None
    if args.picture and skeleton is None:
        raise UsageError('--picture needs --skeleton')
    recording, facts, lines = None, {}, []
    if args.content:
        recording = named_recording(args.content, args.recorded_rate, args.unit)
        found = analyze(machine, recording)
        style = machine.style(found.v if args.style is None else args.style)
        if args.style is not None:
            check_far(machine.styles, machine.dof, style, args.max_exaggeration)
        motion = synthesize(machine, found.gamma, style, None if args.keep_timing else found.emission.dwell)
        facts = {'nearest': found.nearest, 'distance': found.distance, 'reasons': found.reasons}
        lines = [f'{recording.name}: nearest style {found.nearest} at distance {found.distance:.2f}'
                 + ''.join(f'; out of range: {reason}' for reason in found.reasons)]
    else:
        style = machine.style('generic' if args.style is None else args.style)
        check_far(machine.styles, machine.dof, style, args.max_exaggeration)
        if args.sequence:
            visits = sequence(machine, args.sequence)
        else:
            visits = take(random_walk(machine, args.seed), machine, style, args.random_walk)
        motion = synthesize_visits(machine, visits, style)
    motion = _complete(motion, recording, skeleton, args.output)
    rate = args.rate
    if rate is None and args.output.lower().endswith('.amc'):  # AMC files do not say their rate: readers expect 120 Hz
        rate = 120.0 if recording is None else recording.rate_hz
    if rate is not None:
        motion = motion.resample(rate)
    write_motion(motion, args.output, skeleton)
    answer(args, {'output': args.output, 'frames': motion.n_frames, 'rate_hz': motion.rate_hz,
                  'duration_s': motion.duration_s, 'style': style, **facts}, *lines,
           f'{motion.n_frames} frames at {motion.rate_hz:g} Hz, {motion.duration_s:.2f} s, style '
           f'[{", ".join(f"{x:.2f}" for x in style)}]')
    if args.picture:
        from style_core.pictures import save, stick_strip
        save(stick_strip(skeleton, [(args.style or 'own style', motion)], count=12), args.picture)


def _complete(motion, recording, skeleton, output):
    """Add the recording's other channels at the new timing; joints a skeleton file needs whole get zeros."""
    if recording is not None:
        others = [name for name in recording.joint_names if name not in motion.joint_names]
        if others:
            stretch = recording.duration_s / motion.duration_s if motion.n_frames > 1 else 0.0
            times = recording.times[0] + motion.times * stretch
            extra = recording.joints(others).at(np.minimum(times, recording.times[-1])) if stretch else \
                recording.joints(others).replace(positions=recording.joints(others).positions[:1],
                                                 times=recording.times[:1])
            motion = motion.replace(
                joint_names=(*motion.joint_names, *extra.joint_names), units=(*motion.units, *extra.units),
                positions=np.concatenate([motion.positions, extra.positions], axis=1))
    if skeleton is not None and Path(output).suffix.lower() in ('.amc', '.bvh'):
        have = {name.rpartition('.')[0] for name in motion.joint_names}
        lacking = [name for name in skeleton.channel_names
                   if name not in motion.joint_names and name.rpartition('.')[0] in have]
        if lacking:
            units = tuple('m' if name.rpartition('.')[2] in ('tx', 'ty', 'tz') else 'rad' for name in lacking)
            motion = motion.replace(
                joint_names=(*motion.joint_names, *lacking), units=(*motion.units, *units),
                positions=np.concatenate([motion.positions, np.zeros((motion.n_frames, len(lacking)))], axis=1))
    return motion
