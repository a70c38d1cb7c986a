"""Other Python drivers of the RPLIDAR as peers, where they are installed (extra `bench`): measured, never used.

They refuse pseudo-terminals, which have no modem lines; that is taken out of their way. Both put themselves into the
import path under short names (`pyrplidar_protocol`, `rplidar`), which is one reason not to depend on them.
"""

from __future__ import annotations

import contextlib
import importlib
import itertools
import logging
import time
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

from drivers.rplidar_protocol import PACKET_BYTES, Answer, Descriptor

PEERS = ("pyrplidar", "rplidar-roboticia")
_MODES = {
    "pyrplidar": (Answer.NODES, Answer.EXPRESS, Answer.ULTRA),  # it reads dense capsules with the bytes swapped
    "rplidar-roboticia": (Answer.NODES, Answer.EXPRESS),
}
_EXPRESS_ID = 0


def installed_peers() -> tuple[str, ...]:
    """Return the peers that can be imported here."""
    return tuple(name for name in PEERS if _module(name) is not None)


def can_decode(peer: str, answer: Answer) -> bool:
    """Whether the peer has a decoder for such packets that gives right distances."""
    return answer in _MODES[peer]


def peer_rate(peer: str, answer: Answer, data: bytes) -> float:
    """Samples per CPU second that the peer takes out of a stream in memory."""
    count = 0
    with contextlib.redirect_stdout(None):  # one tells when it is deleted
        samples = _offline(peer, answer, data)
        began = time.process_time()
        with contextlib.suppress(EOFError):
            for _ in samples:
                count += 1
        passed_s = time.process_time() - began
        del samples
    return count / passed_s


def peer_live(peer: str, port: str, baud: int, mode_id: int | None, warm_s: float, seconds: float) -> tuple[float, int]:
    """CPU share of a core and samples of the peer at a port, after so long; mode_id: of EXPRESS_SCAN, None for SCAN."""
    samples, close = _online(peer, port, baud, mode_id)
    try:
        return measured_share(samples, warm_s, seconds)
    finally:
        close()


def measured_share(samples: Iterator[object], warm_s: float, seconds: float) -> tuple[float, int]:
    """CPU time of this process per second, and the items that came, from warm_s after the first one on."""
    next(samples)
    start = time.monotonic() + warm_s
    for _ in samples:
        if time.monotonic() >= start:
            break
    began, cpu_s, count = time.monotonic(), time.process_time(), 0
    for _ in samples:
        count += 1
        if count % 16 == 0 and time.monotonic() - began >= seconds:
            break
    return (time.process_time() - cpu_s) / (time.monotonic() - began), count


class _Memory:
    """What the peers use of a serial port, over bytes; EOFError at their end."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def read(self, size: int) -> bytes:
        if self._at + size > len(self._data):
            raise EOFError
        self._at += size
        return self._data[self._at - size : self._at]

    def inWaiting(self) -> int:  # noqa: N802 - pyserial's old name
        if self._at + PACKET_BYTES[Answer.ULTRA] > len(self._data):
            raise EOFError
        return len(self._data) - self._at

    def write(self, data: bytes) -> int:
        return len(data)

    def setDTR(self, asserted: bool) -> None:  # noqa: N802
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


def _module(peer: str) -> ModuleType | None:
    try:
        module = importlib.import_module("pyrplidar" if peer == "pyrplidar" else "rplidar")
    except ImportError:
        return None
    # Another package is called rplidar too; only roboticia's knows express scans.
    return module if peer == "pyrplidar" or hasattr(module, "ExpressPacket") else None


def _silent() -> logging.Logger:
    logger = logging.getLogger("peer")
    logger.setLevel(logging.CRITICAL)
    return logger


def _offline(peer: str, answer: Answer, data: bytes) -> Iterator[Any]:
    module: Any = _module(peer)
    if peer == "pyrplidar":
        lidar = module.PyRPlidar()
        lidar.lidar_serial = module.PyRPlidarSerial()
        lidar.lidar_serial._serial = _Memory(
            Descriptor(PACKET_BYTES[answer], repeats=True, kind=answer).encode() + data
        )
        return iter((lidar.start_scan() if answer == Answer.NODES else lidar.start_scan_express(_EXPRESS_ID))())

    class Offline(module.RPLidar):  # type: ignore[misc]
        def connect(self) -> None:
            self._serial = _Memory(data)

    lidar = Offline("memory", logger=_silent())
    kind = "normal" if answer == Answer.NODES else "express"
    lidar.scanning = [True, PACKET_BYTES[answer], kind]
    return iter(lidar.iter_measures(kind, max_buf_meas=False))


def _leave(lidar: Any) -> None:
    """Stop the scan and close the port; once it has no port, this peer prints nothing when it is deleted."""
    lidar.stop()
    lidar.lidar_serial.close()
    lidar.lidar_serial = None


def _online(peer: str, port: str, baud: int, mode_id: int | None) -> tuple[Iterator[Any], Callable[[], None]]:
    module: Any = _module(peer)
    serial = module.serial if peer != "pyrplidar" else importlib.import_module("pyrplidar_serial").serial
    for name in ("_update_dtr_state", "_update_rts_state"):
        setattr(serial.Serial, name, lambda _self: None)
    if peer == "pyrplidar":
        lidar = module.PyRPlidar()
        with contextlib.redirect_stdout(None):
            lidar.connect(port, baud, 3)
        lidar.set_motor_pwm(660)
        generator = lidar.start_scan() if mode_id is None else lidar.start_scan_express(mode_id)
        return iter(generator()), lambda: _leave(lidar)
    lidar = module.RPLidar(port, baud, timeout=3, logger=_silent())
    samples = lidar.iter_measures("normal" if mode_id is None else "express", max_buf_meas=False)
    return itertools.chain(samples), lidar.stop
