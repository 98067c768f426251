"""What a style machine holds, for motion-style info."""
import numpy as np

from style_core.style_machine.choreography import graph_arcs, primitives
from style_core.style_machine.machine import from_arrays

__all__ = ['describe']


def describe(header, arrays):
    """States, styles with their coordinates, explained variation, primitives, graph."""
    machine = from_arrays(header, arrays)
    use = np.bincount(np.concatenate(list(machine.recordings.values())), minlength=machine.n_states)
    last = machine.history[-1] if machine.history else {}
    return {
        'likelihoods': {name: round(value, 3) for name, value in machine.likelihoods.items()},
        'history': [], 'iterations': len(machine.history), 'objective': last.get('objective'),
        'states': machine.n_states, 'states_at_start': machine.settings.states,
        'transitions': int((machine.trans > 0).sum()), 'parameters': machine.parameters,
        'style_coordinates': machine.dof,
        'explained_percent': [round(100 * float(share), 1) for share in machine.spectrum],
        'styles': [{'style': name, **{f'v{k + 1}': round(float(x), 2) for k, x in enumerate(v)}}
                   for name, v in machine.styles.items()],
        'primitives': [{'name': piece.name, 'cycle': piece.cyclic, 'performed': piece.count,
                        'states': ' '.join(f's{state}' for state in piece.states)}
                       for piece in primitives(machine)[:20]],
        'graph': [{'state': f's{state}', 'frames': int(use[state]),
                   'dwell_s': round(float(machine.generic.dwell[state] / machine.rate_hz), 3),
                   'goes_to': ', '.join(f's{b} {p:.2f}' for a, b, p in graph_arcs(machine) if a == state)}
                  for state in range(machine.n_states)]}
