"""Content: primitives and cycles of the state graph, sequences by name, paths between them, random walks, pictures."""
import heapq
import itertools
import re
from collections import Counter
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from style_core.errors import UsageError

__all__ = ['Primitive', 'primitives', 'runs', 'visits_to_path', 'scale_dwell', 'sequence', 'random_walk', 'bridge',
           'graph_arcs', 'graph_dot']

#: of the longest cycles in pictures of the state graph
CYCLE_COLOURS = ('#4477aa', '#ee6677', '#228833', '#ccbb44', '#66ccee', '#aa3377')
_LIKELY_ARC = 0.02  # transitions less probable than this are left out of the graph


@dataclass(frozen=True)
class Primitive:
    """A piece of motion as a sequence of states.

    Attributes
    ----------
    name : str
        ``c1``, ``c2``, ... for cycles (which may be repeated), ``p1``, ... for linear pieces.
    states : tuple of int
    count : int
        How often the training recordings perform it.
    cyclic : bool
    """

    name: str
    states: Tuple[int, ...]
    count: int
    cyclic: bool


def runs(path):
    """Compress a state path to visits: list of (state, frames)."""
    path = np.asarray(path)
    edges = np.flatnonzero(np.diff(path)) + 1
    starts = np.concatenate([[0], edges])
    ends = np.concatenate([edges, [len(path)]])
    return [(int(path[a]), int(b - a)) for a, b in zip(starts, ends)]


def visits_to_path(visits):
    """Visits (state, stay in frames, which may be fractional) to a state a frame; rounding is carried along."""
    ends = np.round(np.cumsum([stay for _, stay in visits])).astype(int)
    lengths = np.diff(np.concatenate([[0], ends]))
    return np.repeat([state for state, _ in visits], lengths).astype(np.intc)


def scale_dwell(content, before, after):
    """Content with the dwell times of another style (4.5).

    Parameters
    ----------
    content : ndarray, shape (T,) of int or (T, N)
    before, after : ndarray, shape (N,)
        Dwell times of the content's own style and of the new one.

    Returns
    -------
    ndarray
        States or occupancies of as many frames as the content takes now.
    """
    content, ratio = np.asarray(content), np.asarray(after) / np.asarray(before)
    if content.ndim == 1:
        scaled = visits_to_path([(state, stay * ratio[state]) for state, stay in runs(content)])
        return scaled if len(scaled) else content[:1].astype(np.intc)
    ends = np.cumsum(content @ ratio)  # where each frame ends on the new clock
    wanted = np.arange(max(round(ends[-1]), 1)) + 0.5
    centres = ends - 0.5 * (content @ ratio)
    right = np.clip(np.searchsorted(centres, wanted), 1, max(len(centres) - 1, 1))
    if len(centres) == 1:
        return np.repeat(content, len(wanted), axis=0)
    span = centres[right] - centres[right - 1]
    share = np.clip((wanted - centres[right - 1]) / span, 0.0, 1.0)[:, None]
    return (1 - share) * content[right - 1] + share * content[right]


def primitives(machine, least=2):
    """Cycles and linear primitives of a machine's training recordings.

    A cycle is a piece of the visited states that ends where it began without passing any state twice; it counts
    wherever it starts. A linear primitive is a maximal chain of states without a fork or a junction in the graph of
    performed transitions.

    Parameters
    ----------
    machine : StyleMachine
    least : int
        A cycle must have been closed this often.

    Returns
    -------
    list of Primitive
        Cycles by how much of the recordings they cover, then linear pieces.
    """
    found, followers, leaders = Counter(), {}, {}
    visited = [[state for state, _ in runs(path)] for path in machine.recordings.values()]
    for states in visited:
        last = {}
        for place, state in enumerate(states):
            if state in last:
                loop = states[last[state]:place]
                if len(set(loop)) == len(loop) and len(loop) > 1:
                    turn = loop.index(min(loop))
                    found[tuple(loop[turn:] + loop[:turn])] += 1
            last[state] = place
        for a, b in itertools.pairwise(states):
            followers.setdefault(a, Counter())[b] += 1
            leaders.setdefault(b, Counter())[a] += 1
    # a cycle performed once and entered again closes at each of its states in turn
    cycles = sorted(((states, max(round(count / len(states)), 1)) for states, count in found.items()
                     if count >= least), key=lambda item: (-item[1] * len(item[0]), item[0]))
    pieces = [Primitive(f'c{k + 1}', states, count, True) for k, (states, count) in enumerate(cycles)]

    def continues(a):
        """The only state after a, if a is also the only one before it."""
        after = followers.get(a, {})
        if len(after) != 1:
            return None
        b = next(iter(after))
        return b if len(leaders[b]) == 1 and b != a else None

    heads = {b for a in followers if (b := continues(a)) is not None}
    chains = []
    for state in sorted(set(followers) | set(leaders)):
        if state in heads:
            continue
        chain = [state]
        while (after := continues(chain[-1])) is not None and after not in chain:
            chain.append(after)
        if len(chain) > 1:
            chains.append((tuple(chain), min(followers[a][b] for a, b in itertools.pairwise(chain))))
    chains.sort(key=lambda item: (-len(item[0]) * item[1], item[0]))
    return pieces + [Primitive(f'p{k + 1}', states, count, False) for k, (states, count) in enumerate(chains)]


def bridge(machine, source, target):
    """States between two states on the most probable path, both ends excluded; empty if an arc connects them.

    Raises
    ------
    UsageError
        If no path leads from one to the other.
    """
    if source == target or machine.trans[source, target] > 0:
        return []
    moves = machine.trans * (1 - np.eye(machine.n_states))
    totals = moves.sum(axis=1, keepdims=True)
    moves = moves / np.where(totals > 0, totals, 1.0)
    best, origin, heap = {source: 0.0}, {}, [(0.0, source)]
    while heap:
        cost, state = heapq.heappop(heap)
        if state == target:
            break
        if cost > best[state]:
            continue
        for after in np.flatnonzero(moves[state]):
            new = cost - np.log(moves[state, after])
            if new < best.get(int(after), np.inf):
                best[int(after)] = new
                origin[int(after)] = state
                heapq.heappush(heap, (new, int(after)))
    if target not in origin:
        raise UsageError(f'no path leads from state s{source} to state s{target}')
    path = [origin[target]]
    while path[-1] != source:
        path.append(origin[path[-1]])
    return path[-2::-1]


_ITEM = re.compile(r'(?P<name>[^\s*@]+?)(?:@(?P<start>\d+\.?\d*)-(?P<stop>\d+\.?\d*))?(?:\*(?P<times>\d+))?$')


def sequence(machine, text):
    """Visits for a choreography written by name.

    Parameters
    ----------
    machine : StyleMachine
    text : str
        Items separated by spaces or commas: a cycle or primitive (``c1``, ``p2``), a state (``s12``), a training
        recording (its name) or a stretch of it in seconds (``walk@0.5-2.0``), each optionally repeated (``c1*4``).
        Where two items do not connect, the most probable path between them is inserted.

    Returns
    -------
    list of (int, float)
        State and stay in units of the state's dwell time (1 = the style's own mean).

    Raises
    ------
    UsageError
        For an item that does not exist, with what does.
    """
    known = {piece.name: piece for piece in primitives(machine)}
    visits = []
    items = [item for item in re.split(r'[\s,]+', text.strip()) if item]
    if not items:
        raise UsageError('the sequence is empty: name cycles, primitives, states or recordings')
    for item in items:
        match = _ITEM.match(item)
        if match is None:
            raise UsageError(f'cannot read {item!r}; items look like c1*4, p2, s12, walk or walk@0.5-2.0')
        for _ in range(int(match['times'] or 1)):
            piece = _item(machine, known, match)
            if visits and piece:
                visits += [(state, 1.0) for state in bridge(machine, visits[-1][0], piece[0][0])]
            visits += piece
    if not visits:
        raise UsageError('the sequence has no states')
    return visits


def _item(machine, known, match):
    name = match['name']
    if name in machine.recordings:
        path = machine.recordings[name]
        if match['start'] is not None:
            begin, end = (round(float(match[key]) * machine.rate_hz) for key in ('start', 'stop'))
            if not begin < end or begin >= len(path):
                raise UsageError(f'{name} lasts {len(path) / machine.rate_hz:.2f} s: {match[0]!r} is no stretch of it')
            path = path[begin:end]
        dwell = machine.at(machine.styles[machine.recording_styles[name]]).dwell
        return [(state, stay / dwell[state]) for state, stay in runs(path)]
    if match['start'] is not None:
        raise UsageError(f'{name!r} is no training recording; only those have stretches: {_some(machine.recordings)}')
    if name in known:
        return [(state, 1.0) for state in known[name].states]
    if re.fullmatch(r's\d+', name) and int(name[1:]) < machine.n_states:
        return [(int(name[1:]), 1.0)]
    raise UsageError(f'there is no {name!r}; there are recordings {_some(machine.recordings)}; cycles and primitives '
                     f'{_some(known)}; states s0 .. s{machine.n_states - 1}')


def _some(names):
    names = list(names)
    return ', '.join(names[:6]) + (f' ... ({len(names)})' if len(names) > 6 else '') if names else 'none'


def random_walk(machine, seed, start=None):
    """Endless visits of a random walk on the state graph.

    Parameters
    ----------
    machine : StyleMachine
    seed : int
    start : int, optional
        First state; drawn from how often states are visited otherwise.

    Yields
    ------
    (int, float)
        State and stay in units of its dwell time. From a state without a way out the walk starts anew.
    """
    rng = np.random.default_rng(seed)
    moves = machine.trans * (1 - np.eye(machine.n_states))
    totals = moves.sum(axis=1)
    use = np.bincount(np.concatenate(list(machine.recordings.values())), minlength=machine.n_states).astype(float)
    use = np.where(totals > 0, use, 0.0)
    if not use.sum():
        use = np.ones(machine.n_states)
    use /= use.sum()
    state = int(rng.choice(machine.n_states, p=use)) if start is None else int(start)
    while True:
        yield state, 1.0
        if totals[state] > 0:
            state = int(rng.choice(machine.n_states, p=moves[state] / totals[state]))
        else:
            target = int(rng.choice(machine.n_states, p=use))
            state = target


def graph_arcs(machine, least=_LIKELY_ARC):
    """Transitions between different states, as probabilities given that the state is left: list of (from, to, p)."""
    moves = machine.trans * (1 - np.eye(machine.n_states))
    totals = moves.sum(axis=1, keepdims=True)
    moves = moves / np.where(totals > 0, totals, 1.0)
    return [(int(a), int(b), float(moves[a, b])) for a, b in np.argwhere(moves >= least)]


def graph_dot(machine, least=_LIKELY_ARC):
    """The state graph in the DOT language; states of the longest cycles are coloured and labelled."""
    cycles = [piece for piece in primitives(machine) if piece.cyclic][:len(CYCLE_COLOURS)]
    lines = ['digraph states {', '  rankdir=LR; node [shape=circle, fontsize=10, style=filled, fillcolor=white];']
    for state in range(machine.n_states):
        member = next((k for k, piece in enumerate(cycles) if state in piece.states), None)
        colour = f', fillcolor="{CYCLE_COLOURS[member]}", tooltip="{cycles[member].name}"' if member is not None else ''
        lines.append(f'  s{state} [label="{state}"{colour}];')
    lines += [f'  s{a} -> s{b} [penwidth={0.5 + 2.5 * p:.2f}, label="{p:.2f}"];' for a, b, p in
              graph_arcs(machine, least)]
    return '\n'.join([*lines, '}']) + '\n'
