from __future__ import annotations

import numpy as np
import pytest

from drivers.errors import RecordingError
from drivers.messages import LaserScan
from drivers.recording_reader import open_recording
from tools.pipeline import LidarDecoding
from tools.simulated_drive import record_round_trip, round_trip
from tools.world import office


def test_the_car_drives_round_and_round_and_through_no_wall():
    drive = round_trip(1500)
    assert drive.stamps_ns[-1] >= 150e9
    world = office()
    bearings = np.linspace(-np.pi, np.pi, 36, endpoint=False)
    for pose in drive.poses[::10]:
        ranges = world.ranges(np.tile(pose, (36, 1)), bearings, 12.0)
        assert ranges[ranges > 0].min() > 0.15
        assert (ranges > 0).any()
    # The second round is the first one again.
    once = int(1e9 * 100 / np.median(np.diff(drive.stamps_ns)))
    later, first = drive.poses[once:, :2], drive.poses[: once // 4, :2]
    nearest = [np.hypot(*(later - place).T).min() for place in first[100::50]]
    assert max(nearest) < 0.2


def test_the_recording_holds_so_many_turns_of_an_a2_and_says_that_it_is_simulated(tmp_path):
    path = tmp_path / "drive.mcap"
    record_round_trip(path, 12)
    decoding = LidarDecoding()
    with open_recording(path) as recording:
        assert recording.metadata["mapfuse.origin"]["simulated"] == "true"
        assert recording.has_raw
        scans = [
            decoded
            for message in recording.messages()
            for decoded in decoding.feed(message)
            if isinstance(decoded, LaserScan)
        ]
    assert len(scans) == 12
    assert all(abs(len(scan.ranges_m) - 800) < 20 for scan in scans[1:])
    np.testing.assert_allclose(np.diff([scan.stamp_ns for scan in scans[1:]]), 1e8, rtol=0.02)
    with pytest.raises(RecordingError, match="exists already"):
        record_round_trip(path, 12)
