"""The demo's second part, live: a simulated humanoid walks with a person; its style changes three times, a sensor
of the person is lost, a servo fails, and somebody presses the emergency stop.

Player, predictor, synthesizer, servo bridge and a simulated Dynamixel chain run as for real (mirror.launch.py). Every
cycle of the bridge is recorded; the pictures show the robot as its servos measured it, and what was asked for, sent
after limiting, and measured, with the limits drawn in.
"""
import argparse
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from launching import launch, stay_alone, stop

ROOT = Path(__file__).resolve().parents[1]
SHOWN = ('r_hip_pitch', 'r_knee', 'l_sho_pitch', 'l_hip_roll')
KNEE_ID = 13
#: a joint of the person whose sensor goes dark, and when, s of the person's walk
LOST, DARK_S = 'ltibia.rx', (6.0, 8.0)
BRIDGE = """/**:
  ros__parameters:
    rate: 100.0
    reply_timeout: 0.3
    watchdog: 1.0
    error_run: 100
    reboot_servos: true
    ramp_time: 0.5
"""


class Show:
    """The operator: listens, changes styles, presses buttons, and writes down when."""

    def __init__(self, folder):
        import rclpy
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from std_srvs.srv import Trigger

        from style_msgs.msg import BridgeState, StyleEstimate, SynthesisStatus
        from style_msgs.srv import ListStyles, SetStyle
        rclpy.init()
        self._rclpy, self._types = rclpy, (ListStyles, SetStyle, Trigger, BridgeState)
        self._node = rclpy.create_node('operator')
        self.state, self.status, self.events, self._folder = None, None, [], folder
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._node.create_subscription(BridgeState, '/servo_bridge/state', self._on_state, latched)
        self._node.create_subscription(SynthesisStatus, '/synthesizer/status', self._on_status, latched)
        self._dark = False
        self._node.create_subscription(StyleEstimate, '/predictor/estimate', self._on_estimate, 10)

    def _on_state(self, message):
        self.state = message

    def _on_status(self, message):
        self.status = message

    def _on_estimate(self, message):
        dark = not dict(zip(message.joint_names, message.observed)).get(LOST, True)
        if dark != self._dark and self.events:
            self.note(f'sensor of {LOST} ' + ('lost' if dark else 'back'))
            self._dark = dark

    def note(self, text):
        """Write down and say what happens now."""
        self.events.append((time.monotonic(), text))
        print(f'  {text}', flush=True)

    def wait(self, condition, seconds):
        """Listen until the condition holds; whether it did."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._rclpy.spin_once(self._node, timeout_sec=0.05)
            if condition():
                return True
        return False

    def spin(self, seconds):
        """Let the show go on."""
        self.wait(lambda: False, seconds)

    def call(self, kind, name, **fields):
        """Call a service; its answer."""
        client = self._node.create_client(kind, name)
        if not client.wait_for_service(5.0):
            raise RuntimeError(f'{name} does not answer')
        future = client.call_async(kind.Request(**fields))
        self._rclpy.spin_until_future_complete(self._node, future, timeout_sec=20.0)
        if future.result() is None:
            raise RuntimeError(f'{name} gave no answer')
        return future.result()

    def styles(self):
        """Named styles of the model."""
        return [style.name for style in self.call(self._types[0], '/synthesizer/list_styles').styles]

    def style(self, name):
        """Change the style within half a second."""
        from style_msgs.msg import StyleVector
        answer = self.call(self._types[1], '/synthesizer/set_style', style=StyleVector(name=f'"{name}"'),
                           transition_time=0.5)
        self.note(f'style {name}' if answer.success else f'style {name} refused: {answer.message}')

    def press(self, button):
        """Call ~/estop or ~/reset of the bridge."""
        answer = self.call(self._types[2], f'/servo_bridge/{button}')
        self.note(button if answer.success else f'{button} refused: {answer.message}')
        return answer.success

    def close(self):
        """Take the operator down."""
        self._node.destroy_node()
        self._rclpy.try_shutdown()


def perform(show, link):
    """The programme; returns False where the robot never began to walk."""
    from style_msgs.msg import BridgeState
    if not show.wait(lambda: show.state is not None and show.state.state == BridgeState.STREAMING, 45.0):
        why = show.state.reason or 'no trajectory came' if show.state else 'the servo bridge did not start'
        print(f'The robot did not begin to walk: {why}', file=sys.stderr)
        return False
    show.note('walking with the person')
    names = [name for name in show.styles() if name != 'mean']
    show.spin(1.5)
    for k in range(3):
        show.style(names[(k + 1) * (len(names) - 1) // 3])
        show.spin(1.4)
    show.note('servo of the right knee overloaded')
    subprocess.run([sys.executable, '-m', 'style_servo.dynamixel_sim', '--link', link, '--tell',
                    f'{{"do": "fail", "id": {KNEE_ID}, "kind": "overload"}}'], check=True, capture_output=True)
    if show.wait(lambda: show.state.state == BridgeState.FAULT, 3.0):
        show.note(f'fault: {show.state.reason[:70]}')
    show.spin(0.8)
    if show.press('reset'):
        show.wait(lambda: show.state.state == BridgeState.STREAMING, 4.0)
        show.spin(1.5)
    show.press('estop')
    show.spin(1.0)
    return True


def draw(record, events, output):
    """A strip of the robot, and the courses of some joints with their limits."""
    import numpy as np

    from style_core import pictures
    from style_core.motion import Motion
    from style_core.skeleton import read_skeleton
    from style_servo.record import violations
    begin = events[0][0] - 1.0
    keep = record.time >= begin
    time_s = record.time[keep] - begin
    time_s = np.maximum.accumulate(time_s + 1e-9 * np.arange(len(time_s)))
    robot = read_skeleton(ROOT / 'config' / 'robots' / 'humanoid20.urdf')
    motion = Motion(record.joint_names, record.measured[keep], time_s).joints(robot.channel_names)
    rows, whole = [], time_s[-1]
    for number in range(2):
        part = motion.slice(number * whole / 2, (number + 1) * whole / 2 + 1e-3)
        said = [f'{when - begin:.1f} s {text}' for when, text in events
                if number * whole / 2 <= when - begin < (number + 1) * whole / 2]
        rows.append(('; '.join(text if len(text) < 50 else text[:47] + '...' for text in said), part))
    pictures.save(pictures.stick_strip(robot, rows, 14, 'The simulated humanoid as its servos measured it'),
                  output / 'robot.png')
    columns = [record.joint_names.index(name) for name in SHOWN]
    figure = pictures.joint_curves(
        SHOWN, [pictures.Line(label, time_s, array[keep][:, columns]) for label, array in (
            ('asked for', record.target), ('sent', record.command), ('measured', record.measured))],
        'Positions asked for, sent after limiting, and measured; limits dashed', columns=1)
    for axis, column in zip(figure.axes, columns):
        for limit in (record.limits['lower'][column], record.limits['upper'][column]):
            axis.axhline(np.degrees(limit), color='#cc0000', lw=1, ls='--')
        for when, _ in events:
            axis.axvline(when - begin, color='#999999', lw=0.7)
    for when, text in events:
        figure.axes[0].annotate(text.split(':')[0], (when - begin, 1.0), xycoords=('data', 'axes fraction'), fontsize=6,
                                rotation=35, xytext=(0, 2), textcoords='offset points')
    figure.set_size_inches(11, 9)
    pictures.save(figure, output / 'servos.png')
    return violations(record)


def main():
    """Run part two; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--synthetic', action='store_true', help='use the synthetic gait even where recordings exist')
    parser.add_argument('--trial', default='16_32', help='recording to play (default: 16_32)')
    parser.add_argument('--output', type=Path, default=ROOT / 'out' / 'demo_synth', help='folder')
    args = parser.parse_args()
    stay_alone()
    from demo_material import material

    from style_servo.record import read_record
    args.output.mkdir(parents=True, exist_ok=True)
    output = args.output.resolve()
    flight = output / 'flight'
    for part in output.glob('flight.*.flight'):     # of an earlier demo
        part.unlink()
    (output / 'bridge.yaml').write_text(BRIDGE)
    link = str(output / 'servo_port')
    show = material(output, args.synthetic, args.trial)
    print('A simulated humanoid walks with a person, in styles of its own:', flush=True)
    with open(output / 'nodes.log', 'w') as log:
        nodes = launch(
            [str(ROOT / 'launch' / 'mirror.launch.py'), f'model:={show.model}', f'file:={show.file}',
             f'bridge_params:={output / "bridge.yaml"}', f'record:={flight}',
             f'sim_link:={link}', 'loop:=seamless', f'drop:=["{LOST}"]', f'drop_from:={DARK_S[0]}',
             f'drop_until:={DARK_S[1]}'], log)
    operator = Show(output)
    try:
        walked = perform(operator, link)
    finally:
        operator.close()
        stop(nodes)
    if not walked:
        errors = [line for line in (output / 'nodes.log').read_text().splitlines() if '[ERROR]' in line]
        print('\n'.join(errors), f'All that the nodes said: {output / "nodes.log"}', sep='\n', file=sys.stderr)
        return 1
    record = read_record(flight)
    outside = draw(record, operator.events, output)
    print(f'\n{len(record.time)} cycles of {len(record.joint_names)} servos; commands outside limits: {outside}\n'
          f'Pictures: {output}/robot.png, {output}/servos.png')
    return 0


if __name__ == '__main__':
    sys.exit(main())
