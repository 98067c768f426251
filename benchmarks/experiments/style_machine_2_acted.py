"""Experiment 2: four acted performances, mirrored, 75 states. What is left, how long it takes, do states correspond?

    python benchmarks/experiments/style_machine_2_acted.py
"""
import time

import numpy as np
from sklearn.cluster import KMeans
from style_machine_common import ACTED, agreement, alignments, body, parse, paths, sharing, skeleton

from style_core.hmm import Hmm, em_step, log_density, viterbi
from style_core.report import Report
from style_core.style_machine import Settings, learn, primitives
from style_core.style_machine.pictures import occupancy_matrices, state_graph, style_map


def plain_hmm(sequences, states, seed):
    """State paths of a maximum-likelihood full-covariance HMM of all sequences together, started from k-means."""
    whole = np.concatenate(sequences)
    means = KMeans(states, n_init=1, random_state=seed).fit(whole).cluster_centers_
    floor = 1e-3 * float(whole.var(axis=0).mean())
    model = Hmm(np.full(states, 1 / states), np.full((states, states), 0.2 / states) + 0.8 * np.eye(states), means,
                np.tile(np.cov(whole.T) / states ** (2 / 3), (states, 1, 1)))
    for _ in range(30):
        model, _ = em_step(model, sequences, floor)
    return [viterbi(log_density(x, model.means, model.covs), model.start, model.trans)[0] for x in sequences]


def main():
    args = parse(__doc__, states=75)
    tree = skeleton('131')
    motions = [body(name) for name in ACTED]
    begin, used = time.perf_counter(), time.process_time()
    machine = learn(motions, Settings(states=args.states, seed=args.seed), skeleton=tree, mirror=True)
    elapsed, used = time.perf_counter() - begin, time.process_time() - used
    report = Report('style_machine_2_acted', 'Four acted performances',
                    'python benchmarks/experiments/style_machine_2_acted.py', args.seed, paths(ACTED))
    frames = sum(map(len, machine.recordings.values()))
    q = machine.coordinates.leading
    report.table('training', ['', 'here', 'the paper (four dances)'], [
        ['frames at 60 Hz (mirror images included)', frames, '6000+'], ['states at the start', args.states, 75],
        ['states left', machine.n_states, 69], ['transitions left', int((machine.trans > 0).sum()), '-'],
        ['parameters of the generic model', machine.parameters, 'about 3500'],
        ['dimensions of training', q, 'ten or fewer'],
        ['iterations', len(machine.history), '-'],
        ['whole learning, wall clock (s; the machine was shared)', elapsed, 'about 1200'],
        ['whole learning, processor (s, one core)', used, '-'],
        ['explained by 1 / 2 / 3 style axes (%)', ' / '.join(f'{x:.0f}' for x in 100 * np.cumsum(machine.spectrum)[:3]),
         '-']])
    worst = max(row['rise'] / abs(row['objective']) for row in machine.history)
    report.text(f'Largest relative rise of the objective at fixed temperatures in all iterations: {worst:.1e} '
                '(never positive beyond rounding).')
    labels = [machine.recordings[name] for name in ACTED]
    aligned = alignments([machine.encoded(motion) for motion in motions], machine.coordinates.weights)
    data = [machine.coordinates.encode(machine.encoded(motion).positions)[:, :q] for motion in motions]
    centred = [x - x.mean(axis=0) for x in data]
    pooled = plain_hmm(centred, machine.n_states, args.seed)
    pooled_raw = plain_hmm(data, machine.n_states, args.seed)
    separate = [plain_hmm([x], machine.n_states, args.seed)[0] for x in centred]
    rows = [['style machine', *agreement(labels, aligned), sharing(labels, machine.n_states)],
            ['one pooled HMM (figure 1B), mean poses removed', *agreement(pooled, aligned),
             sharing(pooled, machine.n_states)],
            ['one pooled HMM, as recorded', *agreement(pooled_raw, aligned), sharing(pooled_raw, machine.n_states)],
            ['separately trained HMMs (figure 1C)', *agreement(separate, aligned), '-']]
    report.table('correspondence', ['model', 'same state', 'same after renaming', 'sharing'], rows,
                 'Do states of different performances mean the same? Share of frames, time-aligned by dynamic time '
                 'warping, in the same state; the same after the best one-to-one renaming of states for each pair; '
                 'sharing of states (1 = all performances alike). For separate models only the renamed column is '
                 'meaningful, and renaming pair by pair flatters it.')
    pieces = primitives(machine)
    report.table('primitives', ['name', 'kind', 'states', 'performed'],
                 [[piece.name, 'cycle' if piece.cyclic else 'linear', len(piece.states), piece.count]
                  for piece in pieces[:12]], 'The longest motion primitives found')
    report.figure(occupancy_matrices([(name, np.eye(machine.n_states)[path]) for name, path in zip(ACTED, labels)]),
                  'occupancies', 'Most probable states of the four performances.')
    report.figure(state_graph(machine), 'graph', 'State graph.')
    report.figure(style_map(machine), 'map', 'Style map.')
    print(report.write(args.output))


if __name__ == '__main__':
    main()
