from __future__ import annotations

from typing import Any

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.stores import ros2_humble as ros

from drivers.errors import RecordingError
from drivers.ros_store import from_cdr, header, header_stamp_ns, is_known, schema_text, to_cdr, type_hash

TYPES = ("std_msgs/msg/Float64", "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo", "nav_msgs/msg/OccupancyGrid")


@pytest.mark.parametrize("type_name", TYPES)
def test_the_schema_text_defines_the_type_and_all_it_depends_on(type_name):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema_text(type_name), type_name))
    assert store.hash_rihs01(type_name) == type_hash(type_name)


@pytest.mark.parametrize("stamp_ns", [0, 1, 999_999_999, 10**9, 1_700_000_000_123_456_789, -1])
def test_stamps_keep_every_nanosecond(stamp_ns):
    stamped = header(stamp_ns, "laser")
    assert header_stamp_ns(stamped) == stamp_ns
    assert 0 <= stamped.stamp.nanosec < 10**9


def test_a_message_survives_cdr():
    back: Any = from_cdr(to_cdr(ros.std_msgs__msg__Float64(0.1), "std_msgs/msg/Float64"), "std_msgs/msg/Float64")
    assert back.data == 0.1


def test_types_of_other_packages_are_not_known():
    assert is_known("sensor_msgs/msg/Imu")
    assert not is_known("my_msgs/msg/Thing")


def test_what_no_message_can_hold_is_refused():
    with pytest.raises(RecordingError, match="no std_msgs/msg/Header can be made of this"):
        to_cdr(header(2**40 * 10**9, "laser"), "std_msgs/msg/Header")
