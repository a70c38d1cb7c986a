"""The process that owns a QCar's board, and stops its motor when commands stop coming. NEVER RUN ON HARDWARE.

A program of its own, started by drivers.qcar_link: whatever becomes of the one that commands it, killed, stuck or
crashed, this one still runs and sets the throttle to zero: at once when its socket closes or its parent is gone, and
after the deadline when no command came. It is small so that there is little in it that can fail, and knows nothing but
the standard library of Python 3.6, because it is run by the Python that Quanser's API is installed for, which on a car
is an older one than ours.

Packets of a SOCK_SEQPACKET pair, little-endian: COMMAND (b"W", duty cycle, steering in rad) sets both; ASK (b"R", a
number) is answered by READING (b"S", that number, battery in V, encoder, gyroscope x y z, accelerometer x y z); END
ends the process, as closing the socket does. The first packet back is a READING numbered 0; or b"E" and a text, and
then the process ends.
"""

import importlib
import os
import select
import signal
import socket
import struct
import sys
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

COMMAND = struct.Struct("<cdd")
ASK = struct.Struct("<cI")
READING = struct.Struct("<cI8d")
END = b"T"
QUANSER = "pal.products.qcar:QCar"
_TICK_S = 0.02  # how often it looks whether its parent is there


def serve(
    board: Any, link: socket.socket, deadline_s: float, throttle_limit: float, orphaned: "Callable[[], bool]"
) -> None:
    """Do what the other end of `link` commands until it is closed or orphaned() is true, then stop the motor.

    deadline_s: after so long without a COMMAND the motor is told to stand; board: see drivers.qcar_vehicle.QcarBoard.
    """
    until = None  # when the motor must stand, None where it was told to stand
    steering = 0.0
    try:
        while not orphaned():
            wait_s = _TICK_S if until is None else min(_TICK_S, max(until - time.monotonic(), 0.0))
            if select.select([link], [], [], wait_s)[0]:
                packet = link.recv(64)
                if packet in (b"", END):
                    return
                if packet[:1] == b"W":
                    _, throttle, steering = COMMAND.unpack(packet)
                    board.write(min(max(throttle, -throttle_limit), throttle_limit), steering)
                    until = time.monotonic() + deadline_s if throttle else None
                else:
                    board.read()
                    link.send(reading(board, ASK.unpack(packet)[1]), socket.MSG_DONTWAIT)
            if until is not None and time.monotonic() >= until:
                board.write(0.0, steering)
                until = None
    except OSError:
        return  # the other end is gone, or does not take its answers
    finally:
        try:
            board.write(0.0, 0.0)
        finally:
            board.terminate()


def reading(board: Any, number: int) -> bytes:
    """Return what the board has read as a packet; the API gives numbers as such or as arrays."""
    values = numbers(board.batteryVoltage)[:1] + numbers(board.motorEncoder)[:1]
    return READING.pack(b"S", number, *values, *numbers(board.gyroscope)[:3], *numbers(board.accelerometer)[:3])


def numbers(value: Any) -> "list[float]":
    """Return a number or a flat array as a list."""
    try:
        return [float(element) for element in value]
    except TypeError:
        return [float(value)]


def open_board(name: str, throttle_limit: float) -> Any:
    """Return the board that MODULE:CLASS makes, as Quanser's QCar(readMode, pwmLimit) is made."""
    module, _, maker = name.partition(":")
    return getattr(importlib.import_module(module), maker)(readMode=0, pwmLimit=throttle_limit)


def main(descriptor: int, deadline_s: float, throttle_limit: float, name: str) -> None:
    """Open the board, tell the other end of the socket that it is there, and serve until that end is gone."""
    parent = os.getppid()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # by way of serve's end, which stops the motor
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # the terminal's: the parent answers them
    link = socket.socket(fileno=descriptor)
    try:
        board = open_board(name, throttle_limit)
    except ImportError as error:
        link.send(f"EQuanser's Python API is missing in {sys.executable} ({error})".encode()[:500])
        return
    except Exception as error:  # noqa: BLE001 - whatever it is, the parent tells it
        link.send(f"Ethe board does not open: {type(error).__name__}: {error}".encode()[:500])
        return
    board.read()
    link.send(reading(board, 0))
    serve(board, link, deadline_s, throttle_limit, lambda: os.getppid() != parent)


if __name__ == "__main__":
    sys.path.pop(0)  # the folder of this file, whose modules are not meant to be found by their bare names
    main(int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3]), sys.argv[4])
