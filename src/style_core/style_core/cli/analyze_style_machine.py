"""Find style and content of recordings with a style machine; draw its style map, state graph and occupancies.

motion-style analyze machine.npz walk.amc               style coordinates, nearest training style, content
motion-style analyze machine.npz walk.amc --json        the same for programs, with the state of every frame
motion-style analyze machine.npz *.amc --map styles.png --occupancies content.png
motion-style analyze machine.npz --graph states.png     the state graph (.png, .pdf, .svg or .dot)

A recording may lack joints; they are marginalised exactly. One that lies outside the trained range is flagged, with
the reason.
"""
import json

import numpy as np

from style_core.cli.files import add_output
from style_core.cli.recordings import add_recorded_rate, named_recording
from style_core.errors import UsageError
from style_core.formats.files import replacing

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """FILES and pictures."""
    parser.add_argument('files', nargs='*', metavar='FILE', help='recordings of any known format')
    add_recorded_rate(parser)
    add_output(parser, '--map', what='picture', metavar='PICTURE', help='draw the style map')
    add_output(parser, '--occupancies', what='picture', metavar='PICTURE',
               help='draw the occupancy matrices of the FILES')
    add_output(parser, '--graph', what='graph', metavar='FILE', help='draw the state graph, or write it as .dot')
    parser.add_argument('--json', action='store_true', help='print one JSON object a FILE')


def run(args):
    """Analyse, print, draw."""
    from style_core.pictures import save
    from style_core.style_machine import analyze, graph_dot, load
    from style_core.style_machine.pictures import occupancy_matrices, state_graph, style_map
    if not (args.files or args.map or args.graph):
        raise UsageError('give recordings to analyse, or --map or --graph')
    if args.occupancies and not args.files:
        raise UsageError('--occupancies needs recordings')
    machine = load(args.model)
    found = []
    for path in args.files:
        one = analyze(machine, named_recording(path, args.recorded_rate, args.unit))
        found.append(one)
        print(json.dumps(_record(one)) if args.json else _text(machine, one))
    if args.map:
        save(style_map(machine, found), args.map)
    if args.occupancies:
        save(occupancy_matrices([(one.name, one.gamma) for one in found]), args.occupancies)
    if args.graph:
        if args.graph.endswith('.dot'):
            with replacing(args.graph) as stream:
                stream.write(graph_dot(machine))
        else:
            save(state_graph(machine), args.graph)


def _record(one):
    return {'name': one.name, 'v': one.v.tolist(), 'nearest': one.nearest, 'distance': one.distance,
            'distances': one.distances, 'log_likelihood_per_frame': one.log_likelihood,
            'out_of_range': one.out_of_range, 'reasons': list(one.reasons), 'states': one.path.tolist()}


def _text(machine, one):
    near = ', '.join(f'{name} {distance:.2f}' for name, distance in list(one.distances.items())[:3])
    lines = [f'{one.name}: nearest style {one.nearest} (distances: {near})',
             f'  v = [{", ".join(f"{x:.2f}" for x in one.v)}]',
             f'  {len(one.path)} frames through {len(np.unique(one.path))} of {machine.n_states} states, '
             f'log likelihood {one.log_likelihood:.2f} a frame']
    lines += [f'  out of range: {reason}' for reason in one.reasons]
    return '\n'.join(lines)
