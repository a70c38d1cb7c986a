from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.messages import LaserScan, LidarStream, Odometry, RawChunk
from drivers.recording_reader import open_recording
from mapping.frames import planar_transform
from tools.config import Config, parse
from tools.pipeline import LidarDecoding, MappingFlow, look_ahead, resolve_mount

CONFIG_MOUNT = Config().mount()


def scan(stamp_ns=0, frame_id="laser"):
    angles = np.linspace(0, 6, 100)
    return LaserScan(stamp_ns, angles, np.full(100, 2.0), np.zeros(100), 0.1, 12.0, frame_id)


def pose(x, y, yaw):
    return np.array([x, y, yaw])


def test_static_transform_comes_before_the_configuration():
    mount, source = resolve_mount([planar_transform(0, "base_link", "laser", pose(1, 2, 0.5))], Config(), None, "laser")
    assert np.allclose(mount.pose, [1, 2, 0.5])
    assert "tf_static" in source


def test_configuration_serves_where_no_transform_leads_to_the_laser():
    elsewhere = planar_transform(0, "base_link", "camera", pose(1, 2, 0.5))
    mount, source = resolve_mount([elsewhere], Config(), None, "laser")
    assert np.array_equal(mount.pose, CONFIG_MOUNT.pose)
    assert "config" in source


def test_base_frame_is_odometrys_child_or_as_configured():
    transforms = [
        planar_transform(0, "chassis", "laser", pose(0, 0, 1.0)),
        planar_transform(0, "base_link", "chassis", pose(0, 0, 0.5)),
    ]
    odometry = Odometry(0, np.zeros(3), np.zeros(3), child_frame_id="chassis")
    by_odometry = look_ahead([*transforms, odometry, scan()], Config())
    assert by_odometry.mount.pose[2] == pytest.approx(1.0)
    by_default = look_ahead([*transforms, scan()], Config())
    assert by_default.mount.pose[2] == pytest.approx(1.5)
    configured = parse({"replay": {"base_frame": "base_link"}}, "test")
    assert look_ahead([*transforms, odometry, scan()], configured).mount.pose[2] == pytest.approx(1.5)


def test_sweep_can_be_set_and_is_known_for_raw_bytes():
    reversed_ = parse({"replay": {"sweep": "reversed"}}, "test")
    assert look_ahead([scan()], reversed_).sweep.is_reversed
    assert not look_ahead([RawChunk(0, b"")], reversed_).sweep.is_reversed
    assert not look_ahead([scan()], Config()).sweep.is_reversed


def test_chunks_before_a_stream_is_described_are_not_decoded():
    decoding = LidarDecoding()
    assert decoding.feed(RawChunk(0, b"\xa5\x5a")) == []
    assert decoding.counters == []


def test_a_second_stream_is_counted_beside_the_first(project_root):
    decoding = LidarDecoding()
    with open_recording(project_root / "recordings/simulated_office_a2m8.mcap") as recording:
        messages = [message for message in recording.messages() if isinstance(message, (LidarStream, RawChunk))][:300]
    scans = [decoded for message in messages + messages for decoded in decoding.feed(message)]
    first, second = decoding.counters
    assert first == second
    assert first.scans == len(scans) // 2 > 10


def test_flow_times_what_it_maps_and_passes_over_other_messages():
    flow = MappingFlow(Config(), CONFIG_MOUNT)
    assert flow.feed(planar_transform(0, "a", "b", pose(0, 0, 0))) == []
    assert len(flow.feed(scan())) == 1
    assert (flow.scans, len(flow.seconds)) == (1, 1)
    assert flow.finish() == []


def test_either_base_frame_serves_where_odometry_names_the_other():
    transforms = [planar_transform(0, "base_link", "laser", pose(0.1, 0, 3.0))]
    mount, source = resolve_mount(transforms, Config(), "base_footprint", "laser")
    assert mount.pose[2] == pytest.approx(3.0)
    assert "tf_static" in source


def test_what_hides_the_car_does_not_get_into_the_map():
    angles = np.linspace(-np.pi, np.pi, 720, endpoint=False)
    post = np.where(np.abs(np.abs(angles) - np.pi) < 0.3, 0.5, 2.0)  # the car's own mast, behind the laser
    turn = LaserScan(0, angles, post, np.zeros(720), 0.1, 12.0)
    hidden = [{"from_rad": 2.7, "to_rad": -2.7, "nearer_than_m": 0.6}]
    occupied = []
    for settings in ({}, {"lidar": {"hidden": hidden}}):
        flow = MappingFlow(parse(settings, "test"), CONFIG_MOUNT)
        for number in range(5):
            flow.feed(replace(turn, stamp_ns=number * 100_000_000))
        flow.finish()
        grid = flow.maps()["map"]
        rows, cols = np.nonzero(grid.occupied)
        away_m = np.hypot(
            *(
                np.stack([cols, rows]) * grid.resolution_m
                + np.asarray(grid.origin)[:2, None]
                - CONFIG_MOUNT.pose[:2, None]
            )
        )
        occupied.append(int((away_m < 1.0).sum()))
    assert occupied[0] > 3
    assert occupied[1] == 0
