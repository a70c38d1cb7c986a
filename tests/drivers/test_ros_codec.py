from __future__ import annotations

import dataclasses
import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from drivers.errors import RecordingError
from drivers.messages import (
    GridSnapshot,
    Imu,
    LaserScan,
    LidarStream,
    Odometry,
    PlannedPath,
    RawChunk,
    Transform,
    VelocityCommand,
)
from drivers.ros_codec import (
    GRID_TYPE,
    IMU_TYPE,
    ODOMETRY_TYPE,
    PATH_TYPE,
    RAW_TYPE,
    SCAN_TYPE,
    STREAM_TYPE,
    TRANSFORM_TYPE,
    TWIST_TYPE,
    decode,
    default_topic,
    encode,
    encode_transforms,
    is_decodable,
    is_latched,
    ros_type,
)
from drivers.ros_store import schema_text, type_hash

STAMP_NS = 1_700_000_000_123_456_789
STREAM = LidarStream(STAMP_NS, "A2M8", "1.29", 7, "AB12", 115200, "Boost", 0x84, 126.0, 12.0)
ALL_TYPES = (
    RAW_TYPE,
    STREAM_TYPE,
    SCAN_TYPE,
    ODOMETRY_TYPE,
    TRANSFORM_TYPE,
    GRID_TYPE,
    PATH_TYPE,
    IMU_TYPE,
    TWIST_TYPE,
)


def same(left, right):
    """Compare two messages field by field; arrays make == useless."""
    return type(left) is type(right) and all(
        np.array_equal(getattr(left, field.name), getattr(right, field.name)) for field in dataclasses.fields(left)
    )


def round_trip(message):
    topic = default_topic(message)
    (back,) = decode(ros_type(message), encode(message), topic, message.stamp_ns)
    return back


@pytest.mark.parametrize(
    "message",
    [
        RawChunk(STAMP_NS, bytes(range(256))),
        RawChunk(STAMP_NS, b""),
        STREAM,
        Transform(STAMP_NS, "base_link", "laser", np.array([0.1, 0, 0.2]), np.array([0, 0, 1.0, 0]), static=True),
        Transform(STAMP_NS, "map", "odom", np.array([1.0, -2, 3]), np.array([0, 0, 0, 1.0])),
        GridSnapshot(STAMP_NS, 0.0625, np.array([-1.0, 2.0, 0.0]), np.array([[-1, 0, 100], [50, 1, 2]])),
        PlannedPath(STAMP_NS, np.array([[0.5, -1.0, 0.0], [3.25, 2.0, 0.0]]), "global"),
        PlannedPath(STAMP_NS, np.zeros((0, 3))),
        Imu(STAMP_NS, np.array([0.1, -0.2, 1.5]), np.array([0.3, -0.1, 9.81]), "imu_link"),
        VelocityCommand(STAMP_NS, -0.25, 0.75),
    ],
    ids=lambda message: type(message).__name__,
)
def test_a_message_survives_unchanged(message):
    assert same(round_trip(message), message)


@pytest.mark.parametrize("yaw", [0.0, 0.3, -3.1, math.pi / 2])
def test_odometry_survives_to_the_last_digits_of_its_yaw(yaw):
    odometry = Odometry(STAMP_NS, np.array([1.5, -2.5, yaw]), np.array([0.4, 0.0, -1.2]))

    back = round_trip(odometry)

    assert back.pose == pytest.approx(odometry.pose, abs=1e-14)
    assert back.twist.tolist() == odometry.twist.tolist()
    assert (back.stamp_ns, back.frame_id, back.child_frame_id) == (STAMP_NS, "odom", "base_link")


def test_a_path_is_a_nav_msgs_path_with_a_heading_at_each_pose():
    poses = np.column_stack([np.linspace(0, 3, 40), np.linspace(1, -1, 40), np.linspace(-3.1, 3.1, 40)])
    store = get_typestore(Stores.ROS2_HUMBLE)
    body: Any = store.deserialize_cdr(encode(PlannedPath(STAMP_NS, poses)), "nav_msgs/msg/Path")
    assert (body.header.frame_id, len(body.poses)) == ("map", 40)
    for stamped, (x, y, yaw) in zip(body.poses, poses.tolist(), strict=True):
        assert stamped.header.stamp.sec * 10**9 + stamped.header.stamp.nanosec == STAMP_NS
        assert (stamped.pose.position.x, stamped.pose.position.y, stamped.pose.position.z) == (x, y, 0.0)
        assert 2 * math.atan2(stamped.pose.orientation.z, stamped.pose.orientation.w) == pytest.approx(yaw)
    assert round_trip(PlannedPath(STAMP_NS, poses)).poses == pytest.approx(poses, abs=1e-14)


def test_an_imu_says_that_it_knows_no_orientation_and_a_command_turns_about_z():
    store = get_typestore(Stores.ROS2_HUMBLE)
    imu: Any = store.deserialize_cdr(encode(Imu(STAMP_NS, np.arange(3.0), np.arange(3.0))), IMU_TYPE)
    assert imu.orientation_covariance[0] == -1.0
    assert (imu.angular_velocity.y, imu.linear_acceleration.z) == (1.0, 2.0)
    twist: Any = store.deserialize_cdr(encode(VelocityCommand(STAMP_NS, 0.5, -0.25)), TWIST_TYPE)
    assert (twist.linear.x, twist.linear.y, twist.angular.x, twist.angular.z) == (0.5, 0.0, 0.0, -0.25)


def test_odometry_is_projected_on_the_plane():
    store = get_typestore(Stores.ROS2_HUMBLE)
    message: Any = store.deserialize_cdr(encode(Odometry(0, np.zeros(3), np.zeros(3))), ODOMETRY_TYPE)
    roll, yaw = 0.4, 1.1
    q = message.pose.pose.orientation
    q.x, q.y = math.cos(yaw / 2) * math.sin(roll / 2), math.sin(yaw / 2) * math.sin(roll / 2)
    q.z, q.w = math.sin(yaw / 2) * math.cos(roll / 2), math.cos(yaw / 2) * math.cos(roll / 2)
    message.pose.pose.position.z = 9.0

    (back,) = decode(ODOMETRY_TYPE, bytes(store.serialize_cdr(message, ODOMETRY_TYPE)), "/odom", 0)

    assert back.pose == pytest.approx([0, 0, yaw])


def test_several_transforms_travel_in_one_message():
    sent = [Transform(STAMP_NS + i, "map", f"t{i}", np.full(3, i), np.array([0, 0, 0, 1.0])) for i in range(3)]

    received = decode(TRANSFORM_TYPE, encode_transforms(sent), "/tf", 0)

    assert all(same(a, b) for a, b in zip(sent, received, strict=True))


def test_a_scan_is_sent_clockwise_with_a_negative_step_and_rising_times():
    angles = -np.linspace(0, 2 * math.pi, 400, endpoint=False)
    ranges = np.full(400, 3.0)
    ranges[100] = 0
    scan = LaserScan(STAMP_NS, angles, ranges, np.linspace(0, 0.1, 400, endpoint=False), 0.15, 12.0, "lidar_link")

    message: Any = get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr(encode(scan), SCAN_TYPE)

    assert message.header.frame_id == "lidar_link"
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == pytest.approx(STAMP_NS, abs=1000)
    assert message.angle_increment == pytest.approx(-2 * math.pi / 400)
    assert message.angle_max == pytest.approx(message.angle_min + 399 * message.angle_increment)
    assert message.time_increment == pytest.approx(0.1 / 400)
    assert message.scan_time == pytest.approx(0.1)
    assert message.ranges.dtype == np.float32
    assert np.isposinf(message.ranges[100])
    assert (np.delete(message.ranges, 100) == 3.0).all()
    assert message.intensities.size == 0


def test_a_scan_read_back_has_its_rays_in_place_and_time():
    angles = -np.linspace(0, 2 * math.pi, 400, endpoint=False)
    ranges = np.linspace(1, 5, 400)
    scan = LaserScan(STAMP_NS, angles, ranges, np.linspace(0, 0.1, 400, endpoint=False), 0.15, 12.0, "laser", ranges)

    back = round_trip(scan)

    assert back.angles_rad == pytest.approx(scan.angles_rad, abs=1e-5)
    assert back.ranges_m == pytest.approx(scan.ranges_m, rel=1e-6)
    assert back.offsets_s == pytest.approx(scan.offsets_s, abs=1e-8)
    assert back.intensities == pytest.approx(ranges, rel=1e-6)
    assert (back.range_min_m, back.range_max_m) == pytest.approx((0.15, 12.0))


def test_a_hand_made_scan_is_read_field_by_field():
    header = struct.pack("<iI", 12, 345) + struct.pack("<I", 6) + b"laser\0" + b"\0\0"
    numbers = struct.pack("<7f", -1.0, 1.0, 1.0, 0.25, 0.75, 0.1, 10.0)
    arrays = struct.pack("<I3f", 3, math.inf, 2.0, math.nan) + struct.pack("<I", 0)

    (scan,) = decode(SCAN_TYPE, b"\0\1\0\0" + header + numbers + arrays, "/scan", 0)

    assert scan.stamp_ns == 12_000_000_345
    assert scan.frame_id == "laser"
    assert scan.angles_rad.tolist() == [-1.0, 0.0, 1.0]
    assert scan.offsets_s.tolist() == [0.0, 0.25, 0.5]
    assert scan.valid.tolist() == [False, True, False]
    assert scan.intensities is None


@pytest.mark.parametrize(
    ("type_name", "topic", "known"),
    [
        (RAW_TYPE, "/lidar/raw", True),
        (RAW_TYPE, "/front/lidar/raw", True),
        (RAW_TYPE, "/image", False),
        (STREAM_TYPE, "/lidar/stream", True),
        (STREAM_TYPE, "/robot_description", False),
        (SCAN_TYPE, "/any", True),
        (IMU_TYPE, "/any", True),
        ("sensor_msgs/msg/NavSatFix", "/fix", False),
        ("", "/scan", False),
    ],
)
def test_general_types_are_known_by_their_topic_only(type_name, topic, known):
    assert is_decodable(type_name, topic) is known


def test_a_lidar_stream_of_a_later_version_is_read_and_one_of_another_kind_refused():
    store = get_typestore(Stores.ROS2_HUMBLE)
    later = encode(STREAM).replace(b'"model"', b'"extra": 1, "model"')
    text = store.types[STREAM_TYPE]

    (back,) = decode(
        STREAM_TYPE, bytes(store.serialize_cdr(text(later[8:-1].decode()), STREAM_TYPE)), "/lidar/stream", 0
    )

    assert back == STREAM
    for content in ("{}", "[1]", "no JSON"):
        data = bytes(store.serialize_cdr(text(content), STREAM_TYPE))
        with pytest.raises(RecordingError, match="/lidar/stream"):
            decode(STREAM_TYPE, data, "/lidar/stream", 0)


@pytest.mark.parametrize("type_name", ALL_TYPES)
@given(data=st.binary(max_size=200), little_endian=st.booleans())
def test_bytes_that_are_no_message_are_refused_and_nothing_else(type_name, data, little_endian):
    try:
        decode(type_name, bytes([0, little_endian, 0, 0]) + data, "/lidar/raw", 1)
    except RecordingError as error:
        assert type_name in str(error)  # noqa: PT017 - random bytes may also be a message


def test_a_cut_message_names_its_topic_size_and_type():
    data = encode(Odometry(0, np.zeros(3), np.zeros(3)))[:50]

    with pytest.raises(RecordingError, match="/odom: 50 bytes are not a nav_msgs/msg/Odometry"):
        decode(ODOMETRY_TYPE, data, "/odom", 0)


@pytest.mark.parametrize("type_name", ALL_TYPES)
def test_the_schema_text_defines_the_type_and_all_it_depends_on(type_name):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema_text(type_name), type_name))

    assert store.hash_rihs01(type_name) == type_hash(type_name)
    assert schema_text(type_name).count("=" * 80 + "\nMSG: ") == schema_text(type_name).count("MSG: ")


def test_static_transforms_streams_and_maps_are_latched():
    static = Transform(0, "a", "b", np.zeros(3), np.array([0, 0, 0, 1.0]), static=True)

    assert default_topic(static) == "/tf_static"
    assert is_latched(static)
    assert is_latched(STREAM)
    assert not is_latched(dataclasses.replace(static, static=False))
    assert not is_latched(RawChunk(0, b""))


def edited(message, type_name, edit) -> bytes:
    """A message of ours as CDR bytes, changed as another program might have written it."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    body: Any = store.deserialize_cdr(encode(message), type_name)
    edit(body)
    return bytes(store.serialize_cdr(body, type_name))


def a_scan(stamp_ns=STAMP_NS):
    angles = -np.linspace(0, 2 * math.pi, 360, endpoint=False)
    return LaserScan(stamp_ns, angles, np.full(360, 3.0), np.linspace(0, 0.1, 360, endpoint=False), 0.15, 12.0)


def test_stamp_that_was_never_filled_in_is_the_log_time():
    (scan,) = decode(SCAN_TYPE, encode(a_scan(0)), "/scan", 77)
    (odometry,) = decode(ODOMETRY_TYPE, encode(Odometry(0, np.zeros(3), np.zeros(3))), "/odom", 78)
    assert isinstance(scan, LaserScan)
    assert isinstance(odometry, Odometry)
    assert odometry.stamp_ns == 78
    assert abs(scan.stamp_ns - 77) < 10**9


@pytest.mark.parametrize("nonsense", [0.0, math.nan, -1.0])
def test_maximum_range_that_was_never_filled_in_is_no_limit(nonsense):
    data = edited(a_scan(), SCAN_TYPE, lambda body: setattr(body, "range_max", nonsense))
    (scan,) = decode(SCAN_TYPE, data, "/scan", 0)
    assert isinstance(scan, LaserScan)
    assert scan.valid.all()


def test_rays_that_all_point_one_way_are_no_scan():
    data = edited(a_scan(), SCAN_TYPE, lambda body: setattr(body, "angle_increment", 0.0))
    with pytest.raises(RecordingError, match="angle_increment 0"):
        decode(SCAN_TYPE, data, "/scan", 0)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_odometry_that_is_not_finite_is_refused(value):
    data = edited(
        Odometry(STAMP_NS, np.zeros(3), np.zeros(3)),
        ODOMETRY_TYPE,
        lambda body: setattr(body.pose.pose.position, "x", value),
    )
    with pytest.raises(RecordingError, match="not finite"):
        decode(ODOMETRY_TYPE, data, "/odom", 0)


def test_a_path_that_is_not_finite_is_refused():
    data = edited(
        PlannedPath(STAMP_NS, np.zeros((2, 3))),
        PATH_TYPE,
        lambda body: setattr(body.poses[1].pose.position, "y", math.nan),
    )
    with pytest.raises(RecordingError, match="not finite"):
        decode(PATH_TYPE, data, "/plan", 0)
    with pytest.raises(ValueError, match="expected"):
        PlannedPath(STAMP_NS, np.zeros((2, 2)))


@pytest.mark.parametrize(
    ("translation", "quaternion"),
    [([math.nan, 0, 0], [0, 0, 0, 1]), ([0, 0, 0], [0, 0, 0, 0]), ([0, 0, 0], [0, 0, math.inf, 1])],
)
def test_what_is_no_transform_is_refused(translation, quaternion):
    bad = Transform(STAMP_NS, "a", "b", np.array(translation, dtype=float), np.array(quaternion, dtype=float))
    with pytest.raises(RecordingError, match="no transform"):
        decode(TRANSFORM_TYPE, encode_transforms([bad]), "/tf", 0)
