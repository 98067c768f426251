"""Experiment 1: how many degrees of freedom has the style of ten locomotion recordings, and what does each do?

    python benchmarks/experiments/style_machine_1_locomotion.py
"""
import numpy as np
from style_machine_common import LOCOMOTION, body, parse, paths, sharing, skeleton

from style_core.pictures import stick_strip
from style_core.report import Report
from style_core.style_machine import Settings, learn, synthesize
from style_core.style_machine.pictures import occupancy_matrices, state_graph, style_map


def main():
    args = parse(__doc__, states=16)
    tree = skeleton()
    motions = [body(name) for name in LOCOMOTION]
    machine = learn(motions, Settings(states=args.states, seed=args.seed), skeleton=tree, dof=5)
    report = Report('style_machine_1_locomotion', 'Style degrees of freedom of ten locomotion recordings',
                    'python benchmarks/experiments/style_machine_1_locomotion.py', args.seed, paths(LOCOMOTION))
    total = np.cumsum(machine.spectrum)
    report.table('spectrum', ['degrees of freedom', 'explained (%)', 'the paper (%)'],
                 [[k + 1, 100 * total[k], 93 if k == 2 else '-'] for k in range(5)],
                 'Variation between the ten specific models explained by the first style axes')
    # what of that is the means alone, what the mean pose: the square-root covariances are mostly estimation noise
    n, d = machine.generic.positions.shape
    q = machine.coordinates.leading
    blocks = {'state means (positions)': slice(0, n * d), 'state means (velocities)': slice(n * d, 2 * n * d),
              'square-root covariances': slice(2 * n * d, 2 * n * d + n * (q * (2 * q + 1) + 3 * (d - q))),
              'dwell times': slice(-n - d, -d), 'mean pose': slice(-d, None)}
    full = learn(motions, Settings(states=args.states, seed=args.seed), skeleton=tree, dof=len(motions))
    gaps = np.array(list(full.styles.values())) @ full.axes
    rows = []
    for name, part in blocks.items():
        s = np.linalg.svd(gaps[:, part], compute_uv=False) ** 2
        share = np.cumsum(s) / s.sum()
        rows.append([name, 100 * s.sum() / (gaps ** 2).sum(), *(100 * share[:3])])
    report.table('blocks', ['part of the style vector', 'share of all variation (%)', '1 axis (%)', '2 axes (%)',
                            '3 axes (%)'], rows, 'The same with each part of the vector alone')
    report.table('styles', ['recording', *(f'v{k + 1}' for k in range(machine.dof)), 'mean dwell (s)'],
                 [[name, *v, float(np.average(machine.at(v).dwell) / machine.rate_hz)]
                  for name, v in machine.styles.items()], 'Style coordinates')
    shared = sharing(list(machine.recordings.values()), machine.n_states)
    report.text(f'{machine.n_states} of {args.states} states left, {int((machine.trans > 0).sum())} transitions; '
                f'sharing of states by the recordings {shared:.2f} (1 = all alike).')
    content = machine.recordings['07_01']
    for axis in range(3):
        strips = []
        for value in (-2.0, 0.0, 2.0):
            v = np.zeros(machine.dof)
            v[axis] = value
            strips.append((f'v{axis + 1} = {value:+g}', synthesize(machine, content, v)))
        report.figure(stick_strip(tree, strips, 9), f'axis{axis + 1}',
                      f'The content of 07_01 along style axis {axis + 1}, from -2 to +2 root mean squares.')
    walk, run, other = '07_01', '09_01', '16_16'
    strips = [(name, synthesize(machine, content, name)) for name in
              (walk, run, other, f'{walk}:{run} :: {other}:X', f'1.5*{run} - 0.5*{walk}')]
    report.figure(stick_strip(tree, strips, 9), 'strips', 'The same content in five styles: three trained ones, an '
                  'analogy, an exaggeration.')
    report.figure(style_map(machine), 'map', 'Style map: the ten recordings on the first two axes, and the spectrum.')
    report.figure(state_graph(machine), 'graph', 'State graph; size = how often visited, colours = longest cycles.')
    report.figure(occupancy_matrices([(name, np.eye(machine.n_states)[path])
                                      for name, path in list(machine.recordings.items())[:5]]), 'occupancies',
                  'Most probable states of five of the recordings.')
    print(report.write(args.output))


if __name__ == '__main__':
    main()
