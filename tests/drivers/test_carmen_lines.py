from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.carmen_lines import (
    NO_RETURN_M,
    StatedLaser,
    beam_angles,
    count_readings,
    new_histogram,
    no_return_limit,
    parse_laser,
    parse_odometry,
    parse_parameters,
    parse_stamp_ns,
    stated_angles,
)


def new_fields(ranges, *, header=(0, -1.5, 3.0, 0.5, 80.0, 0.01, 0), remissions=(), poses=True, remission_count=True):
    numbers = [*header, len(ranges), *ranges]
    if remission_count:
        numbers += [len(remissions), *remissions]
    if poses:
        numbers += [1.0, 2.0, 0.5, 1.1, 2.0, 0.4, 0.3, -0.2, 0.5, 0.4, 1e6]
    return [str(number).encode() for number in numbers] + [b"7.25", b"host", b"0.1"]


@pytest.mark.parametrize(
    ("count", "first_deg", "last_deg", "step_deg"),
    [
        (180, -90, 89, 1.0),
        (181, -90, 90, 1.0),
        (360, -90, 89.5, 0.5),
        (361, -90, 90, 0.5),
        (101, -50, 50, 1.0),
        (201, -50, 50, 0.5),
        (401, -50, 50, 0.25),
        (90, -90, 88, 2.0),
        (91, -90, 90, 2.0),
    ],
)
def test_number_of_beams_tells_the_mode_of_the_laser(count, first_deg, last_deg, step_deg):
    angles = np.degrees(beam_angles(count))
    assert (angles[0], angles[-1]) == pytest.approx((first_deg, last_deg))
    assert np.diff(angles) == pytest.approx(np.full(count - 1, step_deg))


@pytest.mark.parametrize(
    ("parameters", "half_deg"),
    [
        ({"laser_front_laser_fov": "4.18879"}, 120.0),
        ({"laser_front_laser_fov": "240"}, 120.0),
        ({"laser_front_laser_fov": "240", "laser_front_laser_resolution": "0.3525"}, 120.0),
        ({"laser_front_laser_resolution": "0.25"}, 85.0),
    ],
)
def test_parameters_tell_the_beams_of_other_lasers(parameters, half_deg):
    angles = np.degrees(beam_angles(681, parse_parameters(parameters)))
    assert (angles[0], angles[-1]) == pytest.approx((-half_deg, half_deg), abs=0.4)
    assert np.ptp(np.diff(angles)) < 1e-9


def test_parameters_of_the_wrong_mode_do_not_bend_the_usual_numbers_of_beams():
    stated = StatedLaser(field_of_view_rad=np.radians(100.0), resolution_rad=np.radians(0.25))
    assert beam_angles(361, stated).tolist() == beam_angles(361).tolist()


@given(st.integers(2, 2000), st.floats(0.1, 6.2), st.floats(-3.2, 0.0), st.booleans())
def test_stated_resolution_is_the_step_whether_or_not_the_last_beam_is_there(count, field, start, last_is_there):
    resolution = field / (count - 1 if last_is_there else count)
    angles = stated_angles(count, start, field, resolution)
    assert angles[0] == start
    assert np.diff(angles) == pytest.approx(np.full(count - 1, resolution))


@pytest.mark.parametrize("resolution", [0.0, -1.0, 180.0, 1.0, float("nan")])
def test_ends_are_believed_where_the_resolution_does_not_lead_there(resolution):
    angles = stated_angles(361, -1.5, 3.0, resolution)
    assert (angles[0], angles[-1]) == pytest.approx((-1.5, 1.5))


def test_every_part_of_a_new_line_is_read():
    line = parse_laser("ROBOTLASER1", new_fields((1.0, 2.0, 3.0), remissions=(7, 8, 9)))
    assert line.stamp_ns == 7_250_000_000
    assert line.ranges_m.tolist() == [1.0, 2.0, 3.0]
    assert line.intensities.tolist() == [7.0, 8.0, 9.0]
    assert line.beams == (-1.5, 3.0, 0.5)
    assert line.range_max_m == 80.0
    assert line.robot_pose.tolist() == [1.1, 2.0, 0.4]
    assert line.odometry().twist.tolist() == [0.3, 0.0, -0.2]
    cos, sin = np.cos(0.4), np.sin(0.4)
    assert line.laser_on_robot() == pytest.approx([-0.1 * cos, 0.1 * sin, 0.1])


@pytest.mark.parametrize("remission_count", [True, False])
@pytest.mark.parametrize("poses", [True, False])
def test_new_lines_are_read_with_and_without_poses_and_remissions(poses, remission_count):
    name = "ROBOTLASER1" if poses else "RAWLASER1"
    line = parse_laser(name, new_fields((1.0, 2.0), poses=poses, remission_count=remission_count))
    assert line.ranges_m.tolist() == [1.0, 2.0]
    assert (line.odometry() is None) == (not poses)
    assert (line.laser_on_robot() is None) == (not poses)


def test_angles_in_degrees_are_told_by_their_size():
    line = parse_laser("ROBOTLASER1", new_fields([1.0] * 181, header=(0, -90, 180, 1, 80, 0.01, 0)))
    assert line.scan(NO_RETURN_M, StatedLaser()).angles_rad == pytest.approx(np.radians(np.arange(-90, 91)))


def test_header_of_zeros_leaves_the_beams_to_their_number():
    line = parse_laser("ROBOTLASER1", new_fields([1.0] * 180, header=(0, 0, 0, 0, 0, 0, 0)))
    scan = line.scan(NO_RETURN_M, StatedLaser())
    assert scan.angles_rad.tolist() == beam_angles(180).tolist()
    assert scan.range_max_m == NO_RETURN_M


@given(st.integers(0, 30), st.sampled_from(["ROBOTLASER1", "RAWLASER1", "FLASER"]), st.data())
def test_line_that_lacks_or_repeats_a_field_is_refused(place, name, data):
    ranges = (1.5, 2.5, 3.5, 4.5)
    fields = (
        [b"4", b"1.5", b"2.5", b"3.5", b"4.5", *[b"0.5"] * 6, b"7.25", b"host", b"0.1"]
        if name == "FLASER"
        else new_fields(ranges, poses=name == "ROBOTLASER1", remissions=(70, 80, 90, 60))
    )
    place = min(place, len(fields) - 1)
    changed = (
        [*fields[:place], *fields[place + 1 :]] if data.draw(st.booleans()) else [*fields[: place + 1], *fields[place:]]
    )
    parse_laser(name, fields)
    with pytest.raises(ValueError, match="fields|finite|invalid|convert"):
        parse_laser(name, changed)


@pytest.mark.parametrize("text", [b"", b"1 2 3", b"1 2 nan 0 0 0 7.25 h 1", b"a b c 0 0 0 7.25 h 1"])
def test_broken_odometry_is_refused(text):
    with pytest.raises(ValueError, match="fields|finite|invalid|convert"):
        parse_odometry(text.split())


@pytest.mark.parametrize("top", [81.91, 51.15, 30.0, 8.19])
def test_pile_at_the_end_of_the_range_is_no_measurement(top):
    random = np.random.default_rng(5)
    histogram = new_histogram()
    count_readings(histogram, random.uniform(0.3, 0.6 * top, 5000))
    count_readings(histogram, np.full(300, top))
    limit = no_return_limit(histogram)
    assert 0.6 * top < limit <= top


def test_few_wrong_readings_beyond_the_pile_do_not_hide_it():
    histogram = new_histogram()
    count_readings(histogram, np.random.default_rng(5).uniform(0.3, 20.0, 5000))
    count_readings(histogram, np.full(300, 51.15))
    count_readings(histogram, np.array([60.1, 70.3, 250.0, np.inf, np.nan]))
    assert 50.0 < no_return_limit(histogram) <= 51.15


def test_readings_that_thin_out_are_all_measurements():
    random = np.random.default_rng(6)
    histogram = new_histogram()
    count_readings(histogram, np.minimum(random.exponential(4.0, 20000), 40.0 * random.random(20000)))
    assert no_return_limit(histogram) == NO_RETURN_M
    assert no_return_limit(new_histogram()) == NO_RETURN_M


def test_stamp_is_exact():
    assert parse_stamp_ns(b"976052857.337530") == 976_052_857_337_530_000
    assert parse_stamp_ns(b"12") == 12_000_000_000
    assert parse_stamp_ns(b"9.5e-05") == 95_000
    assert parse_stamp_ns(b"1.01893e+09") == 1_018_930_000_000_000_000


@pytest.mark.parametrize("text", [b"", b"host", b"1e", b"one", b"nan", b"1.5.2", b"1e999999999"])
def test_what_is_no_stamp_is_refused(text):
    with pytest.raises(ValueError, match="invalid"):
        parse_stamp_ns(text)
