from __future__ import annotations

import struct
from typing import Any

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.stores import ros1_noetic as ros1

from drivers.ros1_translation import Ros1Translation

THING = "my_msgs/msg/Thing"
DEFINITION = "uint32 fps\nstring encoding\n"


def text(value):
    return struct.pack("<I", len(value)) + value


def test_the_sequence_number_of_a_header_is_gone_and_the_rest_is_there():
    stamp = ros1.builtin_interfaces__msg__Time(5, 7)
    body = ros1.std_msgs__msg__Header(99, stamp, "camera")
    raw = bytes(get_typestore(Stores.ROS1_NOETIC).serialize_ros1(body, "std_msgs/msg/Header"))

    data = Ros1Translation({}).to_cdr(raw, "std_msgs/msg/Header")

    back: Any = get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr(data, "std_msgs/msg/Header")
    assert (back.stamp.sec, back.stamp.nanosec, back.frame_id) == (5, 7, "camera")


def test_a_type_that_only_the_bag_knows_is_translated_by_its_definition():
    translation = Ros1Translation({THING: DEFINITION})
    data = translation.to_cdr(struct.pack("<I", 30) + text(b"mono16"), THING)

    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(translation.schema_text(THING), THING))
    back: Any = store.deserialize_cdr(data, THING)
    assert (back.fps, back.encoding) == (30, "mono16")


def test_what_cannot_be_translated_is_refused():
    with pytest.raises(ValueError, match="its definition is not known"):
        Ros1Translation({THING: "((( is no definition"}).to_cdr(b"", THING)
    with pytest.raises(ValueError, match="0 bytes are not a my_msgs/msg/Thing"):
        Ros1Translation({THING: "Missing field\n"}).to_cdr(b"", THING)
    with pytest.raises(ValueError, match="3 bytes are not a std_msgs/msg/Header"):
        Ros1Translation({}).to_cdr(b"abc", "std_msgs/msg/Header")
