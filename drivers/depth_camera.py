"""A depth camera as a message source: open a node that streams Z16, choose a mode, iterate for depth images.

A RealSense D400 camera is asked for its calibration and set up through its own controls; any other needs a
camera_info file.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers import v4l2
from drivers.d435_calibration import DEFAULT_UNIT_M, DepthCalibration, file_calibration, read_calibration
from drivers.d435_controls import D435Controls, apply_controls
from drivers.d435_hardware_monitor import CameraVersion, HardwareMonitor
from drivers.depth_discovery import require_depth
from drivers.errors import DeviceFaultError, DeviceLostError, RecordingError, WrongDeviceError
from drivers.messages import DepthImage
from drivers.sources import Closing
from drivers.system_calls import LinuxSystemCalls, SystemCalls
from drivers.video_device import FilledBuffer, ImageFormat, VideoDevice

_WAIT_S = 0.1  # also how soon request_stop is noticed
_FIRST_FRAME_S = 5.0
_SILENCE_S = 2.0
_DAMAGED_S = 5.0  # frames come, and none of them is whole
_SPURIOUS_S = 0.005  # a node that says "readable" and has nothing is asked again after this
_REALSENSE = "RealSense"  # in the name of every D400 camera, which the kernel cuts before the model
_SEQUENCES = 1 << 32


@dataclass(frozen=True, slots=True)
class DepthMode:
    """Image size in pixels and rate in Hz; 848x480 is what a D435 does best [Intel]."""

    width: int = 848
    height: int = 480
    fps: int = 30


DEFAULT_MODE = DepthMode()
DEFAULT_CONTROLS = D435Controls()


@dataclass(frozen=True, slots=True)
class DepthCameraInfo:
    """Who streams, and how: version is None for a camera that is not a RealSense."""

    path: str
    card: str
    mode: DepthMode
    calibration: DepthCalibration
    version: CameraVersion | None


@dataclass(frozen=True, slots=True)
class DepthCounters:
    """What a camera has delivered and lost since it was opened.

    flagged_frames: dropped because the kernel marked them as damaged. short_frames: dropped because bytes are missing.
    gaps: places where the frame number jumps; lost_frames: how many it jumped over (never reached this program).
    """

    frames: int = 0
    flagged_frames: int = 0
    short_frames: int = 0
    gaps: int = 0
    lost_frames: int = 0


def open_depth_camera(
    path: str,
    mode: DepthMode = DEFAULT_MODE,
    *,
    controls: D435Controls = DEFAULT_CONTROLS,
    camera_info: Path | None = None,
    wall_offset_ns: int = 0,
    calls: SystemCalls | None = None,
) -> DepthCamera:
    """Open the camera on `path`, set it up and read its calibration; it streams once it is iterated.

    camera_info: used where the camera does not tell. wall_offset_ns: wall clock minus monotonic clock, for the stamps.
    Raises PortMissingError, PortPermissionError, PortBusyError, WrongDeviceError, DeviceFaultError, DeviceLostError or,
    for a bad or missing camera_info, RecordingError; the node is closed then.
    """
    if camera_info is not None and not camera_info.is_file():
        raise RecordingError(f"{camera_info}: there is no such camera_info file")
    device = VideoDevice(path, LinuxSystemCalls() if calls is None else calls)
    try:
        card = require_depth(device)
        image_format = device.set_format(mode.width, mode.height, v4l2.Z16)
        device.set_rate(mode.fps, v4l2.Z16)
        monitor = HardwareMonitor(device)
        version = None
        if _REALSENSE in card and monitor.present():
            version = monitor.version()
            calibration = read_calibration(monitor, (mode.width, mode.height), camera_info)
            apply_controls(device, controls)
        else:
            calibration = _foreign_calibration(device, card, mode, controls, camera_info)
    except BaseException:
        device.close()
        raise
    exposure_ns = 1000 * (controls.exposure_us or 0)
    info = DepthCameraInfo(path, card, mode, calibration, version)
    return DepthCamera(device, info, image_format, stamp_offset_ns=wall_offset_ns - exposure_ns // 2)


class DepthCamera(Closing):
    """An open camera. Iterating gives its whole frames, oldest first, until request_stop() or stop().

    stamp_offset_ns is added to the kernel's stamps, which are those of CLOCK_MONOTONIC at a frame's start.
    """

    def __init__(
        self, device: VideoDevice, info: DepthCameraInfo, image_format: ImageFormat, *, stamp_offset_ns: int
    ) -> None:
        self.info = info
        self._device = device
        self._format = image_format
        self._stamp_offset_ns = stamp_offset_ns
        self._streaming = False
        self._next_sequence: int | None = None
        self._counts = dict.fromkeys(DepthCounters.__slots__, 0)
        self._stop_requested = threading.Event()

    @property
    def counters(self) -> DepthCounters:
        """A snapshot of the counters."""
        return DepthCounters(**self._counts)

    def start(self) -> None:
        """Begin to stream, anew if it does, and forget a stop that was requested.

        Raises PortBusyError, DeviceFaultError or DeviceLostError.
        """
        self.stop()
        self._stop_requested.clear()
        self._begin()

    def __iter__(self) -> Iterator[DepthImage]:
        """Yield whole frames; begins to stream if it does not, but obeys a stop that was requested before.

        Raises DeviceFaultError if no frame comes at first, or only damaged ones; DeviceLostError on unplugging or later
        silence.
        """
        if not self._streaming:
            self._begin()
        now_ns = self._device.calls.monotonic_ns
        heard_ns = whole_ns = now_ns()
        flowing = False
        while self._streaming and not self._stop_requested.is_set():
            buffer = self._device.take() if self._device.wait(_WAIT_S) else None
            if buffer is None:
                self._check_silence((now_ns() - heard_ns) * 1e-9, flowing)
                self._device.calls.sleep(_SPURIOUS_S)
                continue
            flowing = True
            image = self._receive(buffer)
            if image is not None:
                yield image
                whole_ns = now_ns()
            heard_ns = now_ns()  # after the yield: the time that the consumer took is not silence
            if (heard_ns - whole_ns) * 1e-9 > _DAMAGED_S:
                raise DeviceFaultError(
                    f"{self.info.path}: only damaged frames for {_DAMAGED_S:.0f} s: use a shorter USB 3 cable,"
                    " another port, or a smaller or slower mode"
                )

    def request_stop(self) -> None:
        """End the iteration within 0.2 s; may be called from any thread or a signal handler."""
        self._stop_requested.set()

    def stop(self) -> None:
        """End the stream; the camera stays open."""
        was_streaming, self._streaming = self._streaming, False
        if was_streaming:
            self._device.stop()

    def close(self) -> None:
        """Stop and release the node; a lost camera and a second call are fine."""
        self.request_stop()
        self._streaming = False
        self._device.close()

    def _begin(self) -> None:
        self._next_sequence = None
        self._device.start()
        self._streaming = True

    def _receive(self, buffer: FilledBuffer) -> DepthImage | None:
        """Copy a frame out of its buffer, count it and give the buffer back; None for a damaged one."""
        self._count_gap(buffer.sequence)
        whole_bytes = self._format.bytes_per_line * self._format.height
        image = None
        if buffer.flags & v4l2.BUFFER_ERROR:
            self._counts["flagged_frames"] += 1
        elif buffer.bytes_used < whole_bytes:
            self._counts["short_frames"] += 1
        else:
            self._counts["frames"] += 1
            image = self._image(buffer)
        self._device.queue(buffer.index)
        return image

    def _image(self, buffer: FilledBuffer) -> DepthImage:
        calibration = self.info.calibration
        monotonic = buffer.flags & v4l2.TIMESTAMP_MASK == v4l2.TIMESTAMP_MONOTONIC
        stamp_ns = buffer.stamp_ns if monotonic else self._device.calls.monotonic_ns()
        return DepthImage(
            stamp_ns=stamp_ns + self._stamp_offset_ns,
            depth=self._pixels(buffer),
            unit_m=calibration.unit_m,
            camera=calibration.camera,
            sequence=buffer.sequence,
        )

    def _pixels(self, buffer: FilledBuffer) -> NDArray[np.uint16]:
        """View the buffer as (rows, cols); the message makes its own copy."""
        form = self._format
        counts = np.frombuffer(self._device.content(buffer), "<u2", form.bytes_per_line // 2 * form.height)
        return counts.reshape(form.height, -1)[:, : form.width]

    def _count_gap(self, sequence: int) -> None:
        if self._next_sequence is not None:
            jumped = (sequence - self._next_sequence) % _SEQUENCES
            if 0 < jumped < _SEQUENCES // 2:
                self._counts["gaps"] += 1
                self._counts["lost_frames"] += jumped
        self._next_sequence = (sequence + 1) % _SEQUENCES

    def _check_silence(self, silent_s: float, flowing: bool) -> None:
        if flowing and silent_s > _SILENCE_S:
            raise DeviceLostError(
                f"{self.info.path}: no frame for {silent_s:.1f} s during streaming: check its cable and its USB port"
            )
        if not flowing and silent_s > _FIRST_FRAME_S:
            raise DeviceFaultError(
                f"{self.info.path}: streaming, but no frame within {silent_s:.1f} s: unplug the camera and plug it in,"
                " without a hub"
            )


def _foreign_calibration(
    device: VideoDevice, card: str, mode: DepthMode, controls: D435Controls, camera_info: Path | None
) -> DepthCalibration:
    if controls != DEFAULT_CONTROLS:
        raise WrongDeviceError(
            f"{device.path}: {card} has no emitter, exposure or laser controls of a RealSense: leave them out"
        )
    if camera_info is None:
        raise WrongDeviceError(
            f"{device.path}: {card} is not a RealSense and does not tell its intrinsics: give its camera_info YAML"
        )
    return file_calibration(camera_info, (mode.width, mode.height), DEFAULT_UNIT_M)
