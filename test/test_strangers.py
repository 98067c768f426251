"""Careless and hostile peers, over real middleware: damaged bytes, texts without measure, files that are none."""
import contextlib
import itertools
import os
import random
import re
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import harness
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from harness import Probe, stamp_of
from rclpy.action import ActionClient
from rclpy.node import NodeNameNonExistentError
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from style_msgs.action import Synthesize
from style_msgs.msg import StateSequence, StyleEstimate, StyleVector, SynthesisStatus
from style_msgs.srv import LoadModel, SetMask, SetStyle
from style_node.qos import OVERRIDABLE

MODELS = harness.ROOT / 'config' / 'models'
RANDOM = random.Random(22)
#: what nodes may take for messages that are refused, MiB
ROOM_MIB = 150
COUNT = itertools.count(1)
MODULES = {'synthesizer': 'style_synth.synthesizer_node', 'predictor': 'style_predictor.predictor_node'}


class Tried(Probe):
    """A node as a process of its own in a domain of its own, and a peer that does it no good."""

    def __init__(self, name, folder, *arguments, **parameters):
        harness.own_domain('y' * next(COUNT))     # 121 and 100 have no common divisor
        self.environment = dict(os.environ)
        super().__init__(name, {'/joint_trajectory': (JointTrajectory, None), '/diagnostics': (DiagnosticArray, None),
                                '/synthesizer/status': (SynthesisStatus, None)})
        self.closed = False
        self.log_path = Path(folder) / f'{name}_{os.environ["ROS_DOMAIN_ID"]}.log'
        words = [word for key, value in {'model': MODELS / 'locomotion.npz', **parameters}.items()
                 for word in ('-p', f'{key}:={value}')]
        with open(self.log_path, 'w') as log:
            self.process = subprocess.Popen([sys.executable, '-m', MODULES[name], '--ros-args', *words, *arguments],
                                            stderr=log)

    def begin(self):
        """Configure and activate; self."""
        assert self.wait(lambda: self.state() == 'unconfigured', 30.0)
        assert self.transition('configure'), self.log()
        assert self.transition('activate')
        return self

    def log(self):
        return self.log_path.read_text(errors='replace')

    def memory_mib(self):
        """The most it has taken so far."""
        with open(f'/proc/{self.process.pid}/status') as facts:
            return next(int(line.split()[1]) for line in facts if line.startswith('VmHWM')) / 1024

    def facts(self):
        """Values of the last report of the node."""
        heard = [status for message in self.heard['/diagnostics'] for status in message.status
                 if status.name.startswith(self.target)]
        return {pair.key: pair.value for pair in heard[-1].values} if heard else {}

    def alive(self):
        """Whether it goes on: it answers, and reports."""
        self.heard['/diagnostics'].clear()
        return self.process.poll() is None and self.state() == 'active' and bool(self.wait(self.facts, 5.0))

    def publisher_to(self, kind, topic, qos=10):
        publisher = self.node.create_publisher(kind, topic, qos)
        assert self.wait(lambda: publisher.get_subscription_count() > 0)
        return publisher

    def close(self):
        if self.closed:
            return
        self.closed = True
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(20)
            except subprocess.TimeoutExpired:
                self.process.kill()
        super().close()


@pytest.fixture
def start(tmp_path):
    made = []

    def make(name, *arguments, **parameters):
        made.append(Tried(name, tmp_path, *arguments, **parameters))
        return made[-1]
    yield make
    for one in made:
        one.close()


@pytest.fixture(scope='module')
def one_synthesizer(tmp_path_factory):
    tried = Tried('synthesizer', tmp_path_factory.mktemp('nodes')).begin()
    yield tried
    tried.close()


@pytest.fixture(scope='module')
def predictor(tmp_path_factory):
    """The same node for every test: none may leave it the worse."""
    tried = Tried('predictor', tmp_path_factory.mktemp('nodes')).begin()
    yield tried
    tried.close()


@pytest.fixture
def synthesizer(one_synthesizer):
    """The same node for every test, in the same mode and with the same model."""
    one_synthesizer.call(LoadModel, 'load_model', path=str(MODELS / 'locomotion.npz'), timeout=60.0)
    assert one_synthesizer.set_parameters(mode='cycle', style='') == ''
    one_synthesizer.spin(1.0)       # until it has gone over
    for messages in one_synthesizer.heard.values():
        messages.clear()
    return one_synthesizer


NESTED = '(' * 400 + 'mean' + ')' * 400
TEXTS = [NESTED, '[' * 20_000, '-' * 5000 + 'mean', '1e6*' * 900 + 'mean', 'mean' + ' ' * 1_000_000,
         '\x1b[31m\n[ERROR] forged\n' * 20]


def test_texts_without_measure_are_refused_by_topic_service_and_parameter(synthesizer):
    topic = synthesizer.publisher_to(StyleVector, '/synthesizer/style')
    for text in TEXTS:
        topic.publish(StyleVector(name=text))
        answer = synthesizer.call(SetStyle, 'set_style', style=StyleVector(name=text))
        assert not answer.success and len(answer.message) < 1100 and answer.message.isprintable()
        reason = synthesizer.set_parameters(style=text)
        assert reason and len(reason) < 1100
    assert synthesizer.alive() and 'callbacks failed' not in synthesizer.facts()
    assert synthesizer.call(SetStyle, 'set_style', style=StyleVector(name='generic')).success
    assert '\x1b[31m' not in synthesizer.log() and '\n[ERROR] forged' not in synthesizer.log()
    assert len(synthesizer.log()) < 50_000


def test_patterns_and_names_without_measure_are_refused(predictor):
    for pattern in ('[' * 20_000, '*a' * 5000, 'x' * 1_000_000):
        answer = predictor.call(SetMask, 'set_mask', joints=[pattern], masked=True)
        assert not answer.success and 'refused' in answer.message and len(answer.message) < 1100
    assert not predictor.call(SetMask, 'set_mask', joints=['a'] * 10_000, masked=True).success
    for _ in range(3):
        names = [f'\x1b[31m\nforged {number} ' + 'x' * 200 for number in range(300)]
        predictor.send(names, [0.0] * 300, predictor.now())
        predictor.send(['y' * 200_000], [0.0], predictor.now())
        predictor.send([f'{number}' for number in range(20_000)], [0.0] * 20_000, predictor.now())
    assert predictor.wait(lambda: int(predictor.facts().get('rejected: unreadable', 0)) >= 1)
    assert predictor.wait(lambda: 'forged' in predictor.facts().get('unknown joints', ''))
    assert max(len(serialize_message(message)) for message in predictor.heard['/diagnostics']) < 50_000
    assert '\x1b[31m' not in predictor.log() and '\nforged' not in predictor.log()
    assert predictor.alive()


def damaged(data, count):
    """So many messages: bytes changed one by one, cut off, with huge lengths."""
    for _ in range(count):
        kind, place = RANDOM.randrange(3), RANDOM.randrange(4, len(data))
        if kind == 0:
            yield data[:place] + bytes([RANDOM.randrange(256)]) + data[place + 1:]
        elif kind == 1:
            yield data[:place]
        else:
            place -= place % 4
            length = RANDOM.choice([2**32 - 1, 2**31 - 1, 2**31, 10**8, 10**6])
            yield data[:place] + length.to_bytes(4, 'little') + data[place + 4:]


def fuzz(tried, kind, topic, message, qos=100):
    """Send damaged messages, then look at the memory."""
    publisher, data = tried.publisher_to(kind, topic, qos), serialize_message(message)
    before = tried.memory_mib()
    for number, broken in enumerate(damaged(data, 1500)):
        publisher.publish(broken)
        if number % 50 == 0:
            tried.spin(0.02)
    assert tried.alive(), tried.log()
    assert tried.memory_mib() < before + ROOM_MIB
    tried.node.destroy_publisher(publisher)


def test_damaged_bytes_on_every_topic_of_the_synthesizer_cost_nothing(synthesizer):
    assert synthesizer.set_parameters(mode='follow') == ''
    fuzz(synthesizer, StyleEstimate, '/estimate', StyleEstimate(
        model='locomotion', status=1, phase=1.0, phase_velocity=3.0, style=[0.1] * 3, style_covariance=[0.0] * 9,
        behaviours=['walk', 'run'], behaviour_probabilities=[0.5, 0.5], joint_names=['hip', 'knee'],
        observed=[True, False]))
    fuzz(synthesizer, StyleVector, '/synthesizer/style', StyleVector(name='mean', labels=['a', 'b'], values=[0.0, 1.0]))
    fuzz(synthesizer, StateSequence, '/synthesizer/sequence', StateSequence(
        name='s', states=[0, 1], dwell_times=[0.5, 0.5], occupancy=[0.5] * 8, n_states=2, step=0.1))
    counts = synthesizer.facts()
    assert int(counts['estimate refused']) > 100 and int(counts['style refused']) > 100
    assert 'callbacks failed' not in counts


def test_damaged_bytes_on_every_topic_of_the_predictor_cost_nothing(predictor):
    message = JointState(name=['lfemur.rx', 'rfemur.rx'], position=[0.1, 0.2], velocity=[0.0, 0.0])
    fuzz(predictor, JointState, '/joint_states', message)
    assert int(predictor.facts()['rejected: unreadable']) > 100 and 'callbacks failed' not in predictor.facts()


def test_every_subscription_of_the_nodes_is_among_those_that_are_fuzzed(synthesizer, predictor):
    heard = {synthesizer: {'/estimate', '/synthesizer/style', '/synthesizer/sequence'}, predictor: {'/joint_states'}}
    for tried, topics in heard.items():
        def found(tried=tried):
            with contextlib.suppress(NodeNameNonExistentError):     # not discovered yet
                return {topic for topic, _ in tried.node.get_subscriber_names_and_types_by_node(tried.target, '/')}
            return set()
        assert tried.wait(lambda topics=topics, found=found: topics <= found())
        assert found() - {'/parameter_events', '/clock'} == topics


@pytest.fixture
def odd_files(tmp_path):
    """What is no model file, and must not be waited for or unpacked."""
    os.mkfifo(tmp_path / 'fifo.npz')
    (tmp_path / 'folder.npz').mkdir()
    os.symlink('/dev/zero', tmp_path / 'zero.npz')
    with zipfile.ZipFile(tmp_path / 'bomb.npz', 'w', zipfile.ZIP_DEFLATED, compresslevel=1) as made:
        for name in 'abcd':
            with made.open(name + '.npy', 'w') as stream:
                for _ in range(140):
                    stream.write(bytes(1 << 20))
    return [tmp_path / name for name in ('fifo.npz', 'folder.npz', 'zero.npz', 'bomb.npz')]


@pytest.mark.parametrize('name', ['synthesizer', 'predictor'])
def test_what_is_no_model_file_is_refused_and_the_next_is_loaded(request, name, odd_files):
    tried = request.getfixturevalue(name)
    before = tried.memory_mib()
    for path in (*map(str, odd_files), '', 'x' * 100_000):
        answer = tried.call(LoadModel, 'load_model', path=path)
        assert answer is not None and not answer.success and answer.message, path
    assert tried.memory_mib() < before + ROOM_MIB
    assert tried.call(LoadModel, 'load_model', path=str(MODELS / 'everyday.npz'), timeout=60.0).success


@pytest.mark.parametrize('name', ['synthesizer', 'predictor'])
def test_a_signal_while_a_model_is_loaded_ends_the_node(start, name):
    tried = start(name).begin()
    client = tried.node.create_client(LoadModel, f'/{name}/load_model')
    assert tried.wait(client.service_is_ready)
    for _ in range(3):
        client.call_async(LoadModel.Request(path=str(MODELS / 'everyday.npz')))
    tried.spin(0.2)
    tried.process.send_signal(signal.SIGTERM)
    assert tried.process.wait(20) == 0


def test_parameters_that_were_dumped_can_be_given_again(predictor, start, tmp_path):
    # its own discovery, with time for it: the daemon may be another test's
    dumped = subprocess.run(['ros2', 'param', 'dump', '--no-daemon', '--spin-time', '5', '/predictor'],
                            stdout=subprocess.PIPE, text=True, timeout=60, env=predictor.environment)
    assert 'masked_joints' in dumped.stdout
    (tmp_path / 'dump.yaml').write_text(dumped.stdout)
    again = start('predictor', '--params-file', str(tmp_path / 'dump.yaml')).begin()
    assert again.set_parameters(horizon=0.3) == ''


def test_an_empty_list_on_the_command_line_is_an_empty_list(tmp_path):
    done = subprocess.run([sys.executable, '-m', 'style_predictor.player_node', '--ros-args', '-p', 'drop:=[]',
                           '-p', 'joints:=[]', '-p', 'file:=/absent.csv'], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and 'absent.csv does not exist' in done.stderr


def test_a_clock_that_is_set_back_does_not_silence_the_synthesizer(start):
    tried = start('synthesizer', mode='follow', use_sim_time='true')
    clock = tried.node.create_publisher(Clock, '/clock', 10)

    def tick(seconds):
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(round(seconds * 1e9), 10**9)
        clock.publish(message)
        tried.spin(0.01)
    tried.begin()
    estimates = tried.publisher_to(StyleEstimate, '/estimate')
    for number in range(100):
        tick(1000 + number * 0.02)
        message = StyleEstimate(status=StyleEstimate.TRACKING, phase=number * 0.06 % 6.28, phase_velocity=3.0)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(round((1000 + number * 0.02) * 1e9), 10**9)
        estimates.publish(message)
    assert tried.wait(lambda: tried.heard['/joint_trajectory'])
    tried.heard['/joint_trajectory'].clear()
    for number in range(150):     # nobody is followed now, and the clock starts anew
        tick(10 + number * 0.02)
    stamps = [stamp_of(message) * 1e-9 for message in tried.heard['/joint_trajectory']]
    late = [stamp for stamp in stamps if stamp < 100]
    assert len(late) > 10 and late == sorted(late)


def test_absurd_estimates_are_refused_and_move_nothing(synthesizer):
    tried = synthesizer
    assert tried.set_parameters(mode='follow') == ''
    estimates = tried.publisher_to(StyleEstimate, '/estimate')

    def send(**fields):
        message = StyleEstimate(model='locomotion', status=StyleEstimate.TRACKING, **fields)
        message.header.stamp = tried.node.get_clock().now().to_msg()
        estimates.publish(message)
        tried.spin(0.02)
    for _ in range(60):     # until it stands there
        send(phase=1.0, phase_velocity=0.0)
    tried.heard['/joint_trajectory'].clear()
    before = int(tried.facts().get('estimate refused', 0))
    for _ in range(10):
        for wild in ({'phase': 1e308}, {'phase': -1e300}, {'phase_velocity': 1e308}, {'phase': float('nan')},
                     {'style': [1e300] * 3}, {'style': [float('inf')] * 3}):
            send(**{'phase': 1.0, 'phase_velocity': 0.0, **wild})
    windows = tried.heard['/joint_trajectory']
    first = [message.points[0].positions for message in windows]
    assert len(first) > 20
    assert max(abs(a - b) for one, two in itertools.pairwise(first) for a, b in zip(one, two)) < 0.02
    assert tried.wait(lambda: int(tried.facts().get('estimate refused', 0)) >= before + 30)


def test_a_goal_has_its_result_when_the_node_is_cleaned_up_meanwhile(synthesizer):
    client = ActionClient(synthesizer.node, Synthesize, '/synthesizer/synthesize')
    assert synthesizer.wait(client.server_is_ready)
    asked = client.send_goal_async(Synthesize.Goal(duration=60.0, stream=True))
    assert synthesizer.wait(asked.done) and asked.result().accepted
    outcome = asked.result().get_result_async()
    synthesizer.spin(0.3)
    assert synthesizer.transition('deactivate') and synthesizer.transition('cleanup')
    assert synthesizer.wait(outcome.done), 'no result'
    assert not outcome.result().result.success and 'taken down' in outcome.result().result.message
    refused = client.send_goal_async(Synthesize.Goal(duration=1.0))
    assert synthesizer.wait(refused.done) and not refused.result().accepted
    assert synthesizer.transition('configure') and synthesizer.transition('activate')
    again = client.send_goal_async(Synthesize.Goal(duration=1.0))
    assert synthesizer.wait(again.done) and again.result().accepted
    done = again.result().get_result_async()
    assert synthesizer.wait(done.done) and done.result().result.success


@pytest.mark.parametrize(('name', 'topics'), [
    ('predictor', ['/joint_states']), ('synthesizer', ['/estimate', '/synthesizer/style', '/synthesizer/sequence'])])
def test_every_quality_of_service_that_is_documented_can_be_overridden(start, name, topics):
    wanted = {'history': 'keep_last', 'depth': 7, 'reliability': 'reliable', 'durability': 'transient_local'}
    assert set(wanted) == set(OVERRIDABLE)
    tried = start(name, **{f'qos_overrides.{topic}.subscription.{policy}': value
                           for topic in topics for policy, value in wanted.items()}).begin()
    for topic in topics:
        found = tried.wait(lambda topic=topic: [one.qos_profile for one in
                                                tried.node.get_subscriptions_info_by_topic(topic)
                                                if one.node_name == name])
        assert found[0].reliability.name == 'RELIABLE' and found[0].durability.name == 'TRANSIENT_LOCAL'


def documented_qualities():
    """Topic (node first) -> the quality of service that the documentation gives it."""
    page = (harness.ROOT / 'docs' / 'strangers.md').read_text()
    rows = [line.strip('| \n').split(' | ') for line in page.splitlines()
            if line.startswith(('| predictor `', '| synth'))]
    return {(what.split()[0], topic, what.rsplit('(')[1].rstrip(')')): quality.split(', ')
            for what, quality, _ in rows for topic in re.findall('`(.*?)`', what)}


@pytest.mark.parametrize('name', ['synthesizer', 'predictor'])
def test_the_table_of_qualities_is_what_the_middleware_says(request, name):
    tried, node = request.getfixturevalue(name), request.getfixturevalue(name).node
    asked = 0
    for (who, topic, way), quality in documented_qualities().items():
        if who != name:
            continue
        asked += 1
        full = topic.replace('~', f'/{name}') if topic.startswith('~') else f'/{topic}'
        ask = node.get_subscriptions_info_by_topic if way == 'in' else node.get_publishers_info_by_topic
        found = tried.wait(lambda full=full, ask=ask: [one for one in ask(full) if one.node_name == name])
        assert found, full
        profile = found[0].qos_profile
        assert [profile.reliability.name, profile.durability.name] == [
            word.upper().replace(' ', '_') for word in quality[:2]], full
    assert asked == {'synthesizer': 7, 'predictor': 7}[name]
