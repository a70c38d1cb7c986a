from __future__ import annotations

import numpy as np
import pytest

from drivers.messages import DepthImage, Odometry, Transform
from drivers.recording_reader import open_recording
from mapping.trajectory import Trajectory
from tools.demo_camera import camera_line, record_camera_drive
from tools.simulator import drive_along
from tools.world import WINGS_WEST_TOUR, wings


@pytest.fixture(scope="module")
def truth() -> Trajectory:
    drive = drive_along(WINGS_WEST_TOUR[::-1][:18], 0.5)
    return Trajectory(drive.stamps_ns[:40] + 10**9, drive.poses[:40])


def test_recording_holds_images_wheels_and_where_the_camera_sits(truth, tmp_path):
    record_camera_drive(tmp_path / "drive.mcap", truth, 1)
    with open_recording(tmp_path / "drive.mcap") as recording:
        assert recording.metadata["mapfuse.origin"]["simulated"] == "true"
        messages = list(recording.messages(None))
    images = [message for message in messages if isinstance(message, DepthImage)]
    wheels = [message for message in messages if isinstance(message, Odometry)]
    assert len(images) == pytest.approx(6.0 * np.ptp(truth.stamps_ns) * 1e-9, abs=1.1)
    assert [message.stamp_ns for message in wheels] == truth.stamps_ns.tolist()
    assert images[0].depth.shape == (240, 424)
    assert sum(isinstance(message, Transform) and message.static for message in messages) == 1


def test_stopping_ends_the_simulation(truth, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        record_camera_drive(tmp_path / "drive.mcap", truth, 1, lambda: True)


def test_the_way_back_from_the_hall_keeps_clear_of_everything():
    world, drive = wings(), drive_along(WINGS_WEST_TOUR[::-1][:18], 0.5)
    cells = np.floor((drive.poses[:, :2] - world.origin[:2]) / world.resolution_m).astype(int)
    reach = round(0.12 / world.resolution_m)
    for dx in range(-reach, reach + 1):
        for dy in range(-reach, reach + 1):
            if dx * dx + dy * dy <= reach * reach:
                assert not world.occupied[cells[:, 1] + dy, cells[:, 0] + dx].any()


@pytest.mark.parametrize(
    ("scored", "words"),
    [
        ({"accepted": True, "rms_m": 0.094, "rotation_deg": 0.3}, "fused with car A's lidar map, error 9.4 cm, 0.30"),
        ({"accepted": False, "rms_m": None, "rotation_deg": None}, "REFUSED, not fused with car A's lidar map"),
    ],
)
def test_the_line_tells_verdict_and_error(scored, words):
    assert camera_line(scored).startswith(words)
