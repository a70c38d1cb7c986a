"""The sensors of a session: a lidar, a depth camera or both, opened, started and described."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from drivers.d435_emulated_firmware import is_emulated_camera
from drivers.depth_camera import DepthCamera, DepthMode, open_depth_camera
from drivers.depth_discovery import find_depth_nodes
from drivers.messages import LidarStream, Transform
from drivers.reconnecting_camera import ReconnectingCamera
from drivers.rotations import quaternion
from drivers.rplidar import Rplidar, open_rplidar
from drivers.rplidar_models import is_emulated
from drivers.system_calls import LinuxSystemCalls, SystemCalls
from mapping.frames import planar_transform
from tools.clock import RunClock
from tools.config import Config
from tools.emulated_camera import EMULATED, emulated_camera
from tools.pipeline import CAMERA_FRAME, LASER_FRAME

log = logging.getLogger(__name__)

AUTO = "auto"


@dataclass(frozen=True, slots=True)
class LiveSensors:
    """What was started; places: where the sensors sit, as the static transforms that run and replay start from."""

    lidar: Rplidar | None
    stream: LidarStream | None
    camera: ReconnectingCamera | None
    places: tuple[Transform, ...]

    def close(self) -> None:
        """Release the devices; they may be closed again."""
        for device in (self.lidar, self.camera):
            if device is not None:
                device.close()

    @property
    def simulated(self) -> bool:
        """Whether any of the data is."""
        return (self.stream is not None and is_emulated(self.stream.serial)) or (
            self.camera is not None and is_simulated_camera(self.camera)
        )

    @property
    def origin(self) -> dict[str, str]:
        """Return what a recording says of where its data come from."""
        serial = {} if self.stream is None else {"lidar_serial": self.stream.serial}
        version = None if self.camera is None else self.camera.info.version
        camera = {} if version is None else {"camera_serial": version.serial}
        return {"simulated": str(self.simulated).lower(), **serial, **camera}

    def summary(self) -> dict[str, object]:
        """Return what the report says of the devices."""
        summary: dict[str, object] = {"simulated": self.simulated}
        if self.stream is not None:
            names = ("model", "firmware", "serial", "mode")
            summary["lidar"] = {name: getattr(self.stream, name) for name in names}
        if self.camera is not None:
            info, counters = self.camera.info, self.camera.counters
            summary["camera"] = {
                "path": info.path,
                "card": info.card,
                "serial": None if info.version is None else info.version.serial,
                "mode": f"{info.mode.width}x{info.mode.height} at {info.mode.fps} Hz",
                "calibration": info.calibration.source.value,
                **{field.name: getattr(counters, field.name) for field in fields(counters)},
                "losses": self.camera.losses,
            }
        return summary


@contextmanager
def started_sensors(
    lidar_port: str | None, camera_port: str | None, config: Config, clock: RunClock
) -> Iterator[LiveSensors]:
    """Open and check what is asked for, the camera first since it takes longer; close it at the end.

    Raises DriverError. The camera streams once it is iterated.
    """
    with ExitStack() as opened:
        patience_s = config.depth.regain_s if lidar_port is None else math.inf
        camera = None
        if camera_port is not None:
            camera = opened.enter_context(open_camera(camera_port, config, clock, patience_s=patience_s))
        lidar, stream = None, None
        if lidar_port is not None:
            lidar = opened.enter_context(open_rplidar(lidar_port, baud=config.lidar.baud, clock=clock))
            stream = lidar.start(config.lidar.mode, config.lidar.motor_pwm)
            _tell_lidar(stream, lidar_port)
        stamp_ns = clock() if stream is None else stream.stamp_ns
        places = [] if stream is None else [_laser_place(config, stamp_ns)]
        places += [] if camera is None else [_camera_place(config, stamp_ns)]
        yield LiveSensors(lidar, stream, camera, tuple(places))


def open_camera(port: str, config: Config, clock: RunClock, *, patience_s: float = 0.0) -> ReconnectingCamera:
    """Open the camera that the command line names: auto, a node or an emulated one. Raises DriverError.

    patience_s: how long it is looked for when it is lost later.
    """
    section = config.depth
    mode = DepthMode(section.width, section.height, section.fps)
    calls, find_path = _camera_system(port, config)

    def open_once() -> DepthCamera:
        return open_depth_camera(
            find_path(),
            mode,
            camera_info=None if section.camera_info is None else Path(section.camera_info),
            wall_offset_ns=clock.offset_ns,
            calls=calls,
        )

    camera = ReconnectingCamera(open_once, patience_s=patience_s)
    log.info(
        "%s at %s%s: %dx%d at %d Hz, intrinsics from %s",
        camera.info.card,
        port,
        " (EMULATED: simulated data)" if is_simulated_camera(camera) else "",
        mode.width,
        mode.height,
        mode.fps,
        camera.info.calibration.source.value,
    )
    return camera


def _camera_system(port: str, config: Config) -> tuple[SystemCalls, Callable[[], str]]:
    """Return whom the driver asks, and what finds the node: it may have another number each time it is plugged in."""
    if port.startswith(EMULATED):
        emulator = emulated_camera(port, (config.depth.width, config.depth.height), config.camera_mount())
        return emulator, lambda: emulator.path
    calls = LinuxSystemCalls()
    return calls, lambda: find_depth_nodes(calls).choose().path if port == AUTO else port


def is_simulated_camera(camera: DepthCamera | ReconnectingCamera) -> bool:
    """Whether the camera is an emulated one."""
    return camera.info.version is not None and is_emulated_camera(camera.info.version.serial)


def _tell_lidar(stream: LidarStream, port: str) -> None:
    log.info(
        "RPLIDAR %s at %s, %d baud%s: firmware %s, serial %s; mode %s, %.0f samples a second",
        stream.model,
        port,
        stream.baud,
        " (EMULATED: simulated data)" if is_emulated(stream.serial) else "",
        stream.firmware,
        stream.serial,
        stream.mode,
        1e6 / stream.sample_us,
    )


def _laser_place(config: Config, stamp_ns: int) -> Transform:
    """Return the configured pose of the laser as the static transform that live run and replay both start from.

    Its stamp must not be later than the stream's first bytes, which replay reads in the order of time.
    """
    mount = config.lidar.mount
    pose = np.array([mount.x_m, mount.y_m, mount.z_m, mount.yaw_rad])
    return planar_transform(stamp_ns, "base_link", LASER_FRAME, pose, inverted=mount.inverted)


def _camera_place(config: Config, stamp_ns: int) -> Transform:
    """Return the configured pose of the camera, likewise."""
    pose = config.camera_mount().T_base_optical
    return Transform(stamp_ns, "base_link", CAMERA_FRAME, pose[:3, 3], quaternion(pose[:3, :3]), static=True)
