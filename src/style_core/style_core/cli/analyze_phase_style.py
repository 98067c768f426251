"""Find phase, style, behaviour and status of a recording over time with a phase-style model.

motion-style analyze MODEL.npz walk.amc                      what changes when, followed on line by the full filter
motion-style analyze MODEL.npz walk.amc -o course.csv --picture course.png
motion-style analyze MODEL.npz walk.amc --method paper --forgetting 0.95
motion-style analyze MODEL.npz walk.amc --batch              one style for all frames, by batch EM, and how it converged

On line, every frame knows those before it only. In batch the published method repeats its filter with the style held
and the least squares over all frames, for the behaviour of --behaviour, or the first of the file.
"""
import csv
import json

import numpy as np

from style_core.cli.files import add_output
from style_core.cli.predictor_arguments import add_method, add_reading, fitted, hide, read_of
from style_core.cli.recordings import read_recording
from style_core.errors import UsageError
from style_core.formats.files import replacing
from style_core.joint_space import space_of
from style_core.phase_style import behaviour_named, load_behaviours
from style_core.phase_style.analysis import course_of_batch, events, follow
from style_core.phase_style.matsubara_predictor import FARTHEST, batch_em
from style_core.progress import progress

__all__ = ['add_arguments', 'run']

#: events printed, at most
_SHOWN = 40


def add_arguments(parser, argv):
    """FILE and what to write."""
    parser.add_argument('file', metavar='FILE', help='recording of any known format')
    add_output(parser, '-o', '--output', what='table', metavar='CSV', help='write every frame as a table')
    add_output(parser, '--picture', what='picture', metavar='PICTURE', help='draw the course (.png, .pdf, .svg)')
    parser.add_argument('--json', action='store_true', help='print one JSON object with every frame')
    parser.add_argument('--batch', action='store_true', help='batch EM over the whole recording instead')
    add_reading(parser)
    add_method(parser)


def run(args):
    """Analyse, print, write, draw."""
    motion = read_recording(args.file, args.recorded_rate, args.unit)
    course, said, rhythmic, result = _in_batch(args, motion) if args.batch else _on_line(args, motion)
    changes = events(course, rhythmic)
    if args.json:
        print(json.dumps({'model': args.model, 'recording': motion.name, **said,
                          'events': [vars(one) for one in changes], 'frames': _columns(course)},
                         indent=1, allow_nan=False))
    else:
        print(f'{motion.name}: {len(course.times)} frames, ' + _in_words(course, said))
        for one in changes[:_SHOWN]:
            print(f'{one.time:8.3f} s  {one.kind:9}  {one.value}')
        if len(changes) > _SHOWN:
            print(f'... and {len(changes) - _SHOWN} more (--json)')
    if args.output:
        with replacing(args.output) as stream:
            columns = _columns(course)
            table = csv.writer(stream)
            table.writerow(columns)
            table.writerows(['' if cell is None else f'{cell:.9g}' if isinstance(cell, float) else cell
                             for cell in row] for row in zip(*columns.values()))
    if args.picture:
        from style_core.phase_style.pictures import course_picture
        from style_core.pictures import save
        save(course_picture(course, motion.name, result), args.picture)


def _on_line(args, motion):
    found = read_of(args)
    motion, _ = hide(fitted(motion, found.predictor), found.predictor.joint_names, args.mask)
    course = follow(found.predictor, motion, lambda frames: progress(frames, 'following', 'frame'))
    return course, {'method': args.method}, found.rhythmic, None


def _in_batch(args, motion):
    if args.forgetting is not None or args.without:
        raise UsageError('--batch is the published method and forgets nothing: it takes no --forgetting or --without')
    behaviour = behaviour_named(load_behaviours(args.model), args.behaviour or '')
    space, names = space_of(args.model), list(behaviour.joint_names)
    motion, _ = hide(motion, names, args.mask)
    # before coordinates fold it: what no joint can be
    motion = motion.replace(positions=np.where(np.abs(motion.positions) <= FARTHEST, motion.positions, np.nan))
    motion = (motion if space is None else space.encode_motion(motion)).joints(names)
    result = batch_em(behaviour, motion.times, motion.positions)
    said = {'method': 'batch', 'style': result.style.tolist(), 'converged': result.converged,
            'iterations': len(result.log_likelihood), 'log_likelihood': result.log_likelihood,
            'style_change': result.style_change}
    return course_of_batch(behaviour, motion.times, result), said, {behaviour.name: behaviour.rhythmic}, result


def _in_words(course, said):
    if said['method'] != 'batch':
        share = sum(one.name == 'TRACKING' for one in course.status) / len(course.status)
        return f'on line, method {said["method"]}, {share:.0%} of the time TRACKING; at the end ' \
            + _style(course.style[-1])
    lines = [f'batch EM of {course.behaviour[0]}, {"converged" if said["converged"] else "not converged"} in '
             f'{said["iterations"]} iterations; ' + _style(course.style[-1])]
    lines += [f'iteration {k + 1:2}: log likelihood {one:.1f}, style changed by {change:.2%}'
              for k, (one, change) in enumerate(zip(said['log_likelihood'], said['style_change']))]
    return '\n'.join(lines)


def _style(style):
    return f'style [{", ".join(f"{x:.3f}" for x in style[~np.isnan(style)])}]'


def _columns(course):
    """Name to values of every column, None where there is nothing to say."""
    count = len(course.times)
    columns = {'time_s': course.times, 'behaviour': course.behaviour, 'probability': course.probability,
               'phase': course.phase, 'phase_velocity': course.phase_velocity,
               'status': tuple(one.name for one in course.status) or (None,) * count, 'innovation': course.innovation,
               **{f'style{j + 1}': column for j, column in enumerate(course.style.T)}}
    return {name: [None if value is None else value if isinstance(value, str) else
                   float(value) if np.isfinite(value) else None for value in values]
            for name, values in columns.items()}
