from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from drivers.messages import LaserScan, Odometry, Pinhole
from mapping.camera_tracking import CameraTracking
from mapping.cloud_odometry import CloudSettings
from mapping.depth_projection import CameraMount, project
from tools.config import Config, parse
from tools.depth_flow import DepthFlow, scan_mount
from tools.depth_simulator import SimulatedDepthCamera
from tools.simulator import drive_along
from tools.solid_world import solid
from tools.world import OFFICE_TOUR, office

CAMERA = Pinhole(212, 120, 106.0, 106.0, 105.5, 59.5)
MOUNT = CameraMount(0.2, 0.05, 0.2)


@pytest.fixture(scope="module")
def images():
    """The first metres of the tour, each 0.2 s."""
    truth = drive_along(OFFICE_TOUR[:4])
    simulated = SimulatedDepthCamera(solid(office()), truth, MOUNT, camera=CAMERA)
    return truth, [simulated.frame(number * 200_000_000, number) for number in range(20)]


def flow(alone, config=None):
    return DepthFlow(config or Config(), lambda _: MOUNT, alone=alone, projection=project)


def test_beside_a_lidar_no_scan_comes_out_and_the_map_has_walls(images):
    truth, frames = images
    beside = flow(alone=False)
    for stamp, pose in zip(truth.stamps_ns.tolist(), truth.poses, strict=True):
        beside.views.add_pose(stamp, pose)
    assert [beside.add_image(frame) for frame in frames] == [[]] * len(frames)
    grid = beside.grid(truth)
    assert grid.occupied.sum() > 10
    assert grid.free.sum() > 200
    assert beside.summary()["frames"] == len(frames)


def test_alone_each_image_is_a_scan_from_the_camera_s_place(images):
    scans = [flow(alone=True).add_image(frame)[0] for frame in images[1]]
    assert [scan.stamp_ns for scan in scans] == [frame.stamp_ns for frame in images[1]]
    assert np.mean([scan.valid.sum() for scan in scans]) > 10
    assert scan_mount(MOUNT).pose.tolist() == [0.2, 0.05, 0.0]


def test_the_band_of_heights_is_configured(images):
    high = flow(alone=True, config=parse({"depth": {"bottom_m": 0.9, "top_m": 1.0}}, "test"))
    usual = flow(alone=True)
    seen = [sum(int(each.add_image(frame)[0].valid.sum()) for frame in images[1]) for each in (high, usual)]
    assert seen[0] < seen[1]


def test_far_walls_locate_the_car_though_they_are_not_drawn(images):
    near = flow(alone=True, config=parse({"depth": {"locate_range_m": 3.0}}, "test"))
    far = flow(alone=True)
    reaches = [max(each.add_image(frame)[0].ranges_m.max(initial=0.0) for frame in images[1]) for each in (near, far)]
    valid = [sum(int(each.add_image(frame)[0].valid.sum()) for frame in images[1]) for each in (near, far)]
    assert reaches[0] == reaches[1] > 3.0
    assert valid[0] < valid[1]


def test_odometry_by_clouds_gives_each_image_a_pose_before_its_scan(images):
    frames = images[1]
    by_clouds = flow(alone=True, config=parse({"depth": {"odometry": "cloud"}}, "test"))
    seen = [by_clouds.add_image(frame) for frame in frames]
    assert by_clouds.tracks
    assert {tuple(type(message) for message in each) for each in seen} == {(Odometry, LaserScan)}
    tracking = CameraTracking(CloudSettings(), in_hand=False)
    expected = [tracking.add(frame, MOUNT).pose for frame in frames]
    assert np.array_equal([each[0].pose for each in seen], np.array(expected))
    assert {message.stamp_ns for each in seen for message in each} == {frame.stamp_ns for frame in frames}


@pytest.mark.parametrize("settings", [{}, {"depth": {"odometry": "cloud"}, "odometry": {"source": "recorded"}}])
def test_poses_from_elsewhere_are_not_tracked_again(settings):
    assert not flow(alone=True, config=parse(settings, "test")).tracks
    assert not flow(alone=False, config=parse({"depth": {"odometry": "cloud"}}, "test")).tracks


# Prints how often Open3D was asked for, whether it is installed or not.
LOOKS_FOR_OPEN3D = """
import sys, threading
from pathlib import Path

asked = []

class Watch:
    def find_spec(self, name, path=None, target=None):
        if name == "open3d":
            asked.append(name)

sys.meta_path.insert(0, Watch())

from drivers.pty_port import PtyPort
from drivers.recording_reader import open_recording
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M8
from tools.config import Config, parse
from tools.emulation import Drive, simulated_lidar
from tools.lidar_session import SensorPorts, run_session
from tools.pipeline import warm_up
from tools.replay_run import replay_recording
from tools.signals import Stop

config = parse({"slam": {"refine": False}, "depth": {"width": 424, "height": 240, "fps": 15}}, "test")
camera, folder = sys.argv[1] or None, Path(sys.argv[2])

def live():
    stop = Stop()
    ranger = simulated_lidar("office", Drive.tour("office"), noise=True, seed=3)
    emulator = RplidarEmulator(A2M8, ranger, startup_s=-0.2)
    with PtyPort(emulator, A2M8.baud) as port:
        return run_session(SensorPorts(port.name, camera), config, lambda: begun(stop), stop, record=True)

def begun(stop):
    threading.Timer(2.5, stop.set).start()  # the sensors have started, however long that took
    return folder

folder.mkdir()
warm_up()
report, _ = live()
assert report["scans"]["mapped"] > 3, report
with open_recording(folder / "recording.mcap") as recording:
    replay_recording(recording, config, folder / "again", on_progress=lambda _: None)
print(len(asked))
"""


@pytest.mark.live(cores=1)
@pytest.mark.parametrize(("camera", "is_asked_for"), [("", False), ("emulated:office", True)])
def test_open3d_is_imported_only_where_there_is_depth(camera, is_asked_for, tmp_path):
    command = [sys.executable, "-c", LOOKS_FOR_OPEN3D, camera, str(tmp_path / "run")]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert (int(result.stdout) > 0) == is_asked_for
