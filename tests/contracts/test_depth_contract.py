"""What every depth camera promises, checked on the emulated one and, with -m hardware, on a real one.

For the real one: MAPFUSE_DEPTH=/dev/video0 pytest -m hardware tests/contracts; without the variable it is searched.
"""

from __future__ import annotations

import os
from itertools import cycle, islice

import numpy as np
import pytest

from drivers.d435_emulator import D435Emulator
from drivers.depth_camera import DepthMode, open_depth_camera
from drivers.depth_discovery import find_depth_nodes
from drivers.system_calls import LinuxSystemCalls, SystemCalls
from tools.clock import RunClock

MODE = DepthMode(848, 480, 30)
FRAMES = 15


@pytest.fixture(
    scope="module",
    params=[
        pytest.param("emulated", marks=pytest.mark.live),
        pytest.param("real", marks=[pytest.mark.hardware, pytest.mark.live]),
    ],
)
def camera(request):
    """An open camera."""
    if request.param == "emulated":
        rng = np.random.default_rng(0)
        images = rng.integers(300, 5000, (4, MODE.height, MODE.width)).astype(np.uint16)
        calls: SystemCalls = D435Emulator(cycle(images))
        path = "/dev/video0"
    else:
        calls = LinuxSystemCalls()
        path = os.environ.get("MAPFUSE_DEPTH") or find_depth_nodes(calls).choose().path
    with open_depth_camera(path, MODE, wall_offset_ns=RunClock().offset_ns, calls=calls) as camera:
        yield camera


@pytest.fixture(scope="module")
def images(camera):
    return list(islice(camera, FRAMES))


def test_stamps_are_wall_clock_and_rise_at_the_rate(camera, images):
    stamps = np.array([image.stamp_ns for image in images])
    assert stamps[0] > 1_600_000_000 * 10**9, "wall clock, not time since boot"
    passed = np.diff(stamps) * 1e-9
    numbers = np.diff([image.sequence for image in images])
    assert np.all(passed > 0)
    assert np.median(passed / numbers) == pytest.approx(1 / MODE.fps, rel=0.05)
    assert camera.counters.frames >= FRAMES


def test_images_have_the_mode_s_size_a_unit_and_depth(images):
    for image in images:
        assert image.depth.shape == (MODE.height, MODE.width)
        assert 1e-5 <= image.unit_m <= 1e-2
        assert np.mean(image.depth > 0) > 0.1


def test_intrinsics_see_a_d435_s_field_of_view(camera):
    seen = camera.info.calibration.camera
    assert 80.0 < np.degrees(2 * np.arctan(MODE.width / 2 / seen.fx)) < 95.0
    assert seen.fx == pytest.approx(seen.fy, rel=0.02)
    assert (seen.cx, seen.cy) == pytest.approx((MODE.width / 2, MODE.height / 2), abs=30)


def test_camera_closes_twice(camera, images):
    camera.close()
    camera.close()
