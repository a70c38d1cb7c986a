"""A live run: one thread reads, records and decodes the sensor, the caller's thread maps."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError
from drivers.messages import LaserScan, Message, Recordable, Transform
from drivers.newest_queue import NewestQueue
from drivers.rplidar_decoder import DecoderCounters
from drivers.scan_reader import turn_rate_hz
from mapping.slam import MappedScan
from tools.pipeline import LidarDecoding, MappingFlow

FloatArray = NDArray[np.float64]
Put = Callable[[Recordable], None]

_SPEED_TURNS = 10
QUEUE_SCANS = 200  # 20 s of a lidar at 10 turns a second
QUEUE_FRESH = 3  # where old scans are of no use: what a car that drives knows must be of now
QUEUE_IMAGES = 15  # half a second of a camera beside a lidar; alone it has 1: the latest one counts

log = logging.getLogger(__name__)


class LiveSource(Protocol):
    """A source that another thread can end."""

    def __iter__(self) -> Iterator[Message]: ...

    def request_stop(self) -> None:
        """End the iteration soon."""
        ...


@dataclass(frozen=True, slots=True)
class LiveOutcome:
    """How a live run ended: scans that mapping was too slow for, what the decoder saw, and the fault that ended it.

    dropped_images: depth images that mapping left out because newer ones came; camera_fault: a camera that was lost
    while the lidar went on. speed_hz: turns a second over the last whole turns of the lidar.
    """

    dropped_scans: int
    streams: list[DecoderCounters]
    fault: DriverError | None
    dropped_images: int = 0
    camera_fault: DriverError | None = None
    speed_hz: float | None = None


class SensorThread:
    """Reads a sensor to its end: every message goes to the recorder, scans and images into a bounded queue too."""

    def __init__(self, sensor: LiveSource, put: Put, *, queue_scans: int = QUEUE_SCANS, name: str = "lidar") -> None:
        self.fault: DriverError | None = None
        self._failure: Exception | None = None
        self.decoding = LidarDecoding()
        self._turns_ns: deque[int] = deque(maxlen=_SPEED_TURNS)
        self._sensor = sensor
        self._put = put
        self._scans: NewestQueue[Message] = NewestQueue(queue_scans)
        self._thread = threading.Thread(target=self._read, name=name, daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def stop(self) -> None:
        """Ask the sensor for no more and wait until its last bytes are decoded."""
        self._sensor.request_stop()
        self._thread.join()
        if self._failure is not None:
            raise self._failure

    @property
    def running(self) -> bool:
        """False once the sensor has ended or failed."""
        return self._thread.is_alive()

    @property
    def dropped_scans(self) -> int:
        """Scans or images that were not taken in time."""
        return self._scans.dropped

    def take(self, timeout_s: float) -> Message | None:
        """Return the oldest scan or image that waits, None where there is none within the time."""
        return self._scans.take(timeout_s)

    @property
    def speed_hz(self) -> float | None:
        """Turns a second over the last whole turns in a row; None before there are two."""
        return turn_rate_hz([*self._turns_ns])

    def _note_turn(self, scan: LaserScan) -> None:
        if scan.complete:
            self._turns_ns.append(scan.stamp_ns)
        else:
            self._turns_ns.clear()  # it lasted less than a turn, or nobody knows how long

    def _read(self) -> None:
        try:
            for message in self._sensor:
                self._put(message)
                for decoded in self.decoding.feed(message):
                    if isinstance(decoded, LaserScan):
                        self._put(decoded)
                        self._note_turn(decoded)
                    self._scans.put(decoded)
        except DriverError as error:
            self.fault = error
        except Exception as error:  # noqa: BLE001 - raised again by stop(), in the caller's thread
            self._failure = error


class LiveReading:
    """The threads of a session's sensors: the first one's scans are waited for, the camera's images taken along.

    Either may be missing, but not both. queue_scans: so many of the lidar wait at most.
    """

    def __init__(
        self, lidar: LiveSource | None, camera: LiveSource | None, put: Put, queue_scans: int = QUEUE_SCANS
    ) -> None:
        self._lidar = None if lidar is None else SensorThread(lidar, put, queue_scans=queue_scans)
        queue_images = 1 if lidar is None else QUEUE_IMAGES
        self._camera = None if camera is None else SensorThread(camera, put, queue_scans=queue_images, name="camera")
        first = self._lidar or self._camera
        assert first is not None
        self._first = first
        self._threads = [thread for thread in (self._lidar, self._camera) if thread is not None]
        self._told = False

    def start(self) -> None:
        """Begin to read."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Ask for no more and wait until the last message is there; raises what no driver should."""
        for thread in self._threads:
            thread.stop()

    @property
    def running(self) -> bool:
        """False once the first sensor has ended or failed; a camera beside a lidar may fail."""
        self._tell_lost_camera()
        return self._first.running

    def take(self, timeout_s: float) -> list[Message]:
        """Return what waits: a scan, for which time is given, and all images that came with it."""
        first = self._first.take(timeout_s)
        messages = [] if first is None else [first]
        if self._camera is not None and self._camera is not self._first:
            while (image := self._camera.take(0.0)) is not None:
                messages.append(image)
        return messages

    def outcome(self) -> LiveOutcome:
        """Return how it went, after stop()."""
        lidar, camera = self._lidar, self._camera
        self._tell_lost_camera()
        return LiveOutcome(
            dropped_scans=0 if lidar is None else lidar.dropped_scans,
            streams=[] if lidar is None else lidar.decoding.counters,
            fault=self._first.fault,
            dropped_images=0 if camera is None else camera.dropped_scans,
            camera_fault=None if camera is None or lidar is None else camera.fault,
            speed_hz=None if lidar is None else lidar.speed_hz,
        )

    def _tell_lost_camera(self) -> None:
        camera = self._camera
        if camera is not None and camera is not self._first and camera.fault is not None and not self._told:
            self._told = True
            log.warning("the images of the camera end before the run: %s", camera.fault)


def run_live(
    lidar: LiveSource | None,
    flow: MappingFlow,
    stop: threading.Event,
    *,
    put: Put,
    on_mapped: Callable[[MappedScan], None],
    release: Callable[[], None] = lambda: None,
    camera: LiveSource | None = None,
    queue_scans: int = QUEUE_SCANS,
) -> LiveOutcome:
    """Map until `stop` is set or the lidar fails, then release the sensors and map what was still on the way.

    Without a lidar the camera decides when it ends. queue_scans: so many scans wait to be mapped at most.
    """
    reading = LiveReading(lidar, camera, put, queue_scans)
    reading.start()
    while reading.running and not stop.is_set():
        _map_next(reading, flow, put, on_mapped, timeout_s=0.1)
    reading.stop()
    release()
    while _map_next(reading, flow, put, on_mapped, timeout_s=0.0):
        pass
    for mapped in flow.finish():
        on_mapped(mapped)
    return reading.outcome()


def record_live(
    lidar: LiveSource | None, stop: threading.Event, *, put: Put, camera: LiveSource | None = None
) -> LiveOutcome:
    """Record until `stop` is set or the lidar fails; without a lidar, the camera."""
    reading = LiveReading(lidar, camera, put)
    reading.start()
    while reading.running and not stop.is_set():
        reading.take(0.1)
    reading.stop()
    return replace(reading.outcome(), dropped_scans=0, dropped_images=0)


def _map_next(
    reading: LiveReading, flow: MappingFlow, put: Put, on_mapped: Callable[[MappedScan], None], *, timeout_s: float
) -> bool:
    """Map what waits; False where nothing came."""
    messages = reading.take(timeout_s)
    for message in messages:
        for mapped in flow.feed(message):
            for transform in pose_transforms(mapped):
                put(transform)
            on_mapped(mapped)
    return bool(messages)


def pose_transforms(mapped: MappedScan) -> tuple[Transform, Transform]:
    """Return map -> odom, which jumps where a loop closes, and odom -> base_link, which never does, for /tf."""
    return (
        _planar(mapped.stamp_ns, "map", "odom", mapped.T_map_odom),
        _planar(mapped.stamp_ns, "odom", "base_link", mapped.match.pose),
    )


def _planar(stamp_ns: int, parent: str, child: str, pose: FloatArray) -> Transform:
    x, y, yaw = pose
    quaternion = np.array([0.0, 0.0, np.sin(yaw / 2.0), np.cos(yaw / 2.0)])
    return Transform(stamp_ns, parent, child, np.array([x, y, 0.0]), quaternion)
