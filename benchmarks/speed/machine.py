"""The machine a latency is measured on: its cores kept awake on request, and how much of them was taken away."""
import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

__all__ = ['add_argument', 'watched', 'processor_time']

#: runs only where a core has nothing else to do, and gives it back at once
IDLE_WORK = 'import os\nos.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))\nwhile True: pass'


def add_argument(parser):
    """The option --awake."""
    parser.add_argument('--awake', action='store_true',
                        help='keep every core from going to sleep, by idle work of the lowest class (a robot writes 0 '
                             'to /dev/cpu_dma_latency for it)')


@contextmanager
def watched(awake):
    """Keep cores awake where wanted; at the end say so, and what share of them the host of a virtual machine took."""
    busy = [subprocess.Popen(['taskset', '-c', str(core), sys.executable, '-c', IDLE_WORK])
            for core in sorted(os.sched_getaffinity(0)) if awake]
    before = _ticks()
    try:
        yield
    finally:
        total, stolen = (now - then for now, then in zip(_ticks(), before))
        for process in busy:
            process.kill()
            process.wait()
        print(f'cores {"kept awake" if awake else "free to sleep"}; a host took '
              f'{100 * stolen / max(total, 1):.2f} % of their time away')


def processor_time(pid):
    """Processor time of a process so far, s."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def _ticks():
    """Processor time of all kinds since the machine started, and the part that a host took."""
    fields = [int(x) for x in Path('/proc/stat').read_text().split('\n', 1)[0].split()[1:9]]
    return sum(fields), fields[7]
