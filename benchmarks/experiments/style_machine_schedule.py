"""Which temperature schedules, pulls and first models train good style machines? (the open question of section 6)

For ten locomotion recordings and for four acted performances: the final objective, states left, how far all styles
share states, agreement of labels under the best time alignment, and the error of held-out recordings resynthesised
through analysis. The defaults of style_core.style_machine.Settings come from here.

    python benchmarks/experiments/style_machine_schedule.py
"""
import time
from dataclasses import replace

import numpy as np
from style_machine_common import (
    ACTED,
    LOCOMOTION,
    agreement,
    alignments,
    body,
    parse,
    paths,
    rms_deg,
    sharing,
    skeleton,
)

from style_core.report import Report
from style_core.style_machine import Settings, analyze, learn, synthesize

HELD_OUT = {'locomotion': ('07_02', '08_02', '35_02', '16_32', '09_02', '16_36'), 'acted': ('131_12', '131_02')}
VARIANTS = [
    {}, {'temperature': 0.0, 'anneal': 0}, {'temperature': 0.5}, {'temperature': 3.0},
    {'temperature': 3.0, 'anneal': 80}, {'heat': 0.0}, {'heat': 0.9}, {'cross_entropy': 0.005}, {'cross_entropy': 0.1},
    {'cross_entropy': 0.5}, {'init': 'frames'}, {'init': 'random'}, {'hint_dimensions': 1}, {'entropy': 5.0}]


def main():
    args = parse(__doc__)
    report = Report('style_machine_schedule', 'Temperature schedules of style machines',
                    'python benchmarks/experiments/style_machine_schedule.py', args.seed,
                    paths([*LOCOMOTION, *ACTED, *HELD_OUT['locomotion'], *HELD_OUT['acted']]))
    report.text('Each row changes the default settings in what it names. Sharing: 1 = every state used by all styles '
                'alike. Agreement: share of frames, aligned in time, that two recordings give the same state. Held '
                'out: RMS error of recordings not trained on, resynthesised from occupancies and style coordinates.')
    for title, names, states in (('locomotion', LOCOMOTION, 16), ('acted', ACTED, 40)):
        motions = [body(name) for name in names]
        held_out = [body(name) for name in HELD_OUT[title]]
        tree = skeleton(names[0])
        aligned, rows = None, []
        for variant in VARIANTS:
            settings = replace(Settings(states=states, seed=args.seed), **variant)
            begin = time.perf_counter()
            machine = learn(motions, settings, skeleton=tree)
            elapsed = time.perf_counter() - begin
            if aligned is None:
                aligned = alignments([machine.encoded(motion) for motion in motions], machine.coordinates.weights)
            labels = list(machine.recordings.values())
            errors = []
            for motion in held_out:
                found = analyze(machine, motion)
                errors.append(rms_deg(synthesize(machine, found.gamma, found.v), motion))
            rows.append([', '.join(f'{k} {v}' for k, v in variant.items()) or 'default',
                         machine.history[-1]['objective'], machine.n_states, sharing(labels, machine.n_states),
                         agreement(labels, aligned)[0], float(np.cumsum(machine.spectrum)[2]),
                         float(np.mean(errors)), elapsed])
            print(title, rows[-1], flush=True)
        report.table(title, ['settings', 'objective', 'states left', 'sharing', 'agreement', 'explained by 3 axes',
                             'held out (deg)', 'training (s)'], rows,
                     f'{title}: {len(names)} recordings, {states} initial states')
    print(report.write(args.output))


if __name__ == '__main__':
    main()
