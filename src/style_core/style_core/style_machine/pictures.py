"""Pictures of a style machine: style map, occupancy matrices, state graph. They return matplotlib figures."""
import numpy as np

from style_core.style_machine.choreography import CYCLE_COLOURS, graph_arcs, primitives

__all__ = ['style_map', 'occupancy_matrices', 'state_graph']


def _pyplot():
    import matplotlib.pyplot as plt
    return plt


def style_map(machine, found=(), title='Style map'):
    """Training styles (and analysed recordings) on the first two style coordinates, and the spectrum.

    Parameters
    ----------
    machine : StyleMachine
    found : sequence of Analysis
    title : str
    """
    plt = _pyplot()
    figure, (axis, bars) = plt.subplots(1, 2, figsize=(10, 5), gridspec_kw={'width_ratios': [3, 1]},
                                        constrained_layout=True)

    def place(v):
        return (*np.asarray(v)[:2], 0.0)[:2]

    axis.axhline(0, color='#cccccc', lw=0.8)
    axis.axvline(0, color='#cccccc', lw=0.8)
    axis.plot(0, 0, '+', color='k', ms=12)
    axis.annotate('generic', (0, 0), textcoords='offset points', xytext=(6, -12), fontsize=8, color='#555555')
    for name, v in machine.styles.items():
        axis.plot(*place(v), 'o', color='#0072b2')
        axis.annotate(name, place(v), textcoords='offset points', xytext=(5, 4), fontsize=8)
    for one in found:
        axis.plot(*place(one.v), 'x', color='#999999' if one.out_of_range else '#d55e00', ms=8, mew=2)
        axis.annotate(one.name, place(one.v), textcoords='offset points', xytext=(5, 4), fontsize=8, color='#d55e00')
    share = 100 * machine.spectrum
    axis.set_xlabel(f'v1 ({share[0]:.0f} % of the variation)')
    axis.set_ylabel(f'v2 ({share[1]:.0f} %)' if machine.dof > 1 and len(share) > 1 else '')
    axis.set_title(title, loc='left', fontsize=11)
    bars.bar(np.arange(1, len(share) + 1), np.cumsum(share), color='#bbccee')
    bars.bar(np.arange(1, len(share) + 1), share, color='#0072b2')
    bars.axvline(machine.dof + 0.5, color='#555555', ls=':', lw=1)
    bars.set_ylim(0, 100)
    bars.set_xlabel('degree of freedom')
    bars.set_title('% explained (light: cumulated)', fontsize=9)
    return figure


def occupancy_matrices(rows, title=''):
    """Occupancy matrices above each other, states downwards in the order of their first visit, time to the right.

    Parameters
    ----------
    rows : sequence of (str, ndarray of shape (T, N))
    title : str
    """
    plt = _pyplot()
    figure, axes = plt.subplots(len(rows), 1, figsize=(11, 0.5 + 1.9 * len(rows)), squeeze=False,
                                constrained_layout=True)
    visited = np.concatenate([np.asarray(gamma).argmax(axis=1) for _, gamma in rows])
    order = list(dict.fromkeys(visited.tolist()))
    for (label, gamma), axis in zip(rows, axes[:, 0]):
        axis.imshow(np.asarray(gamma).T[order], aspect='auto', cmap='Greys', interpolation='nearest', vmin=0, vmax=1)
        axis.set_ylabel('states by first visit', fontsize=8)
        axis.set_title(label, fontsize=9, loc='left')
    axes[-1, 0].set_xlabel('frame')
    if title:
        figure.suptitle(title, fontsize=11)
    return figure


def state_graph(machine, title='', least=0.05):
    """States at their mean pose on the first two training coordinates, arrows as transitions, cycles in colour."""
    plt = _pyplot()
    figure, axis = plt.subplots(figsize=(9, 8), constrained_layout=True)
    places = machine.generic.positions[:, :2]
    if places.shape[1] == 1:
        places = np.column_stack([places, machine.generic.velocities[:, 0]])
    for a, b, p in graph_arcs(machine, least):
        axis.annotate('', places[b], places[a], arrowprops={
            'arrowstyle': '-|>', 'color': '#555555', 'alpha': 0.25 + 0.7 * p, 'lw': 0.5 + 1.6 * p,
            'shrinkA': 7, 'shrinkB': 7, 'connectionstyle': 'arc3,rad=0.12'})
    cycles = [piece for piece in primitives(machine) if piece.cyclic][:len(CYCLE_COLOURS)]
    use = np.bincount(np.concatenate(list(machine.recordings.values())), minlength=machine.n_states)
    for state, (x, y) in enumerate(places):
        member = next((k for k, piece in enumerate(cycles) if state in piece.states), None)
        axis.scatter(x, y, s=60 + 200 * use[state] / max(use.max(), 1), zorder=3, edgecolor='k', linewidth=0.6,
                     color='white' if member is None else CYCLE_COLOURS[member])
        axis.annotate(str(state), (x, y), ha='center', va='center', fontsize=7, zorder=4)
    for k, piece in enumerate(cycles):
        axis.scatter([], [], color=CYCLE_COLOURS[k], edgecolor='k', linewidth=0.6,
                     label=f'{piece.name}: {len(piece.states)} states, performed {piece.count} times')
    if cycles:
        axis.legend(fontsize=8, loc='best')
    axis.set_xlabel('first training coordinate')
    axis.set_ylabel('second')
    axis.set_title(title or f'{machine.n_states} states', loc='left', fontsize=11)
    return figure
