"""The shipped policies hold: enclaves do what they are for, and nobody else commands motors.

The Fast DDS of the prefix is built without DDS Security, so this runs over Cyclone DDS. Certificates and signatures are
checked with openssl's own commands, enforcement by the middleware.
"""
import os
import shutil
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
POLICIES = ROOT / 'config/security/policies.xml'

pytestmark = pytest.mark.skipif(
    os.environ.get('RMW_IMPLEMENTATION') != 'rmw_cyclonedds_cpp' or not shutil.which('openssl'),
    reason='needs Cyclone DDS and openssl')

#: publishes points named after itself until it is killed
SPEAKER = """
import sys, rclpy
from trajectory_msgs.msg import JointTrajectory
rclpy.init(args=sys.argv)
node = rclpy.create_node('speaker', start_parameter_services=False, enable_rosout=False)
publisher = node.create_publisher(JointTrajectory, '/joint_trajectory', 10)
message = JointTrajectory(joint_names=[sys.argv[1]])
print('speaks', flush=True)
node.create_timer(0.05, lambda: publisher.publish(message))
rclpy.spin(node)
"""
#: prints whom it hears
LISTENER = """
import sys, rclpy
from trajectory_msgs.msg import JointTrajectory
rclpy.init(args=sys.argv)
node = rclpy.create_node('listener', start_parameter_services=False, enable_rosout=False)
node.create_subscription(JointTrajectory, '/joint_trajectory', lambda m: print(*m.joint_names, flush=True), 10)
print('listens', flush=True)
rclpy.spin(node)
"""


@pytest.fixture(scope='module')
def keystore(tmp_path_factory):
    folder = tmp_path_factory.mktemp('keys') / 'keystore'
    subprocess.run([sys.executable, ROOT / 'scripts/security_keystore.py', folder], check=True, capture_output=True)
    return folder


@pytest.fixture
def start(keystore):
    """Start programs, secured where an enclave is given; they end with the test."""
    running = []

    def one(program, name, enclave=None):
        environment = {**os.environ, 'ROS_SECURITY_STRATEGY': 'Enforce', 'ROS_SECURITY_KEYSTORE': str(keystore),
                       'ROS_SECURITY_ENABLE': 'true' if enclave else 'false'}
        arguments = ['--ros-args', '--enclave', enclave] if enclave else []
        process = subprocess.Popen([sys.executable, '-c', program, name, *arguments], env=environment, text=True,
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        running.append(process)
        return process

    yield one
    for process in running:
        process.kill()
        process.communicate()


def heard(listener, wanted):
    """Lines of a listener up to the first that is ``wanted``."""
    lines = []
    for line in listener.stdout:
        lines.append(line.strip())
        if lines[-1] == wanted:
            return lines
    raise AssertionError(f'{wanted} was never heard: {lines}, {listener.stderr.read()}')


def test_openssl_confirms_every_identity_and_signature(keystore):
    authority = keystore / 'public/ca.cert.pem'
    paths = [enclave.get('path') for enclave in ElementTree.parse(POLICIES).iter('enclave')]
    assert {'/', '/style/predictor', '/style/synthesizer', '/style/servo_bridge', '/style/operator'} <= set(paths)
    for path in paths:
        folder = keystore / 'enclaves' / path.lstrip('/')
        subprocess.run(['openssl', 'verify', '-CAfile', authority, folder / 'cert.pem'], check=True,
                       capture_output=True)
        for name in ('permissions.p7s', 'governance.p7s'):
            subprocess.run(['openssl', 'smime', '-verify', '-text', '-in', folder / name, '-CAfile', authority, '-out',
                            os.devnull], check=True, capture_output=True)
        assert folder.joinpath('key.pem').stat().st_mode & 0o077 == 0


def test_the_synthesizer_commands_the_bridge_and_a_stranger_does_not(start):
    listener = start(LISTENER, 'bridge', '/style/servo_bridge')
    heard(listener, 'listens')
    stranger = start(SPEAKER, 'stranger')
    heard(stranger, 'speaks')
    time.sleep(1.0)  # long enough for it to be found, were it allowed
    start(SPEAKER, 'synthesizer', '/style/synthesizer')
    assert set(heard(listener, 'synthesizer')) == {'synthesizer'}


def test_an_enclave_without_the_right_cannot_command(start):
    player = start(SPEAKER, 'player', '/style/motion_player')
    assert player.wait(30) != 0
    assert 'joint_trajectory' in player.stderr.read()


def test_a_stranger_hears_nothing(start):
    stranger = start(LISTENER, 'stranger')
    heard(stranger, 'listens')
    listener = start(LISTENER, 'operator', '/style/operator')
    heard(listener, 'listens')
    start(SPEAKER, 'synthesizer', '/style/synthesizer')
    heard(listener, 'synthesizer')
    stranger.kill()
    assert stranger.communicate()[0] == ''
