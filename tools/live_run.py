"""A live run: one thread reads, records and decodes the sensor, the caller's thread maps."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError
from drivers.messages import LaserScan, Message, Recordable, Transform
from drivers.rplidar_decoder import DecoderCounters
from mapping.slam import MappedScan
from tools.pipeline import LidarDecoding, MappingFlow

FloatArray = NDArray[np.float64]
Put = Callable[[Recordable], None]

QUEUE_SCANS = 200  # 20 s of a lidar at 10 turns a second


class LiveSource(Protocol):
    """A source that another thread can end."""

    def __iter__(self) -> Iterator[Message]: ...

    def request_stop(self) -> None:
        """End the iteration soon."""
        ...


@dataclass(frozen=True, slots=True)
class LiveOutcome:
    """How a live run ended: scans that mapping was too slow for, what the decoder saw, and the fault that ended it."""

    dropped_scans: int
    streams: list[DecoderCounters]
    fault: DriverError | None


class SensorThread:
    """Reads a lidar to its end: every message goes to the recorder as it came, its scans into a bounded queue."""

    def __init__(self, lidar: LiveSource, put: Put, *, queue_scans: int = QUEUE_SCANS) -> None:
        self.fault: DriverError | None = None
        self.dropped_scans = 0
        self._failure: Exception | None = None
        self.decoding = LidarDecoding()
        self._lidar = lidar
        self._put = put
        self._scans: queue.Queue[Message] = queue.Queue(queue_scans)
        self._thread = threading.Thread(target=self._read, name="lidar", daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def stop(self) -> None:
        """Ask the lidar for no more and wait until its last bytes are decoded."""
        self._lidar.request_stop()
        self._thread.join()
        if self._failure is not None:
            raise self._failure

    @property
    def running(self) -> bool:
        """False once the lidar has ended or failed."""
        return self._thread.is_alive()

    def take(self, timeout_s: float) -> Message | None:
        """Return the oldest scan that waits, None where there is none within the time."""
        try:
            return self._scans.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def _read(self) -> None:
        try:
            for message in self._lidar:
                self._put(message)
                for decoded in self.decoding.feed(message):
                    if isinstance(decoded, LaserScan):
                        self._put(decoded)
                    self._offer(decoded)
        except DriverError as error:
            self.fault = error
        except Exception as error:  # noqa: BLE001 - raised again by stop(), in the caller's thread
            self._failure = error

    def _offer(self, message: Message) -> None:
        """Queue a scan; with a full queue the oldest goes, and is counted."""
        while True:
            try:
                self._scans.put_nowait(message)
            except queue.Full:
                self.dropped_scans += self.take(0.0) is not None
            else:
                return


def run_live(
    lidar: LiveSource,
    flow: MappingFlow,
    stop: threading.Event,
    *,
    put: Put,
    on_mapped: Callable[[MappedScan], None],
    release: Callable[[], None] = lambda: None,
) -> LiveOutcome:
    """Map until `stop` is set or the lidar fails, then release the lidar and map what was still on the way."""
    sensor = SensorThread(lidar, put)
    sensor.start()
    while sensor.running and not stop.is_set():
        _map_next(sensor, flow, put, on_mapped, timeout_s=0.1)
    sensor.stop()
    release()
    while _map_next(sensor, flow, put, on_mapped, timeout_s=0.0):
        pass
    for mapped in flow.finish():
        on_mapped(mapped)
    return LiveOutcome(sensor.dropped_scans, sensor.decoding.counters, sensor.fault)


def record_live(lidar: LiveSource, stop: threading.Event, *, put: Put) -> LiveOutcome:
    """Record until `stop` is set or the lidar fails."""
    sensor = SensorThread(lidar, put)
    sensor.start()
    while sensor.running and not stop.is_set():
        sensor.take(0.1)
    sensor.stop()
    return LiveOutcome(0, sensor.decoding.counters, sensor.fault)


def _map_next(
    sensor: SensorThread, flow: MappingFlow, put: Put, on_mapped: Callable[[MappedScan], None], *, timeout_s: float
) -> bool:
    """Map one waiting scan; False where none came."""
    message = sensor.take(timeout_s)
    if message is None:
        return False
    for mapped in flow.feed(message):
        for transform in pose_transforms(mapped):
            put(transform)
        on_mapped(mapped)
    return True


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
