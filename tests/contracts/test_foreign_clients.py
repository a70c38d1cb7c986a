"""Other people's RPLIDAR clients on the emulator, as they are: one word says why where they are missing.

Not dependencies of this project: `pip install --no-deps --target DIR pyrplidar rplidarc1`, then MAPFUSE_PEERS=DIR.
A pseudo-terminal has no DTR, which both insist on: a shim swallows that one error.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import importlib
import math
import os
import sys
import time
from collections.abc import Iterator
from itertools import islice

import numpy as np
import pytest
import serial

from drivers.pty_port import PtyPort
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import MODELS

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals are served on Linux only"),
    pytest.mark.live,
]
SAMPLES = 2000  # ten turns
SLOPE = 0.7


def ramp(times_ns: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
    """1 m at the zero to 5.4 m just before it, as an A2M4 sees 6 m: each angle has a distance of its own."""
    return np.asarray(1.0 + SLOPE * theta_rad)


def distance_mm(angle_deg: float) -> float:
    return 1000.0 * (1.0 + SLOPE * math.radians(angle_deg))


@pytest.fixture
def peer(monkeypatch, request):
    """The module of a client."""
    if folder := os.environ.get("MAPFUSE_PEERS"):
        monkeypatch.syspath_prepend(folder)
    try:
        return importlib.import_module(request.param)
    except ImportError:
        pytest.skip(f"{request.param} is missing")


@pytest.fixture(autouse=True)
def no_modem_lines(monkeypatch):
    """Let a port without modem lines be opened."""
    for name in ("_update_dtr_state", "_update_rts_state"):
        monkeypatch.setattr(serial.Serial, name, tolerant(getattr(serial.Serial, name)))


def tolerant(set_line):
    def try_to(port: serial.Serial) -> None:
        try:
            set_line(port)
        except OSError as error:
            if error.errno not in (errno.ENOTTY, errno.EINVAL):
                raise

    return try_to


@contextlib.contextmanager
def emulated(model: str) -> Iterator[PtyPort]:
    device = RplidarEmulator(MODELS[model], ramp, startup_s=0.1)
    with PtyPort(device, MODELS[model].baud) as port:
        yield port


@pytest.mark.parametrize("peer", ["pyrplidar"], indirect=True)
@pytest.mark.parametrize("model", list(MODELS))
def test_pyrplidar_reads_standard_scans(peer, model: str, capsys) -> None:
    baud = MODELS[model].baud
    with emulated(model) as port:
        for _ in range(2):  # one client after the other
            lidar = peer.PyRPlidar()
            lidar.connect(port=port.name, baudrate=baud, timeout=3)
            info, health, rates = lidar.get_info(), lidar.get_health(), lidar.get_samplerate()
            assert (info.model, health.status, rates.t_standard) == (MODELS[model].model_id, 0, 500)
            lidar.set_motor_pwm(660)
            samples = [(one.start_flag, one.angle, one.distance) for one in islice(lidar.start_scan()(), SAMPLES)]
            lidar.stop()
            lidar.disconnect()
            time.sleep(0.2)
            seen = [(angle, distance) for _, angle, distance in samples if distance > 0]
            assert len(seen) == SAMPLES
            assert max(abs(distance - distance_mm(angle)) for angle, distance in seen) < 1.0
            turns = [place for place, (start, _, _) in enumerate(samples) if start]
            assert np.diff(turns) == pytest.approx(200, abs=1)


@pytest.mark.parametrize("peer", ["pyrplidar"], indirect=True)
@pytest.mark.parametrize("mode", [mode.name for mode in MODELS["A2M8"].modes if mode.answer_type == 0x84])
def test_pyrplidar_lists_the_modes_and_reads_ultra_capsules(peer, mode: str, capsys) -> None:
    model = MODELS["A2M8"]
    with emulated("A2M8") as port:
        lidar = peer.PyRPlidar()
        lidar.connect(port=port.name, baudrate=model.baud, timeout=3)
        names = [one.name for one in lidar.get_scan_modes()]
        assert names == [one.name for one in model.modes]
        assert lidar.get_scan_mode_typical() == model.typical_id
        scan = lidar.start_scan_express(names.index(mode))()
        distances = [one.distance for one in islice(scan, 4000)]
        lidar.stop()
        lidar.disconnect()
        assert np.mean(np.array(distances) > 0) > 0.9


@pytest.mark.parametrize("peer", ["rplidarc1"], indirect=True)
def test_rplidarc1_reads_standard_scans(peer) -> None:
    """Its own angles are off by up to 2 deg: it keeps the check bit of the angle's lower byte."""
    with emulated("A2M8") as port:
        samples = asyncio.run(read_c1(peer, port.name))
    assert len(samples) > 200
    seen = [(sample["a_deg"], sample["d_mm"]) for sample in samples if sample["d_mm"]]
    assert len(seen) > 0.98 * len(samples)
    off_deg = [math.degrees((distance / 1000.0 - 1.0) / SLOPE) - angle for angle, distance in seen]
    inside = [off for off in off_deg if abs(off) < 180.0]
    assert max(abs(off) for off in inside) < 2.1
    assert len(inside) > 0.98 * len(seen)


async def read_c1(peer, port: str) -> list[dict[str, float]]:
    lidar = peer.RPLidar(port=port, baudrate=115200)
    samples: list[dict[str, float]] = []

    async def collect() -> None:
        while len(samples) < SAMPLES:
            samples.append(await lidar.output_queue.get())
        lidar.stop_event.set()

    async with asyncio.timeout(20.0) if hasattr(asyncio, "timeout") else contextlib.AsyncExitStack():
        await asyncio.gather(lidar.simple_scan(make_return_dict=False), collect())
    lidar.shutdown()
    return samples
