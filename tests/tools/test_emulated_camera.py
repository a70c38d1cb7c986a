from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest

from drivers.d435_emulated_firmware import emulated_pinhole
from drivers.depth_camera import DepthMode, open_depth_camera
from drivers.errors import PortMissingError
from mapping.depth_projection import CameraMount
from mapping.trajectory import Trajectory
from tools.depth_simulator import SimulatedDepthCamera
from tools.emulated_camera import CarView, EmulatedCar, emulated_camera
from tools.solid_world import solid
from tools.world import office

MODE = DepthMode(424, 240, 15)
SIZE = (MODE.width, MODE.height)
MOUNT = CameraMount(0.2, 0.0, 0.2)
DRIVE = Trajectory(np.array([0, 10**9]), np.array([[2.0, 3.6, 0.0], [3.0, 3.6, 0.0]]))


def test_a_car_s_file_holds_all_of_it(tmp_path):
    EmulatedCar("office", DRIVE, 7).write(tmp_path / "car.json")
    read = EmulatedCar.read(tmp_path / "car.json")
    assert (read.world, read.start_ns) == ("office", 7)
    assert np.array_equal(read.drive.poses, DRIVE.poses)
    assert [file.name for file in tmp_path.iterdir()] == ["car.json"]


def test_the_camera_looks_from_where_the_shared_car_is(tmp_path):
    """It stands until the lidar says when the car set out, on the clock of both."""
    file = tmp_path / "car.json"
    EmulatedCar("office", DRIVE).write(file)
    view = CarView(EmulatedCar.read(file), SIZE, MOUNT, file)
    standing = view(5 * 10**9)
    EmulatedCar("office", DRIVE, 6 * 10**9).write(file)
    under_way = view(6 * 10**9 + 5 * 10**8)
    simulated = SimulatedDepthCamera(solid(office()), DRIVE, MOUNT, camera=emulated_pinhole(SIZE))
    assert np.array_equal(standing, simulated.frame(0, 0).depth)
    assert np.array_equal(under_way, simulated.frame(5 * 10**8, 1).depth)


def test_a_car_of_its_own_sets_out_a_second_after_the_first_image():
    view = CarView(EmulatedCar("office", DRIVE), SIZE, MOUNT)
    simulated = SimulatedDepthCamera(solid(office()), DRIVE, MOUNT, camera=emulated_pinhole(SIZE))
    assert np.array_equal(view(10**12), simulated.frame(0, 0).depth)
    assert np.array_equal(view(10**12 + 15 * 10**8), simulated.frame(5 * 10**8, 1).depth)


@pytest.mark.live(cores=1)
def test_the_unmodified_driver_reads_it():
    emulator = emulated_camera("emulated:office", SIZE, MOUNT)
    with open_depth_camera(emulator.path, MODE, calls=emulator) as camera:
        image = next(iter(camera))
    assert astuple(image.camera) == pytest.approx(astuple(emulated_pinhole(SIZE)))  # float32 in its tables
    assert np.mean(image.depth > 0) > 0.3


def test_what_is_no_camera_is_one_clear_line(tmp_path):
    with pytest.raises(PortMissingError, match="name a drive"):
        emulated_camera("emulated:nowhere", SIZE, MOUNT)
    (tmp_path / "car.json").write_text("{}")
    with pytest.raises(PortMissingError, match="not the file of an emulated car"):
        emulated_camera(f"emulated:{tmp_path / 'car.json'}", SIZE, MOUNT)
