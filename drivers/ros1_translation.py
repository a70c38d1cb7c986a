"""ROS 1 messages to the CDR bytes of the ROS 2 messages of the same name, by the definitions in their bag."""

from __future__ import annotations

import struct
from collections.abc import Mapping

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore


class Ros1Translation:
    """Translates messages of the types of one bag.

    definitions: the text of each type, by its name in ROS 2. Standard types are taken as ROS 2 has them; of the others
    those whose definition does not parse cannot be translated.
    """

    def __init__(self, definitions: Mapping[str, str]) -> None:
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        for name, text in definitions.items():
            if name in self._store.fielddefs:
                continue
            try:
                found = get_types_from_msg(text, name)
                self._store.register({kind: found[kind] for kind in found if kind not in self._store.fielddefs})
            except (TypesysError, ValueError, KeyError, TypeError, SyntaxError):
                continue

    def schema_text(self, type_name: str) -> str:
        """Return the ros2msg definition of a type that `to_cdr` has translated."""
        return self._store.generate_msgdef(type_name, ros_version=2)[0]

    def to_cdr(self, raw: bytes, type_name: str) -> bytes:
        """Return a message as CDR; raises ValueError where it is not of this type, or the type is not known."""
        if type_name not in self._store.fielddefs:
            raise ValueError(f"{type_name}: its definition is not known")
        try:
            return bytes(self._store.ros1_to_cdr(raw, type_name))
        except (SerdeError, struct.error, ValueError, LookupError, TypeError, AssertionError) as error:
            raise ValueError(f"{len(raw)} bytes are not a {type_name}: {error}") from error
