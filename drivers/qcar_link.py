"""Our end of the process that owns a QCar's board (drivers.qcar_guard): it looks like the board itself.

NEVER RUN ON HARDWARE: tested with a fake of Quanser's API in that process.
"""

from __future__ import annotations

import select
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

from drivers import qcar_guard
from drivers.errors import DriverError, SilentPortError
from drivers.messages import FloatArray
from drivers.vehicle import LostVehicleError

_ANSWER_S = 0.25  # the board itself answers within some milliseconds
_START_S = 20.0  # Quanser's API is slow to import on a small computer
_END_S = 2.0


class GuardedBoard:
    """A drivers.qcar_vehicle.QcarBoard in a process of its own, which stops the motor when this one falls silent.

    deadline_s: after so long without write() the motor stands; when this process is gone, it stands at once.
    python: the interpreter that has Quanser's API; api: its module and class. Raises DriverError.
    """

    def __init__(
        self,
        deadline_s: float,
        throttle_limit: float,
        *,
        python: str = sys.executable,
        api: str = qcar_guard.QUANSER,
    ) -> None:
        self.motorEncoder: FloatArray = np.zeros(1)  # Quanser's names
        self.gyroscope: FloatArray = np.zeros(3)
        self.accelerometer: FloatArray = np.zeros(3)
        self.batteryVoltage = 0.0
        self._asked = 0
        self._link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        arguments = [str(theirs.fileno()), str(deadline_s), str(throttle_limit), api]
        with theirs:
            try:
                # In a session of its own, where the terminal's Ctrl-C does not reach it; what Quanser's API prints
                # goes to stderr, as stdout may be somebody's JSON.
                self._process = subprocess.Popen(  # noqa: S603 - our own program
                    [python, str(Path(qcar_guard.__file__)), *arguments],
                    stdin=subprocess.DEVNULL,
                    stdout=2,
                    pass_fds=(theirs.fileno(),),
                    start_new_session=True,
                )
            except OSError as error:
                self._link.close()
                raise DriverError(f"qcar: {python} cannot be started: {error.strerror}") from error
        try:
            self._take(0, _START_S)
        except DriverError:
            self._close()
            raise

    @property
    def pid(self) -> int:
        """The number of the process that owns the board."""
        return self._process.pid

    def read(self) -> None:
        """Bring the attributes up to date; LostVehicleError where the process does not answer, or is gone."""
        self._asked += 1
        self._send(qcar_guard.ASK.pack(b"R", self._asked))
        self._take(self._asked, _ANSWER_S)

    def write(self, throttle: float, steering: float) -> None:
        """Set duty cycle and steering in rad; lost where the process is too busy, which read() tells."""
        self._send(qcar_guard.COMMAND.pack(b"W", throttle, steering))

    def terminate(self) -> None:
        """Have the motor stopped and the board released, and wait for that."""
        with suppress(OSError):  # gone already
            self._link.send(qcar_guard.END, socket.MSG_DONTWAIT)
        self._close()
        if self._process.returncode is None:
            raise LostVehicleError(
                f"qcar: the process {self.pid} that owns the board does not end, so whether the motor stands is not"
                " known: switch the car off"
            )

    def _close(self) -> None:
        self._link.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)

    def _send(self, packet: bytes) -> None:
        try:
            self._link.send(packet, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        except OSError as error:
            raise self._gone() from error

    def _take(self, number: int, limit_s: float) -> None:
        """Wait for the answer of that number; earlier ones, which came too late, are dropped."""
        ends_s = time.monotonic() + limit_s
        while select.select([self._link], [], [], max(ends_s - time.monotonic(), 0.0))[0]:
            try:
                packet = self._link.recv(1024)
            except OSError as error:
                raise self._gone() from error
            if not packet:
                raise self._gone()
            if packet[:1] == b"E":
                raise DriverError(f"qcar: {packet[1:].decode()}: run on the car, with its PYTHONPATH")
            _, answered, volts, encoder, *rest = qcar_guard.READING.unpack(packet)
            if answered == number:
                self.batteryVoltage, self.motorEncoder = volts, np.array([encoder])
                self.gyroscope, self.accelerometer = np.array(rest[:3]), np.array(rest[3:])
                return
        text = f"qcar: the process {self.pid} that owns the board has not answered for {limit_s:g} s"
        raise SilentPortError(text) if number == 0 else LostVehicleError(f"{text}: is the board there?")

    def _gone(self) -> LostVehicleError:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)
        return LostVehicleError(
            f"qcar: the process that owns the board has ended (code {self._process.returncode}): what it said is on"
            " stderr; whether the motor stands is not known, look at the car"
        )
