"""The Dynamixel bus: simulated servos against the e-manual, and the bridge's back end on a line that spoils replies.

    source install/setup.bash
    python3 benchmarks/experiments/servo_bus.py

Writes docs/results/servo/conformance.md (every register of every model whose page of the e-manual was read, tried with
the manufacturer's packet handler) and docs/results/servo/bus_faults.md (exchanges in simulated time with late, doubled,
truncated, foreign, garbled and missing replies). Exit status 1 if anything came out otherwise than it should.
"""
import argparse
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / 'src/style_servo/test'))

from style_core.report import Report  # noqa: E402
from style_servo.conformance import walk  # noqa: E402
from style_servo.control_ranges import PAGES  # noqa: E402

COMMAND = 'python3 benchmarks/experiments/servo_bus.py'


def conformance(output):
    """Write the table of registers; returns how many answers were wrong."""
    report = Report('conformance', 'Simulated Dynamixels against the e-manual', COMMAND, seed=0)
    report.text('Each register was read, written with its smallest and largest value and with what lies just beyond, '
                'in part, and while torque is on; every address at which nothing lies was read and written. Answers '
                'that should come: 4 out of range, 5 part of an item, 6 beyond a limit register, 7 read-only, '
                'undefined or locked.')
    rows, tables, wrong = [], [], 0
    for model in PAGES:
        lines = walk(model)
        bad = sum(len(line.wrong) for line in lines)
        wrong += bad
        rows.append([model, len(lines), sum(len(line.tried) for line in lines), bad])
        tables.append((model, [[line.name, line.address, line.size, line.access, line.range, line.initial,
                                len(line.tried), len(line.wrong)] for line in lines]))
    report.table('models', ['model', 'registers', 'answers', 'wrong'], rows, 'Models')
    for model, lines in tables:
        report.table(model, ['item', 'address', 'size', 'access', 'range', 'when new', 'answers', 'wrong'], lines,
                     model)
    print(report.write(output))
    return wrong


def bus_faults(output, count):
    """Write the counts of spoilt exchanges; returns how many came out wrong."""
    from test_bus_faults import IDS, counts, driven, exchange
    report = Report('bus_faults', 'Spoilt replies on the Dynamixel bus',
                    f'{COMMAND} --count {count}', seed=18)
    report.text(f'{count} exchanges of the bridge with three servos, half of them by Sync Read and half by Fast Sync '
                'Read, two replies in five spoilt, 200 exchanges a second in simulated time. The positions that the '
                'servos show are the number of the request, so a number that belongs to another one is found out.')
    rows, spoilt, wrong = [], {}, 0
    for fast_read in (False, True):
        backend, line = driven(fast_read, seed=18)
        targets = np.random.default_rng(18).uniform(-2.0, 2.0, (1000, 3))
        backend.statistics.update(dict.fromkeys(backend.statistics, 0))
        line.goals.clear()
        line.spoiling = True
        tally = dict.fromkeys(('measured', 'lost', 'other', 'unlike'), 0)
        for k in range(count // 2):
            fresh, whole = exchange(backend, line, targets[k % 1000])
            tally['measured'] += fresh
            tally['lost'] += not whole
            tally['unlike'] += fresh != whole
            tally['other'] += fresh and list(counts(backend.measurement.position)) != [
                line.position_of(line.request, servo_id) for servo_id in IDS]
        goals = np.array([goal for _, goal in line.goals])
        outside = int(np.count_nonzero((goals < backend.bus.servos[0].low) | (goals > backend.bus.servos[0].high)))
        miscounted = abs(backend.statistics['read errors'] - tally['lost'])
        wrong += tally['other'] + tally['unlike'] + outside + miscounted
        rows.append(['Fast Sync Read' if fast_read else 'Sync Read', count // 2, tally['measured'], tally['lost'],
                     backend.statistics['read errors'], backend.statistics['stray replies'], tally['other'], outside])
        for kind, n in line.spoilt.items():
            spoilt.setdefault(kind, []).append(n)
    report.table('exchanges', ['read by', 'exchanges', 'measured', 'a reply was missing', 'counted as read errors',
                               'strays', 'numbers of other packets shown', 'goals beyond the limits'],
                 rows, 'Exchanges')
    report.table('spoilt', ['reply', 'Sync Read', 'Fast Sync Read'],
                 [[kind, *numbers] for kind, numbers in spoilt.items()], 'Spoilt replies')
    print(report.write(output))
    return wrong


def main():
    """Both reports."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--count', type=int, default=100000, help='spoilt exchanges (default %(default)s)')
    parser.add_argument('--output', type=Path, default=ROOT / 'docs/results/servo', help='folder')
    arguments = parser.parse_args()
    return 1 if conformance(arguments.output) + bus_faults(arguments.output, arguments.count) else 0


if __name__ == '__main__':
    sys.exit(main())
