"""ROS 2 messages as objects <-> CDR bytes, and what a recording says about their types, by the rosbags type store."""

from __future__ import annotations

import struct
from functools import cache

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores import ros2_humble as ros

from drivers.errors import RecordingError

_STORE = get_typestore(Stores.ROS2_HUMBLE)
_NS = 1_000_000_000


def is_known(type_name: str) -> bool:
    """Tell whether this is a type of a standard ROS 2 installation."""
    return type_name in _STORE.fielddefs


@cache
def schema_text(type_name: str) -> str:
    """Return the ros2msg definition of a type followed by all that it depends on, as rosbag2 stores it."""
    return _STORE.generate_msgdef(type_name, ros_version=2)[0]


@cache
def type_hash(type_name: str) -> str:
    """Return the RIHS01 hash by which ROS 2 compares types (REP-2011)."""
    return _STORE.hash_rihs01(type_name)


def to_cdr(body: object, type_name: str) -> bytes:
    """Return a message object as CDR; raises RecordingError where a field does not fit its type."""
    try:
        return bytes(_STORE.serialize_cdr(body, type_name))
    except (SerdeError, struct.error, ValueError, TypeError, OverflowError) as error:
        raise RecordingError(f"no {type_name} can be made of this: {error}") from error


def from_cdr(data: bytes, type_name: str) -> object:
    """Return the message object in CDR bytes; raises SerdeError, ValueError or TypeError where they hold none."""
    return _STORE.deserialize_cdr(data, type_name)


def header(stamp_ns: int, frame_id: str) -> ros.std_msgs__msg__Header:
    """Return a header with this stamp."""
    return ros.std_msgs__msg__Header(ros.builtin_interfaces__msg__Time(*divmod(stamp_ns, _NS)), frame_id)


def header_stamp_ns(stamped: ros.std_msgs__msg__Header) -> int:
    """Return the stamp of a header in ns; 0 where the writer did not fill it in."""
    return stamped.stamp.sec * _NS + stamped.stamp.nanosec
