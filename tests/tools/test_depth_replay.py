"""Recordings with depth through the replay: beside a lidar, alone, and with the poses that they came with."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from drivers.errors import RecordingError
from drivers.messages import DepthImage, LidarStream, Pinhole, RawChunk, Transform
from drivers.recording_reader import open_recording
from drivers.recording_writer import McapRecorder
from mapping.depth_projection import CameraMount
from mapping.map_io import read_map
from mapping.metrics import absolute_trajectory_error
from mapping.trajectory import Trajectory, read_tum
from tools.config import Config, parse
from tools.depth_simulator import SimulatedDepthCamera
from tools.replay_run import recorded_config, replay_recording
from tools.simulator import drive_along
from tools.solid_world import solid
from tools.world import OFFICE_TOUR, office

CAMERA = Pinhole(212, 120, 106.0, 106.0, 105.5, 59.5)
MOUNT = Config().camera_mount()
SECONDS = 12


def planar(stamp_ns, parent, child, pose):
    x, y, yaw = pose
    quaternion = np.array([0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)])
    return Transform(stamp_ns, parent, child, np.array([x, y, 0.0]), quaternion)


def written(path, messages):
    with McapRecorder(path, metadata={}) as recorder:
        for message in messages:
            recorder.put(message)
    return path


def replayed(path, folder, settings=None):
    with open_recording(path) as recording:
        config = recorded_config(recording) if settings is None else parse(settings, "test")
        return replay_recording(recording, config, folder, on_progress=lambda _: None)


def images_along(truth, every_s=0.1):
    simulated = SimulatedDepthCamera(solid(office()), truth, MOUNT, camera=CAMERA)
    start, end = int(truth.stamps_ns[0]), int(truth.stamps_ns[-1])
    stamps = range(start, min(end, start + SECONDS * 10**9), round(every_s * 1e9))
    return [simulated.frame(stamp, number) for number, stamp in enumerate(stamps)]


@pytest.fixture(scope="module")
def both(project_root, tmp_path_factory):
    """Two recordings of the lidar of the simulated office, with and without a camera, and their replays."""
    folder = tmp_path_factory.mktemp("both")
    source = project_root / "recordings/simulated_office_a2m8.mcap"
    truth = read_tum(source.with_name("simulated_office_a2m8.truth.tum"))
    with open_recording(source) as recording:
        lidar = [message for message in recording.messages() if isinstance(message, (LidarStream, RawChunk, Transform))]
    first_ns = next(message.stamp_ns for message in lidar if isinstance(message, RawChunk))
    lidar = [message for message in lidar if message.stamp_ns < first_ns + SECONDS * 10**9]
    images = images_along(truth)
    alone = written(folder / "lidar.mcap", lidar)
    joined = sorted([*lidar, *images], key=lambda message: message.stamp_ns)
    together = written(folder / "both.mcap", joined)
    return folder, replayed(alone, folder / "lidar"), replayed(together, folder / "both"), len(images)


def test_a_camera_changes_nothing_of_what_the_lidar_maps(both):
    folder, _, report, images = both
    for name in ("map.pgm", "map.yaml", "map.png", "trajectory.tum", "pose_graph.png"):
        assert (folder / "lidar" / name).read_bytes() == (folder / "both" / name).read_bytes(), name
    assert not (folder / "lidar/depth_map.yaml").exists()
    assert report["depth"]["frames"] == images


def test_the_camera_s_map_shows_the_lidar_s_walls(both):
    folder = both[0]
    lidar, depth = (read_map(folder / "both" / f"{name}.npz") for name in ("map", "depth_map"))
    rows, cols = np.nonzero(depth.occupied)
    cells = np.floor(lidar.cell_coordinates(depth.cell_centers(rows, cols))).astype(int)
    near = cv2.dilate(lidar.occupied.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    inside = (cells >= 0).all(axis=1) & (cells < np.array(near.shape[::-1])).all(axis=1)
    assert len(cells) > 50
    assert near[cells[inside, 1], cells[inside, 0]].mean() > 0.8


def test_both_in_one_is_the_sum_of_the_evidence(both):
    folder = both[0]
    lidar, depth, sum_ = (read_map(folder / "both" / f"{name}.npz") for name in ("map", "depth_map", "both_map"))
    rows, cols = np.nonzero(lidar.known)
    centers = lidar.cell_centers(rows, cols)
    of_sum = np.floor(sum_.cell_coordinates(centers)).astype(int)
    of_depth = np.floor(depth.cell_coordinates(centers)).astype(int)
    inside = (of_depth >= 0).all(axis=1) & (of_depth < np.array(depth.log_odds.shape[::-1])).all(axis=1)
    expected = lidar.log_odds[rows, cols].copy()
    expected[inside] += depth.log_odds[of_depth[inside, 1], of_depth[inside, 0]]
    assert sum_.log_odds[of_sum[:, 1], of_sum[:, 0]] == pytest.approx(np.clip(expected, -7, 7), abs=2e-3)


@pytest.fixture(scope="module")
def tracked(tmp_path_factory):
    """A camera alone on a car whose poses are in /tf."""
    drive = drive_along(OFFICE_TOUR[:9])
    truth = Trajectory(drive.stamps_ns + 10**18, drive.poses)
    messages = []
    for image in images_along(truth):
        pose = truth.at(np.array([image.stamp_ns]))[0]
        messages += [planar(image.stamp_ns, "map", "base_link", pose), image]
    return written(tmp_path_factory.mktemp("tracked") / "depth.mcap", messages), truth


def test_recorded_poses_are_taken_as_they_are(tracked, tmp_path):
    path, truth = tracked
    report = replayed(path, tmp_path, {"odometry": {"source": "recorded"}})
    found = read_tum(tmp_path / "trajectory.tum")
    start = truth.at(found.stamps_ns[:1])[0]
    cos, sin = np.cos(start[2]), np.sin(start[2])
    off = truth.at(found.stamps_ns)[:, :2] - start[:2]
    expected = np.stack([cos * off[:, 0] + sin * off[:, 1], cos * off[:, 1] - sin * off[:, 0]], axis=1)
    assert found.poses[:, :2] == pytest.approx(expected, abs=1e-6)
    assert report["map"]["occupied_cells"] > 50
    assert not (tmp_path / "depth_map.yaml").exists(), "it is the map"


def test_a_camera_alone_locates_itself(tmp_path):
    drive = drive_along(OFFICE_TOUR[:6])
    truth = Trajectory(drive.stamps_ns + 10**18, drive.poses)
    simulated = SimulatedDepthCamera(
        solid(office()), truth, MOUNT, camera=Pinhole(424, 240, 212.0, 212.0, 211.5, 119.5)
    )
    images = [simulated.frame(10**18 + number * 66_666_667, number) for number in range(75)]
    report = replayed(written(tmp_path / "depth.mcap", images), tmp_path / "out")
    assert report["scans"]["received"] == report["scans"]["mapped"] == report["depth"]["frames"] == 75
    found = read_tum(tmp_path / "out/trajectory.tum")
    way = np.linalg.norm(truth.at(found.stamps_ns)[:, :2] - truth.poses[0, :2], axis=1)
    assert way[-1] > 1.5
    assert np.linalg.norm(found.poses[:, :2], axis=1) == pytest.approx(way, abs=0.15)


def test_own_poses_are_compared_with_the_recorded_ones(tracked, tmp_path):
    path, truth = tracked
    report = replayed(path, tmp_path, {})
    error = report["trajectory_error"]
    found = read_tum(tmp_path / "trajectory.tum")
    again = absolute_trajectory_error(found, truth)
    assert error["poses"] == len(found)
    assert error["rms_m"] == pytest.approx(again.rms_m, abs=1e-3)
    assert error["rms_m"] > 0.0


def test_recorded_poses_are_not_compared_with_themselves(tracked, tmp_path):
    report = replayed(tracked[0], tmp_path, {"odometry": {"source": "recorded"}})
    assert "trajectory_error" not in report


@pytest.mark.real_data
def test_a_camera_in_the_hand_follows_its_clouds_as_the_recorded_poses_say(data_dir, tmp_path):
    settings = {"depth": {"odometry": "cloud", "tilt": "tracked"}}
    report = replayed(data_dir / "sevenscenes_kinect", tmp_path, settings)
    error = report["trajectory_error"]
    assert error["poses"] == 125
    assert error["rms_m"] < 0.1
    assert error["rms_deg"] < 2.0


def test_poses_that_are_not_there_are_one_clear_line(tmp_path):
    image = DepthImage(10**18, np.full((120, 212), 1500, np.uint16), 0.001, CAMERA)
    path = written(tmp_path / "depth.mcap", [image])
    with pytest.raises(RecordingError, match="no poses of the car or its camera"):
        replayed(path, tmp_path / "out", {"odometry": {"source": "recorded"}})
    assert not (tmp_path / "out").exists()


def test_the_camera_s_mount_is_taken_from_static_transforms(tmp_path):
    mount = CameraMount(0.31, 0.02, 0.25, 0.0, 0.1, 0.0)
    pose = mount.T_base_optical
    w = np.sqrt(1.0 + np.trace(pose[:3, :3])) / 2.0
    r = pose[:3, :3]
    quaternion = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 4 * w * w]) / (4 * w)
    static = Transform(10**18, "base_link", "camera_depth_optical_frame", pose[:3, 3], quaternion, static=True)
    image = images_along(Trajectory(np.array([10**18, 10**18 + 10**8]), np.array([OFFICE_TOUR[0] + (0.0,)] * 2)))[0]
    report = replayed(written(tmp_path / "depth.mcap", [static, image]), tmp_path / "out")
    found = report["depth"]["camera_pose"]
    assert found["source"] == "/tf_static base_link -> camera_depth_optical_frame"
    assert (found["x_m"], found["z_m"], found["pitch_rad"]) == pytest.approx((0.31, 0.25, 0.1), abs=1e-6)
