"""Start and stop launch files: the demo and the benchmarks of the whole chain."""
import os
import signal
import subprocess

__all__ = ['launch', 'stop']


def launch(arguments, log):
    """``ros2 launch`` with all its nodes in a process group of its own, told to the open file ``log``."""
    return subprocess.Popen(['ros2', 'launch', *arguments], stdout=log, stderr=subprocess.STDOUT,
                            start_new_session=True)


def stop(nodes):
    """Ask what `launch` started to end, and see to it after ten seconds."""
    if nodes.poll() is None:
        os.killpg(nodes.pid, signal.SIGINT)
        try:
            nodes.wait(10)
        except subprocess.TimeoutExpired:
            os.killpg(nodes.pid, signal.SIGKILL)
            nodes.wait()
