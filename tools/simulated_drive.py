"""A recording of a simulated car that drives around for as long as it takes, made without waiting for real time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.messages import LaserScan
from drivers.recording_writer import McapRecorder
from drivers.rplidar import connect
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import MODELS
from mapping.frames import planar_transform
from mapping.trajectory import Trajectory
from tools.config import Config
from tools.emulation import Drive, simulated_lidar
from tools.errors import ToolError
from tools.pipeline import LASER_FRAME, LidarDecoding
from tools.simulator import drive_along

# One round through the office, x and y in metres: its last point leads on to its first.
OFFICE_ROUND = (
    (1.6, 3.6), (3.0, 3.6), (4.4, 4.0), (4.9, 5.1), (5.8, 5.7), (8.0, 5.8), (10.2, 5.5), (11.3, 6.1), (11.6, 7.1),
    (11.5, 8.6), (11.9, 9.8), (13.1, 9.9), (13.8, 8.8), (13.2, 7.7), (12.0, 7.2), (11.4, 6.4), (10.6, 5.7), (9.0, 5.7),
    (8.1, 5.8), (7.4, 6.2), (7.0, 6.9), (6.7, 7.7), (6.0, 8.5), (5.0, 8.9), (3.9, 9.2), (2.9, 9.4), (1.6, 9.3),
    (0.9, 8.5), (1.3, 7.5), (2.3, 7.1), (2.9, 6.2), (3.6, 5.8), (4.3, 5.5), (4.7, 4.9), (4.8, 4.0), (4.9, 2.6),
    (4.7, 1.4), (3.9, 0.9), (2.4, 0.9), (1.4, 1.3), (1.0, 2.2), (1.1, 3.1),
)  # fmt: skip
_SPEED_MPS = 0.6
_QUEUE = 10_000_000  # the recorder must not drop what the simulation makes faster than it can write
_SEED = 7


def round_trip(turns: int, hz: float = 10.0) -> Trajectory:
    """Return a drive round and round the office that lasts at least `turns` turns of a lidar at hz."""
    once = drive_along(OFFICE_ROUND, _SPEED_MPS)
    rounds = int(np.ceil(turns / hz / (float(once.stamps_ns[-1]) * 1e-9))) + 1
    return drive_along(OFFICE_ROUND * rounds, _SPEED_MPS)


def record_round_trip(path: Path, turns: int, model: str = "A2M8") -> None:
    """Record `turns` turns of an emulated RPLIDAR (A2M8: 800 samples, 10 Hz) to a new MCAP file, labelled simulated.

    Raises RecordingError when the file cannot be created.
    """
    emulated, clock, config = MODELS[model], SimulatedClock(1_000_000_000), Config()
    device = RplidarEmulator(
        emulated, simulated_lidar("office", Drive(round_trip(turns), "round"), noise=True, seed=_SEED)
    )
    metadata = {"mapfuse.origin": {"simulated": "true", "lidar_serial": emulated.serial.hex()}}
    decoding, left = LidarDecoding(), turns
    with (
        connect(lambda baud: EmulatedLink(device, clock, emulated.baud, baud), clock=clock, sleep=clock.sleep) as lidar,
        McapRecorder(path, metadata=metadata, queue_limit=_QUEUE) as recorder,
    ):
        mount = config.lidar.mount
        stream = lidar.start()
        pose = np.array([mount.x_m, mount.y_m, mount.z_m, mount.yaw_rad])
        recorder.put(planar_transform(stream.stamp_ns, "base_link", LASER_FRAME, pose, inverted=mount.inverted))
        for message in lidar:
            recorder.put(message)
            left -= sum(isinstance(decoded, LaserScan) for decoded in decoding.feed(message))
            if left <= 0:
                break
    report = recorder.close()
    if report.error or report.dropped:
        raise ToolError(f"{path}: the simulated drive is not complete: {report.error or dict(report.dropped)}")
