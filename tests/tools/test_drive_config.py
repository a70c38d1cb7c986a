"""The sections `vehicle` and `drive`: the limits and rules that come out of them."""

from __future__ import annotations

import math

import pytest

from planning.collision import LookAheadSettings
from planning.follower import FollowerSettings
from planning.motion_prediction import MotionModel
from planning.safety import SafetyLimits
from tools.config import Config, ConfigError, load
from tools.drive_config import DriveSection, VehicleSection
from tools.drive_settings import AutopilotSettings
from tools.live_drive import autopilot_settings


def test_the_defaults_are_the_parts_own():
    car, drive = VehicleSection(), DriveSection()
    assert car.motion() == MotionModel()
    assert drive.safety(car) == SafetyLimits()
    assert drive.follower(car.curvature_limit_1pm) == FollowerSettings()
    assert drive.look_ahead() == LookAheadSettings()
    assert autopilot_settings(Config()) == AutopilotSettings(), "what the simulator drives with is what run drives with"


def test_a_qcar_turns_as_tightly_as_its_steering_and_plans_leave_a_third_to_correct_with():
    config = Config()
    tightest_m = 1.0 / config.vehicle.curvature_limit_1pm
    assert tightest_m == pytest.approx(0.443, abs=5e-4)
    assert config.planning.turning_radius_m == pytest.approx(1.3 * tightest_m, abs=1e-3)


def test_another_car_is_steered_within_its_own_limits(tmp_path):
    (tmp_path / "c.yaml").write_text("vehicle: {wheelbase_m: 0.5, steering_limit_rad: 0.4}\ndrive: {speed_mps: 0.3}\n")
    config = load(tmp_path / "c.yaml")
    limits = config.drive.safety(config.vehicle)
    assert limits.curvature_1pm == pytest.approx(math.tan(0.4) / 0.5)
    assert limits.speed_mps == 0.3


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("drive: {speed_mps: 0}", "drive.speed_mps"),
        ("drive: {margins_m: []}", "drive.margins_m"),
        ("drive: {margins_m: [0.1, -0.1]}", r"margins_m \[0.1, -0.1\]"),
        ("drive: {least_lookahead_m: 2}", "least_lookahead_m 2.0 is above most_lookahead_m 0.9"),
        ("drive: {pose_age_s: 60}", "drive.pose_age_s"),
        ("vehicle: {steering_limit_rad: 1.6}", "vehicle.steering_limit_rad"),
        ("vehicle: {speed: 1}", "unknown key 'vehicle.speed'"),
    ],
)
def test_what_cannot_be_is_told_in_one_line(tmp_path, text, words):
    (tmp_path / "c.yaml").write_text(text + "\n")
    with pytest.raises(ConfigError, match=words) as caught:
        load(tmp_path / "c.yaml")
    assert "\n" not in str(caught.value)
