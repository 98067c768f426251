"""The commands of ros2cli that a Humble from PyPI lacks and scripts/ros_prefix adds."""
import os
import signal
import subprocess
import threading
import time
from importlib.util import find_spec

import pytest
import rclpy
from rclpy.action import ActionServer, CancelResponse
from rclpy.executors import MultiThreadedExecutor

from style_msgs.action import Synthesize

pytestmark = pytest.mark.skipif(find_spec('style_ros2_verbs') is None, reason="this Humble has ros2cli's own commands")

GOAL = ('action', 'send_goal', '/slow', 'style_msgs/action/Synthesize')


def ros2(*words):
    """Exit status and everything said."""
    done = subprocess.run(['ros2', *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=60)
    return done.returncode, done.stdout


@pytest.mark.parametrize(('words', 'said'), [
    ((*GOAL[:3], 'style_msgs/action/Nonsense', '{}'), 'not a known action type'),
    ((*GOAL[:3], 'nonsense', '{}'), 'not a known action type'),
    ((*GOAL, '{duration: [}'), 'not YAML'),
    ((*GOAL, '5'), 'must be a mapping'),
    ((*GOAL, '{wrong: 1.0}'), 'does not fit'),
    ((*GOAL, '{duration: hello}'), 'does not fit'),
    (('interface', 'show', 'style_msgs/msg/Nothing'), 'Unknown interface'),
    (('interface', 'package', 'nothing'), 'Unknown package'),
    (('launch', 'nothing', 'x.launch.py'), 'not found'),
    (('launch', 'style_bringup', 'predict.launch.py', 'model'), 'malformed launch argument'),
])
def test_wrong_words_are_refused_without_a_traceback(words, said):
    status, text = ros2(*words)
    assert status == 1 and said in text and 'Traceback' not in text


def test_ctrl_c_cancels_the_goal():
    seen = threading.Event()

    def execute(handle):
        while not handle.is_cancel_requested:
            handle.publish_feedback(Synthesize.Feedback())
            time.sleep(0.05)
        handle.canceled()
        seen.set()
        return Synthesize.Result()

    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('slow_server', context=context)
    server = ActionServer(node, Synthesize, '/slow', execute, cancel_callback=lambda _: CancelResponse.ACCEPT)
    executor = MultiThreadedExecutor(4, context=context)
    executor.add_node(node)
    spinning = threading.Thread(target=executor.spin, daemon=True)
    spinning.start()
    try:
        client = subprocess.Popen(['ros2', *GOAL, '{duration: 60.0}', '--feedback', '--wait', '20'],
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        said = []
        for line in client.stdout:
            said.append(line)
            if 'Feedback' in line:
                break
        client.send_signal(signal.SIGINT)
        said += client.communicate(timeout=30)[0].splitlines(keepends=True)
        text = ''.join(said)
        assert seen.wait(5.0), text
        assert client.returncode == 1 and 'Goal finished with status: CANCELED' in text and 'Traceback' not in text
    finally:
        executor.shutdown()
        spinning.join(5.0)
        server.destroy()
        node.destroy_node()
        rclpy.try_shutdown(context=context)


INTERRUPTED = """
import signal
from asyncio import base_subprocess
from launch import LaunchDescription
from launch.actions import ExecuteProcess

tell = base_subprocess.BaseSubprocessTransport._call

def interrupt(self, what, *all):
    if what.__name__ == 'process_exited':
        signal.raise_signal(signal.SIGINT)
    tell(self, what, *all)
base_subprocess.BaseSubprocessTransport._call = interrupt

def generate_launch_description():
    return LaunchDescription([ExecuteProcess(cmd=['true'])])
"""


def test_ctrl_c_at_the_worst_moment_ends_a_launch(tmp_path):
    # right before the launch notes that a process has ended, for which it waits at the end
    path = tmp_path / 'interrupted.launch.py'
    path.write_text(INTERRUPTED)
    status, text = ros2('launch', str(path))
    assert status == 0 and 'process has finished cleanly' in text and 'Traceback' not in text, text


def test_a_second_ctrl_c_does_not_interrupt_a_bridge_that_ends():
    process = subprocess.Popen(['ros2', 'launch', 'style_bringup', 'servo.launch.py', 'sim:=true'],
                               stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True)
    patience = threading.Timer(60.0, os.killpg, (process.pid, signal.SIGKILL))
    patience.start()
    said = []
    try:
        for line in process.stdout:
            said.append(line)
            if 'READY' in line:
                os.killpg(process.pid, signal.SIGINT)  # as a terminal does: everyone gets it
                time.sleep(0.05)
                os.killpg(process.pid, signal.SIGINT)
            if '[bridge-2]: process has' in line:
                break
    finally:
        patience.cancel()
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    assert '[bridge-2]: process has finished cleanly' in said[-1], ''.join(said)


def test_sigterm_to_a_launch_alone_ends_what_it_launched(tmp_path):
    # a service manager, a container or a script tells the launch only; simulator and bridge are not to stay behind
    process = subprocess.Popen(['ros2', 'launch', 'style_bringup', 'servo.launch.py', 'sim:=true',
                                f'sim_link:={tmp_path / "port"}'],
                               stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True)
    patience = threading.Timer(60.0, os.killpg, (process.pid, signal.SIGKILL))
    patience.start()
    said = []
    try:
        for line in process.stdout:
            said.append(line)
            if 'READY' in line:
                process.terminate()
        text = ''.join(said)
        assert process.wait(20) == 0, text
        assert text.count('process has finished cleanly') == 2, text
        with pytest.raises(ProcessLookupError):
            os.killpg(process.pid, 0)       # nobody is left
    finally:
        patience.cancel()
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        process.stdout.close()
