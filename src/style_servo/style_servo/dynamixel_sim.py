"""A simulated Dynamixel chain behind a pseudo-terminal: any Protocol 2.0 client can talk to it.

    ros2 run style_servo dynamixel_sim --servos 1-20:XM430-W350 --link /tmp/dxl
    python -m style_servo.dynamixel_sim --servos 1:XM430-W350,2:XL430-W250 --link /tmp/dxl

Open the link (here /tmp/dxl) like the device of a USB adapter, at the baud rate of the servos. Faults come on command,
as lines of JSON on the socket LINK.control, for example with --tell from another terminal:

    python -m style_servo.dynamixel_sim --link /tmp/dxl --tell '{"do": "fail", "id": 3, "kind": "overload"}'

Commands ("id" left out means every servo):
    {"do": "drop" | "corrupt" | "delay", "id", "count": 1 (-1 for ever), "probability": 1.0, "seconds": 0.01}
    {"do": "clear", "id"}                  forget those faults
    {"do": "silent", "id", "on": true}     a servo that no longer answers nor obeys
    {"do": "fail", "id", "kind"}           hardware error: voltage, overheating, encoder, shock, overload
    {"do": "heat", "id", "celsius": 90}    set the temperature
    {"do": "block", "id", "on": true}      the horn is held fast
    {"do": "reboot", "id"}                 power dip: RAM lost, torque off
    {"do": "place", "id", "radians": 3.1}  turn the horn by hand (torque off), from position value 0
    {"do": "set", "id", "item": "Drive Mode", "value": 1}   a register, without any check
    {"do": "unplug"}, {"do": "plug"}       the adapter goes and comes back (the link is renewed)
    {"do": "state"}                        positions, torque, errors, instructions counted
    {"do": "stop"}                         end the program
"""
import argparse
import bisect
import contextlib
import fcntl
import itertools
import json
import os
import select
import signal
import socket
import struct
import sys
import time
import tty
from pathlib import Path

from style_core.errors import UsageError
from style_servo.control_table import control_table, model_named, models
from style_servo.packets import Instruction, Parser
from style_servo.simulated_bus import SimulatedBus
from style_servo.simulated_motion import STEP_S

__all__ = ['PtyBus', 'tell', 'parse_servos', 'main']

PROMPT_S = 0.001    # to look again this much after it should is no delay
FORGIVEN_S = 0.3    # of delays since the client spoke last: one that has died is noticed on a busy machine, too
QUIET_S = 0.02      # a pause this long ends an unfinished packet
TCGETS2 = 0x802C542A


class PtyBus:
    """Serve a :class:`SimulatedBus` on a pseudo-terminal reachable under a link.

    Parameters
    ----------
    bus : SimulatedBus
    link : path-like
        A symbolic link with this name points to the terminal; a socket LINK.control takes commands.
    check_baud : bool
        Servos understand only packets sent at their own baud rate (as set on the terminal by the client).
    parent : int, optional
        Process without which nothing is served any more.
    """

    def __init__(self, bus, link, check_baud=True, parent=None):
        self.bus = bus
        self.link = Path(link)
        self._check_baud, self._parent = check_baud, parent
        self._parser = Parser()
        self._last_byte = 0.0
        self._looked, self._forgiven = time.monotonic(), 0.0
        self._pending, self._serial = [], itertools.count()
        self._silent = set()
        self._master = None
        self._stop = False
        self._control = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        path = str(self.link) + '.control'
        if os.path.lexists(path):
            os.unlink(path)
        self._control.bind(path)
        self._control.listen(4)
        self._clients = {}
        self.plug()

    # --- the adapter --------------------------------------------------------------------------------------------

    def plug(self):
        """Make the terminal and the link."""
        if self._master is not None:
            return
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        os.set_blocking(self._master, False)
        new = f'{self.link}.new{os.getpid()}'
        os.symlink(os.ttyname(self._slave), new)
        os.replace(new, self.link)

    def unplug(self):
        """Take the terminal away, as pulling the USB plug does."""
        if self._master is None:
            return
        os.close(self._master)
        os.close(self._slave)
        self._master = None
        self._pending.clear()
        self._parser.forget()
        if self.link.is_symlink():
            self.link.unlink()

    def close(self):
        """Remove everything that was made."""
        self.unplug()
        for client in list(self._clients):
            client.close()
        self._control.close()
        if os.path.lexists(f'{self.link}.control'):
            os.unlink(f'{self.link}.control')

    def _baud(self):
        if not self._check_baud:
            return None
        # struct termios2: four flag words, line discipline, 19 control characters, input and output speed
        settings = fcntl.ioctl(self._master, TCGETS2, bytes(44))
        return struct.unpack_from('I', settings, 40)[0]

    # --- the loop -----------------------------------------------------------------------------------------------

    def run(self):
        """Serve until told to stop."""
        while not self._stop and self._parent in (None, os.getppid()):
            self.step(STEP_S)       # so that no reply waits for motion to be made up for

    def step(self, timeout):
        """Wait at most ``timeout`` s for something to happen, and do it."""
        now = time.monotonic()
        if self._pending:
            timeout = max(0.0, min(timeout, self._pending[0][0] - now))
        watched = [self._control, *self._clients]
        if self._master is not None:
            watched.append(self._master)
        ready, _, _ = select.select(watched, [], [], timeout)
        now = time.monotonic()
        # a busy machine woke this program late. What came meanwhile lies in the terminal, and who was to send it may
        # not have run either: real servos have processors of their own
        late = min(max(0.0, now - self._looked - timeout - PROMPT_S), FORGIVEN_S - self._forgiven)
        self.bus.excused += late
        self._forgiven += late
        self._looked = now
        if self._master in ready:
            self._receive(now)
        while self._pending and self._pending[0][0] <= time.monotonic():
            self._send(self._pending.pop(0)[2])
        self.bus.advance(now)       # what has passed since then is judged when it is known whether it was a delay
        for source in ready:
            if source is self._control:
                client, _ = source.accept()
                self._clients[client] = b''
            elif source is not self._master and source in self._clients:
                self._listen(source)

    def _receive(self, now):
        try:
            data = os.read(self._master, 4096)
        except OSError:
            return      # nobody has the other end open
        if now - self._last_byte > QUIET_S:
            self._parser.forget()
        self._last_byte, self._forgiven = now, 0.0
        for servo_id, instruction, parameters, crc_ok in self._parser.feed(data):
            if self._silent:
                self._hush(now)
            lead = 10.0 * (10 + len(parameters)) / (self._baud() or 1e6) if self.bus.true_timing else 0.0
            for reply in self.bus.handle(servo_id, instruction, parameters, crc_ok, now, self._baud()):
                if reply.delay + lead > 0:
                    # late ones come late, whatever the client says meanwhile
                    bisect.insort(self._pending, (now + lead + reply.delay, next(self._serial), reply.data))
                else:
                    self._send(reply.data)

    def _hush(self, now):
        for servo in self.bus.servos:
            if servo.id in self._silent:
                servo.awake_at = now + 1.0

    def _send(self, data):
        with contextlib.suppress(OSError, TypeError):       # unplugged, or nobody reads
            os.write(self._master, data)

    # --- commands -----------------------------------------------------------------------------------------------

    def _listen(self, client):
        data = client.recv(65536)
        if not data:
            del self._clients[client]
            client.close()
            return
        *lines, self._clients[client] = (self._clients[client] + data).split(b'\n')
        for line in lines:
            try:
                answer = self.command(**json.loads(line))
            except (ValueError, TypeError, KeyError, UsageError) as error:
                answer = {'error': f'{type(error).__name__}: {error}'}
            client.sendall(json.dumps(answer).encode() + b'\n')

    def command(self, do, id=None, **options):
        """Carry out one command (see the module's text); returns what the client is sent."""
        now = time.monotonic()
        servos = self.bus.servos if id is None else self.bus.with_id(id)
        if not servos:
            raise ValueError(f'no servo has ID {id}')
        if do in ('drop', 'corrupt', 'delay'):
            self.bus.add_fault(do, id, **options)
        elif do == 'clear':
            self.bus.clear_faults(id)
        elif do == 'silent':
            for servo in servos:
                self._silent.discard(servo.id)
                servo.awake_at = now
                if options.get('on', True):
                    self._silent.add(servo.id)
        elif do == 'fail':
            for servo in servos:
                servo.fail(options['kind'])
        elif do in ('heat', 'block', 'place'):
            for servo in servos:
                self._disturb(do, self.bus.servos.index(servo), **options)
        elif do == 'set':
            for servo in servos:
                servo.table[options['item']]
                servo.set(options['item'], options['value'])
        elif do == 'reboot':
            for servo in servos:
                servo.reboot(now)
        elif do == 'unplug':
            self.unplug()
        elif do == 'plug':
            self.plug()
        elif do == 'stop':
            self._stop = True
        elif do == 'state':
            return self._state(servos)
        else:
            raise ValueError(f'unknown command {do!r}')
        return {'done': do}

    def _disturb(self, do, i, celsius=90.0, on=True, radians=None):
        motion = self.bus.motion
        if do == 'heat':
            motion.temperature[i] = celsius
        elif do == 'block':
            motion.blocked[i] = on
        else:
            if motion.torque[i]:
                raise ValueError('a horn can be turned by hand only while torque is off')
            motion.position[i] = radians

    def _state(self, servos):
        motion = self.bus.motion
        names = {value: name for name, value in vars(Instruction).items() if isinstance(value, int)}
        return {'servos': [{
            'id': servo.id, 'model': servo.table.model, 'position': motion.position[i],
            'velocity': motion.velocity[i], 'goal': servo.get('Goal Position'), 'torque': bool(motion.torque[i]),
            'halted': bool(motion.halted[i]), 'watchdog': servo.watchdog,
            'temperature': motion.temperature[i], 'hardware_error': servo.errors}
            for i, servo in enumerate(self.bus.servos) if servo in servos],
            'instructions': {names.get(k, hex(k)): n for k, n in self.bus.instructions.items()}}


def tell(link, timeout=5.0, **command):
    """Send one command to a running simulator and return its answer.

    Raises
    ------
    UsageError
        If nothing listens there or the command was refused.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(timeout)
        try:
            client.connect(f'{link}.control')
        except OSError as error:
            raise UsageError(f'no simulated bus at {link}: {error}') from None
        client.sendall(json.dumps(command).encode() + b'\n')
        answer = b''
        while not answer.endswith(b'\n'):
            part = client.recv(65536)
            if not part:
                break
            answer += part
    answer = json.loads(answer) if answer else {'done': command['do']}
    if 'error' in answer:
        raise UsageError(answer['error'])
    return answer


def parse_servos(text):
    """Servos from text like ``1-20:XM430-W350,21:XL430-W250``: a list of (ID, model number).

    Raises
    ------
    UsageError
        If the text cannot be read or names an unknown model.
    """
    servos = []
    for part in text.split(','):
        ids, _, model = part.strip().partition(':')
        first, _, last = ids.partition('-')
        try:
            first, last = int(first), int(last or first)
        except ValueError:
            raise UsageError(f'cannot read {part!r}: write IDs and a model, like 1-20:XM430-W350') from None
        if not 0 <= first <= last <= 252:
            raise UsageError(f'IDs go from 0 to 252, got {ids}')
        number = model_named(model)
        servos += [(servo_id, number) for servo_id in range(first, last + 1)]
    return servos


class _Record:
    """Every goal position that reached the servos, one JSON line an instruction: [time, {id: goal}]."""

    def __init__(self, path):
        self._file = open(path, 'w', buffering=1 << 16)     # noqa: SIM115  (open as long as the program)
        self.close = self._file.close

    def __call__(self, now, goals):
        self._file.write(json.dumps([round(now, 6), goals]) + '\n')


def _parser():
    parser = argparse.ArgumentParser(prog='dynamixel_sim', description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--link', required=True, metavar='PATH', help='name under which clients open the port')
    parser.add_argument('--servos', default='1-20:XM430-W350', metavar='LIST',
                        help='IDs and models (default %(default)s); an ID named twice makes two servos that collide')
    parser.add_argument('--baud', type=int, default=1000000, help='baud rate of the servos (default %(default)s)')
    parser.add_argument('--start', type=float, default=0.0, metavar='RADIANS',
                        help='posture at start, from the middle of the range (default %(default)s)')
    parser.add_argument('--any-baud', action='store_true', help='answer at whatever speed the client has set')
    parser.add_argument('--true-timing', action='store_true',
                        help='replies take the time of their bits and of the return delay')
    parser.add_argument('--record', metavar='FILE', help='write every goal position received to FILE (JSON lines)')
    parser.add_argument('--seed', type=int, default=0, help='of the faults (default %(default)s)')
    parser.add_argument('--stop-with-parent', action='store_true',
                        help='end when the program that started this one has ended')
    parser.add_argument('--models', action='store_true', help='list the models and end')
    parser.add_argument('--tell', metavar='JSON', help='send one command to the simulator that runs at LINK and end')
    return parser


def main(argv=None):
    """Command line of the simulator."""
    arguments = sys.argv[1:] if argv is None else list(argv)
    if '--models' in arguments:
        print('\n'.join(f'{number:6d}  {model}' for number, model in models().items()))
        return 0
    if '--ros-args' in arguments:       # launch appends these to every node
        arguments = arguments[:arguments.index('--ros-args')]
    args = _parser().parse_args(arguments)
    parent = os.getppid()
    try:
        if args.tell:
            print(json.dumps(tell(args.link, **json.loads(args.tell)), indent=1))
            return 0
        servos = []
        for servo_id, number in parse_servos(args.servos):
            table = control_table(number)
            servos.append((servo_id, number, table.zero * table.position_unit + args.start))
        bus = SimulatedBus(servos, args.baud, args.seed, args.true_timing)
        if args.record:
            bus.on_goal = _Record(args.record)
        port = PtyBus(bus, args.link, check_baud=not args.any_baud, parent=parent if args.stop_with_parent else None)
    except (UsageError, ValueError, OSError) as error:
        print(f'dynamixel_sim: {error}', file=sys.stderr)
        return 2

    def stop(*_):
        port.command('stop')
    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    print(f'{len(servos)} simulated servos at {args.link} ({args.baud} baud)', flush=True)
    try:
        port.run()
    finally:
        port.close()
        if args.record:
            bus.on_goal.close()
    return 0


if __name__ == '__main__':
    sys.exit(main())
