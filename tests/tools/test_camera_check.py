from __future__ import annotations

import pytest

from drivers.d435_emulated_firmware import EMULATED_SERIAL, emulated_pinhole
from drivers.errors import PortMissingError
from tools.camera_check import check_camera
from tools.config import parse

CONFIG = parse({"depth": {"width": 424, "height": 240, "fps": 15}}, "test")


@pytest.mark.live(cores=1)
def test_what_is_found_of_an_emulated_camera():
    check = check_camera("emulated:office", CONFIG, 8)
    assert check.simulated
    assert (check.serial, check.frames, check.mode) == (EMULATED_SERIAL, 8, "424x240 at 15 Hz")
    assert check.focal_px == pytest.approx(emulated_pinhole((424, 240)).fx)
    assert check.valid_share is not None
    assert 0.5 < check.valid_share < 1.0
    assert check.rate_hz == pytest.approx(15.0, rel=0.1)
    assert check.unit_m == pytest.approx(0.001)


def test_no_frames_are_asked_for():
    check = check_camera("emulated:office", CONFIG, 0)
    assert (check.frames, check.valid_share, check.rate_hz, check.advice) == (0, None, None, [])


def test_few_measured_pixels_are_advised_on():
    low = parse({"depth": {"width": 424, "height": 240, "fps": 15, "mount": {"z_m": 0.03, "pitch_rad": 0.8}}}, "test")
    check = check_camera("emulated:office", low, 1)  # it looks at the floor from too near for stereo
    assert any("of the pixels are measured" in line for line in check.advice)


def test_a_system_without_cameras_is_one_clear_line(tmp_path):
    with pytest.raises(PortMissingError, match="among 0 video nodes"):
        check_camera("auto", CONFIG, 1, sysfs=tmp_path)


@pytest.mark.live(cores=1)
def test_doctor_tells_it(cli):
    outcome = cli("doctor", "--camera", "--depth", "emulated:office", "--capture", "2")
    assert outcome.code in {0, 3}
    assert "EMULATED" in outcome.out
    assert "2 frames" in outcome.out


def test_doctor_alone_looks_at_all_it_can(cli):
    outcome = cli("doctor", "--depth", "emulated:office", "--capture", "1")
    asked = cli("doctor", "--camera", "--depth", "emulated:office", "--capture", "1")
    assert outcome.out.splitlines()[0] == asked.out.splitlines()[0]


def test_doctor_alone_says_how_the_lidar_is_checked_even_where_there_is_no_camera(cli):
    for options in (["--depth", "emulated:nowhere"], ["--depth", "emulated:office", "--capture", "0", "--json"]):
        outcome = cli("doctor", *options)
        assert [line for line in outcome.err.splitlines() if "--lidar PORT" in line], options
        assert "--lidar" not in outcome.out
    assert "--lidar" not in cli("doctor", "--camera", "--depth", "emulated:nowhere").err
