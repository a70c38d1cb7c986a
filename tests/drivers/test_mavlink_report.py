"""What the vehicle's messages mean."""

import logging
import math

import numpy as np
import pytest

from drivers.mavlink_codec import MavlinkCodec
from drivers.mavlink_report import VehicleReport
from drivers.messages import Imu, Odometry

MS = 1_000_000
CODEC = MavlinkCodec(1, 1)


def message(name: str, /, **fields):
    (found,) = MavlinkCodec(255, 191).decode(CODEC.encode(name, **fields))
    return found


def heartbeat(autopilot: int = 3, kind: int = 10, base_mode: int = 0, custom_mode: int = 0):
    return message(
        "HEARTBEAT",
        type=kind,
        autopilot=autopilot,
        base_mode=base_mode,
        custom_mode=custom_mode,
        system_status=4,
        mavlink_version=3,
    )


def attitude(ms: int, yaw: float, rate: float = 0.0):
    return message(
        "ATTITUDE",
        time_boot_ms=ms,
        yaw=yaw,
        yawspeed=rate,
        **dict.fromkeys(("roll", "pitch", "rollspeed", "pitchspeed"), 0.0),
    )


def wheels(ms: int, *metres: float):
    return message(
        "WHEEL_DISTANCE", time_usec=ms * 1000, count=len(metres), distance=[*metres, *[0.0] * (16 - len(metres))]
    )


def test_state_by_heartbeats_of_vehicles_alone() -> None:
    report = VehicleReport()
    report.hear(heartbeat(autopilot=8, kind=6), 1)
    assert not report.heartbeat
    report.hear(heartbeat(base_mode=1 | 128, custom_mode=15), 2)
    report.hear(heartbeat(autopilot=8, kind=26), 3)  # a gimbal
    found = report.heartbeat
    assert found is not None
    assert (found.armed, found.mode, found.stamp_ns) == (True, "GUIDED", 2)


def test_words_of_one_line_and_of_several(caplog) -> None:
    report, text = VehicleReport(), "PreArm: " + "x" * 70
    with caplog.at_level(logging.INFO):
        report.hear(message("STATUSTEXT", severity=4, text=b"Low battery"), 0)
        for chunk, part in enumerate((text[:50], text[50:])):
            report.hear(message("STATUSTEXT", severity=2, text=part.encode(), id=7, chunk_seq=chunk), 0)
    assert report.words == ["Low battery", text]
    assert [(record.levelname, record.message) for record in caplog.records] == [
        ("WARNING", "vehicle: Low battery"),
        ("CRITICAL", f"vehicle: {text}"),
    ]


@pytest.mark.parametrize("autopilot", [3, 12])
def test_whole_numbers_in_parameters_as_each_autopilot_packs_them(autopilot: int) -> None:
    report = VehicleReport()
    report.hear(heartbeat(autopilot=autopilot), 0)
    packed = 2.0 if autopilot == 3 else np.array([2], dtype="<i4").view("<f4")[0]
    report.hear(
        message("PARAM_VALUE", param_id=b"FS_ACTION", param_value=packed, param_type=6, param_count=1, param_index=0), 0
    )
    assert report.parameters == {"FS_ACTION": 2.0}


def test_wheels_and_heading_make_odometry_in_our_axes() -> None:
    report = VehicleReport()
    # 1 m/s along a quarter circle to the right (clockwise: MAVLink's yaw grows), radius 1 m.
    for k in range(101):
        angle = math.pi / 2 * k / 100
        ms = round(1000 * angle)
        report.hear(attitude(ms, angle, 1.0), ms * MS)
        report.hear(wheels(ms, angle - 0.01, angle + 0.01), ms * MS)
    found = report.take()
    assert report.take() == []
    last = found[-1]
    assert isinstance(last, Odometry)
    np.testing.assert_allclose(last.pose, [1.0, -1.0, -math.pi / 2], atol=1e-3)
    np.testing.assert_allclose(last.twist, [1.0, 0.0, -1.0], atol=0.05)


def test_wheels_without_heading_and_wheels_counted_anew_say_nothing() -> None:
    report = VehicleReport()
    report.hear(wheels(0, 1.0), 0)
    report.hear(attitude(10, 0.0), 10 * MS)
    for ms, metres in ((20, 5.0), (40, 5.01), (60, 0.0), (80, 0.01)):
        report.hear(attitude(ms, 0.0), ms * MS)
        report.hear(wheels(ms, metres), ms * MS)
    assert [odometry.pose[0] for odometry in report.take()] == [pytest.approx(0.01), pytest.approx(0.02)]


def test_imu_of_a_car_that_stands_feels_gravity_upwards_and_a_left_turn_is_positive() -> None:
    report = VehicleReport()
    zeros = dict.fromkeys(("xmag", "ymag", "zmag"), 0)
    felt = message("SCALED_IMU", time_boot_ms=5, xacc=100, yacc=50, zacc=-1000, xgyro=0, ygyro=0, zgyro=-700, **zeros)
    report.hear(felt, 9 * MS)
    (imu,) = report.take()
    assert isinstance(imu, Imu)
    np.testing.assert_allclose(imu.acceleration_mps2, [0.980665, -0.4903325, 9.80665])
    np.testing.assert_allclose(imu.angular_velocity_radps, [0.0, 0.0, 0.7])


def test_stamps_are_those_of_the_shortest_delay() -> None:
    report, delays_ms = VehicleReport(), [8, 3, 20, 5, 60, 3]
    report.hear(attitude(0, 0.0), 0)
    for k, delay in enumerate(delays_ms):
        report.hear(attitude(50 * k, 0.0), 50 * k * MS)
        report.hear(wheels(50 * k, 0.1 * k), (50 * k + delay) * MS)
    stamps = [odometry.stamp_ns / MS - 50 * (k + 1) for k, odometry in enumerate(report.take())]
    assert all(3 <= late < 3.3 for late in stamps)
    report.hear(attitude(0, 0.0), 900 * MS)  # the vehicle began anew
    report.hear(wheels(0, 0.0), 900 * MS)
    report.hear(wheels(50, 0.1), 951 * MS)
    assert report.take()[-1].stamp_ns == pytest.approx(950 * MS, abs=MS)


def test_raw_imu_counts_from_ardupilot_alone_and_until_the_scaled_one_comes() -> None:
    values = dict.fromkeys(("xacc", "yacc", "xgyro", "ygyro", "zgyro", "xmag", "ymag", "zmag"), 0)
    raw = message("RAW_IMU", time_usec=5000, zacc=-1000, **values)
    scaled = message("SCALED_IMU", time_boot_ms=6, zacc=-1000, **values)
    for autopilot, expected in ((12, 1), (3, 2)):
        report = VehicleReport()
        report.hear(heartbeat(autopilot=autopilot), 0)
        for k, imu in enumerate((raw, scaled, raw)):
            report.hear(imu, k)
        found = report.take()
        assert len(found) == expected
        assert all(abs(imu.acceleration_mps2[2] - 9.80665) < 1e-9 for imu in found if isinstance(imu, Imu))
