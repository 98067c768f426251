"""Experiment 4: the content of one recording in the style of another.

    python benchmarks/experiments/style_machine_4_transfer.py
"""
import numpy as np
from scipy.signal import butter, filtfilt
from style_machine_common import LOCOMOTION, body, parse, paths, skeleton

from style_core.pictures import stick_strip
from style_core.report import Report
from style_core.style_machine import Settings, analyze, learn, synthesize
from style_core.style_machine.choreography import scale_dwell

PAIRS = (('07_01', '09_01'), ('09_01', '07_01'), ('07_01', '16_16'), ('16_16', '08_01'), ('35_01', '02_03'),
         ('02_03', '35_01'), ('08_01', '16_35'), ('16_35', '07_05'), ('07_05', '02_01'), ('35_17', '09_01'))


def jerk(motion, cut_off_hz=8.0):
    """RMS third difference below the cut-off frequency (above it the recordings hold noise), rad/s^3."""
    smooth = filtfilt(*butter(4, 2 * cut_off_hz / motion.rate_hz), motion.positions, axis=0)
    return float(np.sqrt((np.diff(smooth, 3, axis=0) ** 2).mean()) * motion.rate_hz ** 3)


def beyond(motion, low, high):
    """Share of values more than two degrees beyond joint limits."""
    tolerance = np.radians(2.0)
    return float(((motion.positions < low - tolerance) | (motion.positions > high + tolerance)).mean())


def main():
    args = parse(__doc__, states=16)
    tree = skeleton()
    motions = {name: body(name) for name in LOCOMOTION}
    machine = learn(list(motions.values()), Settings(states=args.states, seed=args.seed), skeleton=tree)
    real = np.concatenate([np.abs(np.diff(motion.positions, axis=0)) for motion in motions.values()])
    # limits the recordings themselves keep: the file's limits are narrower than what its own recordings do
    low = np.min([motion.positions.min(axis=0) for motion in motions.values()], axis=0)
    high = np.max([motion.positions.max(axis=0) for motion in motions.values()], axis=0)
    file_low, file_high = tree.limits(machine.joint_names)
    report = Report('style_machine_4_transfer', 'Style transfer',
                    'python benchmarks/experiments/style_machine_4_transfer.py', args.seed, paths(LOCOMOTION))
    rows, steps = [], []
    for a, b in PAIRS:
        content = analyze(machine, motions[a])
        made = synthesize(machine, content.gamma, b, dwell=content.emission.dwell)
        again = analyze(machine, made.replace(name='made'))
        wanted = scale_dwell(content.path, content.emission.dwell, machine.at(b).dwell)
        n = min(len(wanted), len(again.path))
        step = float(np.abs(np.diff(made.positions, axis=0)).max())
        steps.append(step)
        rows.append([f'{a} as {b}', analyze(machine, motions[a]).distances[b], again.distances[b], again.nearest,
                     float(np.mean(wanted[:n] == again.path[:n])), jerk(made) / jerk(motions[a]),
                     jerk(made) / jerk(motions[b]), np.degrees(step), 100 * beyond(made, low, high),
                     100 * beyond(made, file_low, file_high), 100 * beyond(motions[a], file_low, file_high)])
    report.table('pairs', ['content as style', 'style distance to B before', 'after', 'nearest style now',
                           'content kept (same state)', 'jerk / jerk of A', 'jerk / jerk of B', 'largest step (deg)',
                           'beyond range of all recordings (%)', 'beyond limits of the file (%)', 'A itself (%)'], rows,
                 'Content of A in the style of B, analysed again')
    report.text(f'Largest step from one frame to the next: {np.degrees(max(steps)):.1f} degrees in the synthesised '
                f'motion, {np.degrees(real.max()):.1f} in the recordings (a wrist that passes gimbal lock), whose '
                f'99.9 % quantile over frames and joints is {np.degrees(np.quantile(real, 0.999)):.1f}. Jerk below '
                '8 Hz. Beyond = more than two degrees beyond.')
    found = analyze(machine, motions['07_01'])
    strips = [('07_01 as recorded', motions['07_01'])] + [
        (f'07_01 as {b}', synthesize(machine, found.gamma, b, dwell=found.emission.dwell))
        for b in ('09_01', '16_35', '02_03', '35_01')]
    report.figure(stick_strip(tree, strips, 10), 'strips', 'The same content in the styles of other recordings (root '
                  'not modelled: poses stand on the spot).')
    print(report.write(args.output))


if __name__ == '__main__':
    main()
