"""A depth camera that is opened again after it was lost: a cable that slipped costs the images of that time only."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import astuple

from drivers.depth_camera import DepthCamera, DepthCameraInfo, DepthCounters
from drivers.errors import DeviceFaultError, DeviceLostError, DriverError, WrongDeviceError
from drivers.messages import DepthImage
from drivers.sources import Closing

RETRY_S = 0.5  # a camera that was plugged in again needs a second or two anyway

log = logging.getLogger(__name__)


class ReconnectingCamera(Closing):
    """Iterates as a DepthCamera does, over all that open_camera() gives one after the other.

    A camera that vanishes, falls silent or sends damaged frames only, after it has sent whole ones, is closed and
    looked for until it is back: for patience_s at the most (0: not at all, inf: as long as it takes). It must be the
    same one. Loss and return are one line of the log each. Raises what open_camera raises for the first time. sleep: as
    time.sleep, None for one that request_stop ends.
    """

    def __init__(
        self,
        open_camera: Callable[[], DepthCamera],
        *,
        patience_s: float,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], object] | None = None,
    ) -> None:
        self.losses = 0
        self._open_camera = open_camera
        self._patience_s = patience_s
        self._clock = clock
        self._stop_requested = threading.Event()
        self._sleep = self._stop_requested.wait if sleep is None else sleep
        self._past = DepthCounters()
        self._camera = open_camera()

    @property
    def info(self) -> DepthCameraInfo:
        """Who streams, and how."""
        return self._camera.info

    @property
    def counters(self) -> DepthCounters:
        """What came and what was lost, over all connections; frames of the time without one are not in it."""
        return _added(self._past, self._camera.counters)

    def __iter__(self) -> Iterator[DepthImage]:
        """Yield whole frames until request_stop().

        Raises DeviceFaultError if no frame comes at all; DeviceLostError once the camera was looked for long enough, or
        if it is still lost when a stop is requested.
        """
        while True:
            try:
                yield from self._camera
            except (DeviceLostError, DeviceFaultError) as loss:
                if not self.counters.frames or self._patience_s <= 0.0:
                    raise
                self._regain(loss)
            else:
                return

    def request_stop(self) -> None:
        """End the iteration within 0.2 s, or the search for a lost camera; may be called from any thread."""
        self._stop_requested.set()
        self._camera.request_stop()

    def close(self) -> None:
        """Stop and release the node; a lost camera and a second call are fine."""
        self.request_stop()
        self._camera.close()

    def _regain(self, loss: DriverError) -> None:
        """Open the camera again, or raise DeviceLostError."""
        self._camera.close()
        self.losses += 1
        log.warning("the camera is lost, and looked for: %s", loss)
        lost_ns = self._clock()
        reason: DriverError = loss
        while not self._stop_requested.is_set() and (away_s := (self._clock() - lost_ns) * 1e-9) < self._patience_s:
            try:
                camera = self._open_same()
            except DriverError as error:
                reason = error
                self._sleep(RETRY_S)
                continue
            self._past, self._camera = self.counters, camera
            if self._stop_requested.is_set():
                camera.request_stop()  # asked for while it was being opened
            log.warning("the camera is back after %.1f s", away_s)
            return
        away_s = (self._clock() - lost_ns) * 1e-9
        last = "" if reason is loss else f"; at last: {reason}"
        raise DeviceLostError(f"{loss} (not back after {away_s:.0f} s{last})") from loss

    def _open_same(self) -> DepthCamera:
        camera, old = self._open_camera(), self.info
        if (camera.info.card, camera.info.version) != (old.card, old.version):
            camera.close()
            raise WrongDeviceError(f"{camera.info.path}: another camera than before: plug in the one that was lost")
        return camera


def _added(first: DepthCounters, second: DepthCounters) -> DepthCounters:
    return DepthCounters(*(a + b for a, b in zip(astuple(first), astuple(second), strict=True)))
