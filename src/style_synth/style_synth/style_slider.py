"""Change the style of a running synthesizer with the keys of a terminal.

  ros2 run style_synth style_slider
  ros2 run style_synth style_slider --node /robot/synthesizer --seconds 1.0

  up, down        choose a style            left, right     less of it, more of it
  1 .. 9          go over to that style     0               the mean of the model
  q               leave
"""
import argparse
import os
import select
import sys
import termios
import tty

import numpy as np
import rclpy

from style_msgs.msg import StyleVector
from style_msgs.srv import ListStyles, SetStyle

__all__ = ['Mixer', 'main', 'read_key']

STEP = 0.1


class Mixer:
    """Weights of styles, turned by keys.

    Parameters
    ----------
    styles : mapping of str to ndarray, shape (K,)
    """

    def __init__(self, styles):
        self.names, self.values = list(styles), np.array(list(styles.values()))
        self.centre = self.values.mean(axis=0)
        self.weights, self.chosen = np.zeros(len(self.names)), 0

    @property
    def v(self):
        """Style coordinates: the mean, and what every style adds to it."""
        return self.centre + self.weights @ (self.values - self.centre)

    def press(self, key):
        """Take a key; whether the style changed."""
        if key in ('up', 'down'):
            self.chosen = (self.chosen + (1 if key == 'down' else -1)) % len(self.names)
            return False
        if key in ('left', 'right'):
            step = STEP if key == 'right' else -STEP
            self.weights[self.chosen] = round(float(np.clip(self.weights[self.chosen] + step, -1.0, 1.5)), 6)
            return True
        if key.isdigit() and int(key) <= len(self.names):
            self.weights[:] = 0.0
            if key != '0':
                self.chosen = int(key) - 1
                self.weights[self.chosen] = 1.0
            return True
        return False

    def lines(self):
        """What to show."""
        rows = []
        for k, (name, weight) in enumerate(zip(self.names, self.weights)):
            bar = '#' * round(20 * abs(weight))
            rows.append(f'{">" if k == self.chosen else " "} {k + 1:2} {name:24} {weight:+5.2f} {bar}')
        return rows


def read_key(terminal):
    """The next key of a terminal (file descriptor), '' after a tenth of a second, 'q' where the terminal has gone.

    Bytes are taken from the descriptor itself: a buffered stream would swallow the rest of an arrow key's sequence,
    and waiting for more would wait in vain.
    """
    if not select.select([terminal], [], [], 0.1)[0]:
        return ''
    try:
        char = os.read(terminal, 1)
    except OSError:     # hung up
        return 'q'
    if not char:
        return 'q'
    if char == b'\x1b' and select.select([terminal], [], [], 0.02)[0]:
        return {b'[A': 'up', b'[B': 'down', b'[C': 'right', b'[D': 'left'}.get(os.read(terminal, 2), '')
    return char.decode(errors='ignore')


def _call(node, kind, service, request, seconds=5.0):
    client = node.create_client(kind, service)
    if not client.wait_for_service(seconds):
        raise RuntimeError(f'{service} does not answer: is the synthesizer configured?')
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=seconds)
    if future.result() is None:
        raise RuntimeError(f'{service} gave no answer within {seconds:g} s')
    return future.result()


def _slide(node, name, seconds, terminal):
    listed = _call(node, ListStyles, f'{name}/list_styles', ListStyles.Request())
    if not listed.styles:
        raise RuntimeError('what is being performed has no styles')
    mixer = Mixer({style.name: np.array(style.values) for style in listed.styles})
    message, key, drawn = '', 'draw', 0
    while key != 'q':
        if key:
            if mixer.press(key):
                answer = _call(node, SetStyle, f'{name}/set_style', SetStyle.Request(
                    style=StyleVector(values=mixer.v.tolist()), transition_time=seconds))
                message = '' if answer.success else answer.message
            lines = [*mixer.lines(), 'up/down choose, left/right less/more, 1-9 go there, 0 mean, q leave', message]
            sys.stdout.write((f'\x1b[{drawn}A' if drawn else '') + ''.join(f'\x1b[2K{line}\r\n' for line in lines))
            sys.stdout.flush()
            drawn = len(lines)
        key = read_key(terminal)


def main(args=None):
    """Run until q."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--node', default='/synthesizer', help='name of the synthesizer (default: /synthesizer)')
    parser.add_argument('--seconds', type=float, default=0.5, help='time of a change (default: 0.5)')
    options = parser.parse_args(rclpy.utilities.remove_ros_args(args)[1:])
    if not sys.stdin.isatty():
        parser.error('style_slider wants a terminal')
    rclpy.init(args=args)
    node = rclpy.create_node('style_slider')
    before = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        _slide(node, options.node, options.seconds, sys.stdin.fileno())
    except KeyboardInterrupt:
        pass
    except RuntimeError as error:
        print(f'style_slider: {error}', file=sys.stderr)
        return 1
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
