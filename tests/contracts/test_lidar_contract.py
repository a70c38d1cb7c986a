"""What every lidar source promises, checked on the emulator, on a recording and, with -m hardware, on a real sensor.

For the real one: MAPFUSE_LIDAR=/dev/ttyUSB0 pytest -m hardware tests/contracts
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np
import pytest

from drivers.messages import LaserScan, LidarStream, Message, RawChunk
from drivers.pty_port import PtyPort
from drivers.recording_reader import open_recording
from drivers.rplidar import open_rplidar
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import MODELS
from tools.clock import RunClock
from tools.emulation import Drive, simulated_lidar
from tools.pipeline import LidarDecoding

ENOUGH_SCANS = 15


@pytest.fixture(
    scope="module",
    params=[
        pytest.param("emulated A2M8", marks=pytest.mark.live(cores=1)),
        pytest.param("emulated A2M12", marks=pytest.mark.live(cores=1)),
        "recorded A2M8",
        "recorded A2M12",
        pytest.param("real", marks=[pytest.mark.hardware, pytest.mark.live]),
    ],
)
def source(request, project_root):
    """A message source, open."""
    kind, _, model = request.param.partition(" ")
    with ExitStack() as stack:
        if kind == "recorded":
            path = project_root / "recordings" / f"simulated_office_{model.lower()}.mcap"
            yield stack.enter_context(open_recording(path))
            return
        if kind == "emulated":
            drive = Drive.standing((1.6, 3.6, 0.3))
            emulator = RplidarEmulator(MODELS[model], simulated_lidar("office", drive, noise=True, seed=0))
            port = stack.enter_context(PtyPort(emulator, MODELS[model].baud)).name
        else:
            port = os.environ.get("MAPFUSE_LIDAR", "/dev/ttyUSB0")
        yield stack.enter_context(open_rplidar(port, clock=RunClock()))


@pytest.fixture(scope="module")
def read(source):
    """What a source gives from its start: everything as it came, and the scans in it."""
    return read_scans(iter(source))


def read_scans(messages: Iterator[Message]) -> tuple[list[Message], list[LaserScan]]:
    """Read until there are enough scans."""
    decoding = LidarDecoding()
    raw: list[Message] = []
    scans: list[LaserScan] = []
    for message in messages:
        if isinstance(message, (LidarStream, RawChunk)):
            raw.append(message)
        scans += [one for one in decoding.feed(message) if isinstance(one, LaserScan)]
        if len(scans) >= ENOUGH_SCANS:
            break
    return raw, scans


def test_stream_is_described_before_its_first_chunk_and_stamps_never_step_back(read):
    raw, _ = read
    assert isinstance(raw[0], LidarStream)
    assert all(isinstance(message, RawChunk) for message in raw[1:])
    stamps = [message.stamp_ns for message in raw]
    assert stamps == sorted(stamps)
    assert stamps[0] > 1_600_000_000 * 10**9, "wall clock, not time since boot"


def test_scans_are_turns_in_si_units_with_rising_times(read):
    _, scans = read
    whole = [scan for scan in scans if scan.complete]
    assert len(whole) >= ENOUGH_SCANS - 2
    for scan in whole:
        assert np.all(np.abs(scan.angles_rad) <= np.pi)
        assert np.all((scan.ranges_m >= 0) & (scan.ranges_m < 40.0))
        assert np.all(np.diff(scan.offsets_s) > 0)
        assert 0.05 < scan.offsets_s[-1] < 0.25, "5 to 15 turns a second"
        turned = np.diff(np.unwrap(scan.angles_rad)).sum()
        assert turned == pytest.approx(-2 * np.pi, rel=0.1), "clockwise, one turn"
        assert scan.valid.mean() > 0.3
    starts = np.array([scan.stamp_ns for scan in whole])
    assert np.all(np.diff(starts) > 0)


def test_source_closes_twice(source, read):
    source.close()
    source.close()
