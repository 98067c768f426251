"""Find style, cycles and phase of recordings with a locomotion model.

motion-style analyze gaits.npz walk.amc run.amc              a line a recording: style, cycles, fit
motion-style analyze gaits.npz walk.amc -o phases.csv        phase and position of every frame
motion-style analyze gaits.npz *.amc --picture aligned.png   all recordings over common phases, coloured by style
motion-style analyze gaits.npz --rename style0=stroll style1=run
    give the styles of the model names that --blend understands
"""
import csv
import json
from dataclasses import replace

import numpy as np

from style_core.cli.files import add_output, say_written
from style_core.cli.parser import Several
from style_core.cli.recordings import add_recorded_rate
from style_core.cli.train_locomotion import read_recordings
from style_core.errors import UsageError
from style_core.formats.files import replacing
from style_core.locomotion.infer import analyze
from style_core.locomotion.model import load, save
from style_core.locomotion.pictures import alignment_picture
from style_core.model_file import read_header
from style_core.progress import progress

__all__ = ['add_arguments', 'run']

#: probability from which a style is named without another beside it
_CERTAIN = 0.9


def add_arguments(parser, argv):
    """FILES and what to write."""
    parser.add_argument('files', nargs='*', metavar='FILE', help='recordings with the joints of the model')
    add_output(parser, '-o', '--output', what='table', metavar='CSV', help='write phase and position of every frame')
    add_output(parser, '--picture', what='picture', metavar='PNG', help='draw the recordings over common phases')
    parser.add_argument(
        '--joints', action=Several, metavar='JOINT', help='joints in the picture (default: the most moving four)'
    )
    add_recorded_rate(parser)
    parser.add_argument('--rename', action=Several, default=[], metavar='OLD=NEW',
                        help='rename styles in the model file')
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(args):
    """Analyze and show."""
    model = load(args.model)
    if args.rename:
        model = _rename(model, args)
        print(f'styles of {args.model}: {", ".join(model.style_names)}')
    if not args.files:
        if args.rename:
            return
        raise UsageError('give recordings to analyze')
    motions = read_recordings(args.files, args.recorded_rate, model.joint_names, args.unit)
    results = [analyze(model, motion) for motion in progress(motions, 'analyzing', 'file')]
    rows = [{'recording': r.name, 'style': model.style_names[r.style],
             'probability': float(r.style_probabilities[r.style]),
             'probabilities': dict(zip(model.style_names, map(float, r.style_probabilities))),
             'cycles': float(np.ptp(r.phase) / (2 * np.pi)),
             'mean_period_s': float(2 * np.pi * np.ptp(r.times) / max(np.ptp(r.phase), 1e-9)),
             'cycle_times_s': [float(t) for t in r.cycle_times_s],
             'log_likelihood_per_value': r.log_likelihood_per_value} for r in results]
    if args.json:
        print(json.dumps({'model': args.model, 'recordings': rows}, indent=1))
    else:
        for row in rows:
            limits = ', '.join(f'{t:.2f}' for t in row['cycle_times_s'])
            print(
                f'{row["recording"]}: {_style(row)}, '
                f'{row["cycles"]:.2f} cycles of {row["mean_period_s"]:.2f} s, phase 0 at {limits or "no time"} s, '
                f'{row["log_likelihood_per_value"]:.2f} nats a value'
            )
    if args.output:
        with replacing(args.output) as stream:
            table = csv.writer(stream)
            table.writerow(['recording', 'time_s', 'style', 'phase_rad', 'position'])
            for r in results:
                for t, phase, position in zip(r.times, r.phase, r.position):
                    table.writerow([r.name, f'{t:.6f}', model.style_names[r.style], f'{phase:.6f}',
                                    position % model.n_positions])
    if args.picture:
        from style_core.pictures import save as save_picture
        save_picture(alignment_picture(model, motions, results, args.joints), args.picture)


def _style(row):
    """The style found, and the next where it might as well be that."""
    (first, one), *rest = sorted(row['probabilities'].items(), key=lambda item: -item[1])
    if one >= _CERTAIN or not rest:
        return f'{first} (probability {one:.3f})'
    return f'uncertain, {first} ({one:.3f}) or {rest[0][0]} ({rest[0][1]:.3f})'


def _rename(model, args):
    if args.model != args.model_given:
        raise UsageError(f'{args.model} comes with the suite: copy it and rename the styles of the copy')
    names = list(model.style_names)
    for pair in args.rename:
        old, found, new = pair.partition('=')
        if not found or not new.isidentifier():
            raise UsageError(f'{pair!r}: write OLD=NEW, NEW a single word of letters, digits and _')
        names[model.style(old)] = new
    if len(set(names)) < len(names):
        raise UsageError(f'two styles would have one name: {", ".join(names)}')
    model = replace(model, style_names=tuple(names))
    header = read_header(args.model)
    save(model, args.model, **{key: header[key] for key in ('training_files', 'seed') if key in header})
    say_written(args.model, args)
    return model
