"""Start and stop launch files: the demo and the benchmarks of the whole chain."""
import os
import signal
import subprocess
from pathlib import Path

__all__ = ['stay_alone', 'launch', 'stop']


def stay_alone():
    """Nodes of this process and of what it launches hear nobody else, find each other soon, and use one core each."""
    os.environ['ROS_LOCALHOST_ONLY'] = '1'
    os.environ['ROS_DOMAIN_ID'] = os.environ.get('STYLE_DEMO_DOMAIN', str(1 + os.getpid() % 100))
    os.environ.setdefault('FASTRTPS_DEFAULT_PROFILES_FILE',
                          str(Path(__file__).resolve().parents[1] / 'config' / 'fastdds_prompt.xml'))
    os.environ.setdefault('OMP_NUM_THREADS', '1')


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
