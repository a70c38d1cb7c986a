"""Which topics of a recording hold depth images, and which of them is read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from drivers.depth_codec import (
    CAMERA_INFO_TYPE,
    IMAGE_TYPE,
    IMAGE_TYPES,
    NUMBER_TYPE,
    UNIT_TYPES,
    CameraInfo,
    beside,
    decode_camera,
    depth_encoding,
    find_camera,
)
from drivers.errors import RecordingError
from drivers.recording_storage import Storage, StoredMessage, StoredTopic


@dataclass(frozen=True, slots=True)
class DepthTopics:
    """image: the topic that is read, None where there is none. readable: all whose images can be read.

    companions: topics that say more about `image`. first: the first message of each companion, for images before it.
    """

    image: str | None
    readable: frozenset[str]
    companions: frozenset[str]
    first: tuple[StoredMessage, ...]


NO_DEPTH = DepthTopics(None, frozenset(), frozenset(), ())


def find_depth(storages: Sequence[Storage]) -> DepthTopics:
    """Look at the first message of each topic that may hold depth images or belong to them.

    An image topic is readable if it holds depth and there are intrinsics for it. Taken is, in this order: one that is
    called depth, one that is not aligned to another camera's view, counts rather than metres, uncompressed, the most
    messages.
    """
    topics = [topic for storage in storages for topic in storage.topics if topic.count]
    images = {topic.name for topic in topics if topic.type_name in IMAGE_TYPES}
    infos = {topic.name for topic in topics if topic.type_name == CAMERA_INFO_TYPE}
    if not images or not infos:
        return NO_DEPTH
    beside_types = (*UNIT_TYPES, NUMBER_TYPE)
    companions = infos | {
        topic.name
        for topic in topics
        if topic.type_name in beside_types
        and any(topic.name in (beside(image, "depth_units"), beside(image, "frame_number")) for image in images)
    }
    first = _first_messages(storages, images | companions)
    cameras = _cameras(stored for stored in first.values() if stored.type_name == CAMERA_INFO_TYPE)
    readable = {}
    for topic in topics:
        stored = first.get(topic.name)
        if topic.name in images and stored and stored.type_name == topic.type_name:
            kind = depth_encoding(stored)
            if kind is not None and find_camera(cameras, topic.name, kind[1]) is not None:
                readable[topic.name] = _preference(topic, kind[0])
    if not readable:
        return NO_DEPTH
    image = max(readable, key=lambda name: readable[name])
    own = _of_image(first[image], cameras) | {beside(image, "depth_units"), beside(image, "frame_number")}
    return DepthTopics(
        image=image,
        readable=frozenset(readable),
        companions=frozenset(companions & own),
        first=tuple(first[name] for name in sorted(companions & own)),
    )


def _of_image(image: StoredMessage, cameras: Mapping[str, CameraInfo]) -> set[str]:
    """Return the camera_info topics that an image may take its intrinsics from."""
    kind = depth_encoding(image)
    frame_id = "" if kind is None else kind[1]
    return {name for name, info in cameras.items() if find_camera({name: info}, image.topic, frame_id) is not None}


def _first_messages(storages: Sequence[Storage], topics: set[str]) -> dict[str, StoredMessage]:
    first: dict[str, StoredMessage] = {}
    for storage in storages:
        missing = {topic.name for topic in storage.topics if topic.count} & topics - set(first)
        if not missing:
            continue
        for stored in storage.messages(missing):
            first.setdefault(stored.topic, stored)
            missing.discard(stored.topic)
            if not missing:
                break
    return first


def _cameras(messages: Iterable[StoredMessage]) -> dict[str, CameraInfo]:
    cameras = {}
    for stored in messages:
        try:
            cameras[stored.topic] = decode_camera(stored)
        except RecordingError:
            continue  # a camera that was never calibrated, beside others
    return cameras


def _preference(topic: StoredTopic, encoding: str) -> tuple[bool, bool, bool, bool, int]:
    name = topic.name.lower()
    return ("depth" in name, "aligned" not in name, encoding != "32FC1", topic.type_name == IMAGE_TYPE, topic.count)
