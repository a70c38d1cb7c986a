from __future__ import annotations

import pytest

from drivers.errors import PortMissingError
from mapping.frames import find_pose
from tools.clock import RunClock
from tools.config import parse
from tools.live_sensors import started_sensors

CONFIG = parse({"depth": {"width": 424, "height": 240, "fps": 15, "mount": {"pitch_rad": 0.1, "yaw_rad": 0.2}}}, "test")


@pytest.mark.live(cores=1)
def test_a_camera_alone_is_started_and_described():
    with started_sensors(None, "emulated:office", CONFIG, RunClock()) as sensors:
        assert sensors.lidar is None
        assert sensors.camera is not None
        next(iter(sensors.camera))
        summary = sensors.summary()
        assert sensors.origin["simulated"] == "true"
        sensors.close()
    assert summary["simulated"]
    described = summary["camera"]
    assert isinstance(described, dict)
    assert (described["mode"], described["frames"]) == ("424x240 at 15 Hz", 1)
    found = find_pose(sensors.places, "base_link", "camera_depth_optical_frame")
    assert found == pytest.approx(CONFIG.camera_mount().T_base_optical)


def test_a_camera_that_is_not_there_ends_it_before_the_lidar_is_touched():
    with (
        pytest.raises(PortMissingError, match="nowhere"),
        started_sensors("/no/port", "/dev/nowhere", CONFIG, RunClock()),
    ):
        pass
