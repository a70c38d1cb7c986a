"""Frames of a real depth camera (Kinect, hand-held, 7-Scenes) with the poses that came with them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from drivers.messages import DepthImage, Pinhole
from drivers.recording_reader import open_recording
from mapping.depth_grid import DepthGridBuilder
from mapping.depth_projection import CameraMount, project
from mapping.depth_sensor_model import DepthModel
from mapping.depth_thinning import Thinning, thinned
from mapping.map_io import read_map
from mapping.virtual_scan import ScanSettings, StereoNoise, scan_depth
from tools.config import parse
from tools.replay_run import replay_recording

pytestmark = pytest.mark.real_data

KINECT = StereoNoise(disparity_px=0.07, baseline_m=0.075)


@pytest.fixture(scope="module")
def frames(data_dir):
    """Each frame's image, pose of base_link in a level frame (on the floor below the camera), and camera mount.

    The set states the direction of gravity. The floor is the lowest plane: the first peak of the points' heights.
    """
    folder = data_dir / "sevenscenes_kinect"
    matrix = np.loadtxt(folder / "camera-intrinsics.txt")
    camera = Pinhole(640, 480, matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    up = -np.loadtxt(folder / "gravity-direction.txt")
    up /= np.linalg.norm(up)
    ahead = np.array([0.0, 0.0, 1.0]) - up * up[2]
    ahead /= np.linalg.norm(ahead)
    turn = np.stack([ahead, np.cross(up, ahead), up])
    images, poses = [], []
    for number, path in enumerate(sorted(folder.glob("*.depth.png"))):
        depth = np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), np.uint16)
        images.append(DepthImage(number, depth, 0.001, camera))
        pose = np.loadtxt(path.with_name(path.name.replace(".depth.png", ".pose.txt")))
        pose[:3] = turn @ pose[:3]
        poses.append(pose)
    floor = floor_height(images, poses)
    return [(image, *on_the_floor(pose, floor)) for image, pose in zip(images, poses, strict=True)]


def on_the_floor(T_map_optical, floor_m):
    """Return the pose (3,) below the camera, heading where it looks, and the mount there."""
    yaw = np.arctan2(T_map_optical[1, 2], T_map_optical[0, 2])
    T_map_base = np.eye(4)
    T_map_base[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T_map_base[:3, 3] = T_map_optical[0, 3], T_map_optical[1, 3], floor_m
    mount = CameraMount.from_matrix4(np.linalg.inv(T_map_base) @ T_map_optical)
    return np.array([T_map_optical[0, 3], T_map_optical[1, 3], yaw]), mount


def floor_height(images, poses):
    coarse = Thinning(decimation=8)
    points = [
        project(thinned(image, coarse), CameraMount.from_matrix4(pose))[:, 2]
        for image, pose in zip(images, poses, strict=True)
    ]
    counts, edges = np.histogram(np.concatenate(points), np.arange(-3.0, 1.0, 0.05))
    lowest = np.flatnonzero(counts > 0.2 * counts.max())[0]
    return float(edges[lowest] + 0.025)


def scans_of(frames, settings):
    return [(pose, scan_depth(image, mount, settings)) for image, pose, mount in frames]


def test_camera_is_held_at_breast_height_and_sees_a_level_floor(frames):
    heights = np.array([mount.z_m for _, _, mount in frames])
    assert heights.min() > 1.1
    assert heights.max() < 1.6
    low = np.concatenate(
        [project(thinned(image, Thinning(decimation=8)), mount)[:, 2] for image, _, mount in frames[::5]]
    )
    on_floor = low[np.abs(low) < 0.15]
    assert len(on_floor) > 500
    assert np.abs(np.median(on_floor)) < 0.03
    assert np.std(on_floor) < 0.05


def test_half_of_the_frames_finds_the_other_halfs_obstacles_where_they_are(frames):
    scans = scans_of(frames, ScanSettings(noise=KINECT))
    builder = DepthGridBuilder(0.05, DepthModel())
    for pose, scan in scans[::2]:
        builder.add_scan(pose, scan)
    grid = builder.grid()
    occupied = cv2.dilate(grid.occupied.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    beside, inside_free, count = 0, 0, 0
    for pose, scan in scans[1::2]:
        met = (scan.ranges_m > 0.0) & (scan.ranges_m < 2.5)
        heading = pose[2] + scan.angles_rad[met]
        ends = pose[:2] + scan.ranges_m[met, np.newaxis] * np.column_stack([np.cos(heading), np.sin(heading)])
        cells = np.clip(np.floor(grid.cell_coordinates(ends)).astype(int), 0, np.array(occupied.shape[::-1]) - 1)
        beside += np.count_nonzero(~occupied[cells[:, 1], cells[:, 0]])
        inside_free += np.count_nonzero(grid.free[cells[:, 1], cells[:, 0]])
        count += np.count_nonzero(met)
    assert count > 5000
    assert beside < 0.05 * count
    assert inside_free < 0.01 * count


def replayed(path, folder, settings):
    with open_recording(path) as recording:
        return replay_recording(recording, parse(settings, "test"), folder, on_progress=lambda _: None)


def test_kinect_folder_is_mapped_with_its_own_poses(data_dir, tmp_path):
    report = replayed(data_dir / "sevenscenes_kinect", tmp_path, {"odometry": {"source": "recorded"}})
    assert report["scans"]["mapped"] == 125
    grid = read_map(tmp_path / "map.npz")
    walls = cv2.distanceTransform(grid.occupied.astype(np.uint8), cv2.DIST_L2, 3)
    assert grid.occupied.sum() > 150
    assert np.percentile(walls[grid.occupied], 90) * grid.resolution_m < 0.15


def test_standing_d435_gives_a_small_map(data_dir, tmp_path):
    file = data_dir / "rosbag_misc/librealsense_single_depth_color_640x480.bag"
    report = replayed(file, tmp_path, {})
    assert report["depth"]["frames"] == 2
    assert report["map"]["occupied_cells"] > 20
    assert report["trajectory"]["length_m"] < 0.02
