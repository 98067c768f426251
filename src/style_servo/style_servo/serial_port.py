"""A serial device that belongs to one program: opened, locked, and every way to fail put in words."""
import contextlib
import errno
import os
import select
import termios
import time

import serial

from style_servo.backend import BackendFault

__all__ = ['SerialPort', 'GONE', 'BAUD_RATES']

#: What reading and writing raise when the adapter has been pulled out.
GONE = (OSError, termios.error)         # serial.SerialException is an OSError
#: Speeds that servos of any series can be set to, bits a second.
BAUD_RATES = (9600, 57600, 115200, 1000000, 2000000, 3000000, 4000000, 4500000, 6000000, 10500000)
WRITE_S = 1.0       # an adapter that takes no bytes for this long is as good as gone

_WORDS = {
    errno.ENOENT: 'there is no such device: is the adapter plugged in, and is the name right?',
    errno.EACCES: 'no permission to read and write it: add yourself to its group (usually dialout) and log in again, '
                  'or install the udev rule in docs/dynamixel_wiring.md',
    errno.EROFS: 'it is read-only: the servos need a port that can be written',
    errno.EPERM: 'no permission to use it as a serial port',
    errno.EBUSY: 'another program uses it',
    errno.EAGAIN: 'another program uses it (two masters on one bus garble every packet)',
    errno.ENOTTY: 'it is not a serial port',
    errno.EIO: 'the adapter does not respond: plug it in again',
}


class SerialPort:
    """An open port. It is locked before its speed is set and before anything is sent.

    Parameters
    ----------
    name : str
        For example ``/dev/ttyUSB0``.
    baud : int

    Raises
    ------
    BackendFault
        Saying why it cannot be had; nothing was sent, and its settings are as they were.
    """

    def __init__(self, name, baud):
        where = f'port {name}'
        if baud not in BAUD_RATES:
            raise BackendFault(f'{where}: {baud} baud is not a speed of the servos; they know '
                               f'{", ".join(map(str, BAUD_RATES))}', True)
        try:
            # exclusive: pyserial takes the lock first of all
            self._serial = serial.Serial(name, baud, timeout=0, exclusive=True)
        except ValueError as error:
            raise BackendFault(f'{where}: {error}', True) from None
        except GONE as error:
            # pyserial hides the number of some errors in the error that it caught
            numbers = [getattr(one, 'errno', None) or (one.args or (None,))[0]
                       for one in (error, error.__context__) if one is not None]
            number = next((one for one in numbers if isinstance(one, int)), None)
            raise BackendFault(f'{where}: {_WORDS.get(number, error)}', True) from None
        self._file = self._serial.fileno()
        self.name = name

    def send(self, data):
        """Send bytes. Raises one of GONE."""
        left = memoryview(data)
        while left:
            try:
                left = left[os.write(self._file, left):]
            except BlockingIOError:
                if not select.select((), (self._file,), (), WRITE_S)[1]:
                    raise OSError(errno.EIO, 'it takes no bytes') from None

    def receive(self, until):
        """What has come in, as soon as there is anything; b'' if nothing has by the time ``until`` (s). Raises GONE."""
        while select.select((self._file,), (), (), max(0.0, until - time.monotonic()))[0]:
            with contextlib.suppress(BlockingIOError):      # it only looked ready
                data = os.read(self._file, 4096)
                if not data:
                    raise OSError(errno.EIO, 'the port hung up')
                return data
        return b''

    @staticmethod
    def time():
        """Monotonic time, s."""
        return time.monotonic()

    @staticmethod
    def sleep(seconds):
        """Wait."""
        time.sleep(seconds)

    def latency_timer(self):
        """How long the adapter may keep what it received, ms, where the system tells; else None."""
        path = f'/sys/bus/usb-serial/devices/{os.path.basename(os.path.realpath(self.name))}/latency_timer'
        try:
            with open(path) as file:
                return int(file.read())
        except (OSError, ValueError):
            return None

    def close(self):
        """Let go of it. Never raises."""
        with contextlib.suppress(*GONE):
            self._serial.close()
