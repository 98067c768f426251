"""The nodes under attack as processes, and what brings them back."""
import json
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

ROOT = Path(__file__).resolve().parents[2]
CHAIN = ROOT / 'config' / 'servo' / 'exosuit6.yaml'
MODEL = ROOT / 'config' / 'models' / 'locomotion.npz'
#: nodes with a lifecycle, in the order of starting
NODES = 'servo_bridge', 'predictor', 'synthesizer'
#: states of the bridge
STREAMING, LATCHED = 3, (5, 6, 7)
#: all is well while nothing is older than this, s
FRESH = 0.6


class Fleet:
    """Simulated servos, bridge, predictor, synthesizer, a person and the judge.

    Parameters
    ----------
    folder : Path
        For logs, records and the port.
    node : rclpy.node.Node
        To speak to them.
    executor : rclpy.executors.Executor
        Of ``node``.
    """

    def __init__(self, folder, node, executor):
        self.folder, self.node, self.executor = folder, node, executor
        self.processes, self.expected, self.deaths, self.lives = {}, set(), [], 0
        self.verdict = {'counts': {}, 'state': -1, 'ages': {}}
        self.records, self.memory, self.clients = [], {}, {}
        self.estop = node.create_publisher(Bool, '/estop', 10)
        for name in ('servos', *NODES, 'person', 'judge'):
            self.start(name)
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        for line in self.processes['judge'].stdout:
            self.verdict = json.loads(line)

    # --- processes ----------------------------------------------------------------------------------------------

    def start(self, name, disk=0):
        """Start a process; ``disk`` is how many bytes it may write to a file, 0 any number."""
        self.lives += 1
        port = self.folder / 'port'
        record = self.folder / f'record_{self.lives}'
        if name == 'servo_bridge':
            self.records.append(record)
        parameters = {
            'servo_bridge': {'chain': CHAIN, 'port': port, 'record': record,
                             'record_folder': self.folder, 'reply_timeout': 0.08, 'watchdog': 2.0,
                             'error_run': 50},
            'predictor': {'model': MODEL},
            'synthesizer': {'model': MODEL, 'robot': 'exosuit6.yaml', 'mode': 'follow'}}.get(name, {})
        module = {'servo_bridge': 'style_servo.bridge_node', 'predictor': 'style_predictor.predictor_node',
                  'synthesizer': 'style_synth.synthesizer_node'}.get(name)
        here = Path(__file__).parent
        remap = {'predictor': ['-r', 'joint_states:=person/joint_states'],
                 'synthesizer': ['-r', 'estimate:=predictor/estimate']}.get(name, [])
        ids = ','.join(f'{k}:{"XM430-W350" if k % 3 == 0 else "XM540-W270"}' for k in range(1, 7))
        command = {'servos': ['-m', 'style_servo.dynamixel_sim', '--link', port, '--servos', ids],
                   'person': [here / 'person.py', MODEL], 'judge': [here / 'judge.py', CHAIN]}.get(
            name, ['-m', module, '--ros-args', *remap,
                   *(word for key, value in parameters.items() for word in ('-p', f'{key}:={value}'))])
        with open(self.folder / f'{name}.log', 'a') as log:
            self.processes[name] = subprocess.Popen(
                [sys.executable, *map(str, command)], stderr=log,
                stdout=subprocess.PIPE if name in ('servos', 'judge') else log, text=True,
                preexec_fn=(lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (disk, disk))) if disk else None)
        if name == 'servos':
            self.processes[name].stdout.readline()

    def kill(self, name, number=signal.SIGKILL):
        """End a process on purpose."""
        self.expected.add(self.processes[name].pid)
        self.processes[name].send_signal(number)

    def look(self):
        """Start anew what has ended; note what ended by itself, and the memory of what lives."""
        for name in NODES:
            process = self.processes[name]
            if process.poll() is not None:
                if process.pid not in self.expected:
                    self.deaths.append((name, process.returncode))
                self.start(name)
                continue
            with open(f'/proc/{process.pid}/status') as facts:
                found = [int(line.split()[1]) / 1024 for line in facts if line.startswith('VmHWM')]
            self.memory[name] = max([self.memory.get(name, 0.0), *found])

    def close(self):
        """End everything, the bridge first."""
        for name in ('servo_bridge', 'synthesizer', 'predictor', 'person', 'judge', 'servos'):
            process = self.processes[name]
            process.send_signal(signal.SIGCONT)
            process.send_signal(signal.SIGTERM if name == 'servos' else signal.SIGINT)
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    # --- talking ------------------------------------------------------------------------------------------------

    def call(self, kind, name, request=None, seconds=3.0):
        """Response of a service, or None."""
        if name not in self.clients:
            self.clients[name] = self.node.create_client(kind, name)
        client = self.clients[name]
        if not client.service_is_ready():
            return None
        future = client.call_async(request or kind.Request())
        self.executor.spin_until_future_complete(future, seconds)
        return future.result() if future.done() else None

    def change(self, name, label):
        """Ask for a transition; whether it succeeded."""
        request = ChangeState.Request()
        request.transition.label = label
        answer = self.call(ChangeState, f'/{name}/change_state', request, 15.0)
        return answer is not None and answer.success

    def healthy(self):
        """Whether the robot follows the person."""
        ages = self.verdict['ages']
        return self.verdict['state'] == STREAMING and all(
            ages.get(name, 1e6) < FRESH for name in ('command', 'window', 'tracking'))

    def heal(self):
        """Do what an operator would: start, configure, activate, reset."""
        self.look()
        for name in NODES:
            answer = self.call(GetState, f'/{name}/get_state')
            label = answer.current_state.label if answer else ''
            if label == 'unconfigured':
                self.change(name, 'configure') and self.change(name, 'activate')
            elif label == 'inactive':
                self.change(name, 'activate')
            elif label == 'finalized':
                self.kill(name)
        if self.verdict['state'] in LATCHED:
            self.estop.publish(Bool(data=False))
            self.call(Trigger, '/servo_bridge/reset')
        wanted = [Parameter('mode', value='follow').to_parameter_msg(), Parameter('style', value='').to_parameter_msg()]
        self.call(SetParameters, '/synthesizer/set_parameters', SetParameters.Request(parameters=wanted))

    def recover(self, seconds=90.0):
        """Heal until all is well; the time that took, s, or None where it did not."""
        begun = time.monotonic()
        while time.monotonic() - begun < seconds:
            if self.healthy() and all(self.processes[name].poll() is None for name in NODES):
                return time.monotonic() - begun
            self.heal()
            self.executor.spin_once(timeout_sec=0.1)
        return None

    def pause(self, name, seconds):
        """Stop a process for a while."""
        os.kill(self.processes[name].pid, signal.SIGSTOP)
        time.sleep(seconds)
        os.kill(self.processes[name].pid, signal.SIGCONT)
