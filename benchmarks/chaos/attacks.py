"""What careless and hostile peers do; every attack takes a fleet and a seeded generator."""
import os
import signal
import time

from fleet import NODES
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from style_msgs.msg import StateSequence, StyleEstimate, StyleVector
from style_msgs.srv import LoadModel, SetMask, SetStyle

__all__ = ['ATTACKS']

TOPICS = {
    '/joint_trajectory': JointTrajectory(joint_names=['left_hip', 'left_knee'], points=[
        JointTrajectoryPoint(positions=[0.1, 0.2], velocities=[0.0, 0.0])]),
    '/person/joint_states': JointState(name=['lfemur.rx', 'rfemur.rx'], position=[0.1, 0.2]),
    '/predictor/estimate': StyleEstimate(model='locomotion', status=1, phase=1.0, style=[0.1] * 3, behaviours=['walk'],
                                         behaviour_probabilities=[1.0], joint_names=['a'], observed=[True]),
    '/synthesizer/style': StyleVector(name='mean', labels=['a'], values=[0.0]),
    '/synthesizer/sequence': StateSequence(states=[0, 1], dwell_times=[0.5, 0.5], occupancy=[0.5, 0.5], n_states=2),
    '/estop': Bool(data=False)}
NESTED = '(' * 400 + 'mean' + ')' * 400
_publishers = {}


def _publisher(fleet, topic):
    if topic not in _publishers:
        _publishers[topic] = fleet.node.create_publisher(type(TOPICS[topic]), topic, 100)
        time.sleep(0.5)
    return _publishers[topic]


def _damaged(data, rng):
    """A message with a byte changed, cut off, or with a huge length."""
    kind, place = rng.randrange(3), rng.randrange(4, len(data))
    if kind == 0:
        return data[:place] + bytes([rng.randrange(256)]) + data[place + 1:]
    if kind == 1:
        return data[:place]
    place -= place % 4
    return data[:place] + rng.choice([2**32 - 1, 2**31, 10**8]).to_bytes(4, 'little') + data[place + 4:]


def kill(fleet, rng):
    """A node is killed."""
    fleet.kill(rng.choice(NODES), rng.choice([signal.SIGKILL, signal.SIGTERM, signal.SIGINT]))
    time.sleep(0.5)


def pause(fleet, rng):
    """A node stands still for up to 2 s."""
    fleet.pause(rng.choice(NODES), rng.uniform(0.1, 2.0))


def flood(fleet, rng):
    """A topic is flooded with absurd messages."""
    topic = rng.choice(list(TOPICS))
    publisher, wild = _publisher(fleet, topic), [0.0, 1e300, float('nan'), float('inf'), -1e308, 3.0]
    message = {
        '/joint_trajectory': lambda: JointTrajectory(joint_names=['left_hip'], points=[
            JointTrajectoryPoint(positions=[rng.choice(wild)])]),
        '/person/joint_states': lambda: JointState(name=[f'\x1b[31m{rng.random()}\n' * 9 for _ in range(50)],
                                                   position=[0.0] * 50),
        '/predictor/estimate': lambda: StyleEstimate(model='locomotion', status=1, phase=rng.choice(wild),
                                                     phase_velocity=rng.choice(wild), style=[rng.choice(wild)] * 3),
        '/synthesizer/style': lambda: StyleVector(name=rng.choice([NESTED, '[' * 20_000, 'mean' + ' ' * 100_000])),
        '/synthesizer/sequence': lambda: StateSequence(states=[2**32 - 1] * 1000, dwell_times=[1e300] * 1000),
        '/estop': lambda: Bool(data=False)}[topic]
    for _ in range(1500):
        publisher.publish(message())


def damage(fleet, rng):
    """Damaged bytes on every topic."""
    for topic, message in TOPICS.items():
        publisher, data = _publisher(fleet, topic), serialize_message(message)
        for _ in range(200):
            publisher.publish(_damaged(data, rng))


def clock(fleet, rng):
    """The person's clock jumps, and jumps back."""
    if 'clock' not in _publishers:
        _publishers['clock'] = fleet.node.create_publisher(Float64, '/chaos/clock_offset', 10)
        time.sleep(0.5)
    for offset in (rng.choice([-3600.0, -5.0, -0.3, 0.3, 5.0, 3600.0]), 0.0):
        _publishers['clock'].publish(Float64(data=offset))
        time.sleep(rng.uniform(0.3, 1.5))


def disk(fleet, rng):
    """The bridge is started anew, and its flight record soon finds the disk full."""
    fleet.kill('servo_bridge', signal.SIGINT)
    fleet.processes['servo_bridge'].wait(20)
    fleet.start('servo_bridge', disk=200_000)
    fleet.recover(30.0)
    time.sleep(4.0)


def lifecycle(fleet, rng):
    """Transitions that nobody asked for."""
    for _ in range(3):
        request = ChangeState.Request()
        request.transition.label = rng.choice(['configure', 'activate', 'deactivate', 'cleanup', 'nonsense'])
        fleet.call(ChangeState, f'/{rng.choice(NODES)}/change_state', request, 15.0)


def requests(fleet, rng):
    """Services are asked for what makes no sense, and models are loaded that are none."""
    fifo = fleet.folder / 'fifo'
    if not fifo.exists():
        os.mkfifo(fifo)
    for name in ('predictor', 'synthesizer'):
        for path in (str(fifo), '/dev/zero', '/', 'x' * 10_000, ''):
            fleet.call(LoadModel, f'/{name}/load_model', LoadModel.Request(path=path))
    fleet.call(SetStyle, '/synthesizer/set_style', SetStyle.Request(style=StyleVector(name=NESTED)))
    fleet.call(SetStyle, '/synthesizer/set_style', SetStyle.Request(style=StyleVector(values=[1e300] * 1000)))
    fleet.call(SetMask, '/predictor/set_mask', SetMask.Request(joints=['[' * 20_000, '*a' * 9000], masked=True))
    for value in (NESTED, 1, float('nan'), [], ['a'] * 1000):
        for name, parameter in (('synthesizer', 'style'), ('predictor', 'horizon'), ('servo_bridge', 'rate')):
            fleet.call(SetParameters, f'/{name}/set_parameters', SetParameters.Request(
                parameters=[Parameter(parameter, value=value).to_parameter_msg()]))


def stop(fleet, rng):
    """The emergency stop, by topic or service."""
    if rng.random() < 0.5:
        fleet.estop.publish(Bool(data=True))
    else:
        fleet.call(Trigger, '/servo_bridge/estop')
    time.sleep(0.5)


ATTACKS = {one.__name__: one for one in (kill, pause, flood, damage, clock, disk, lifecycle, requests, stop)}
