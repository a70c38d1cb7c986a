"""The stamped messages that flow from the sensors into mapping.

All are immutable; arrays are checked once and made read-only. Stamps are integer nanoseconds of wall-clock time
(monotonic clock at the read plus one offset fixed at start, see docs/how-it-works.md). Units are SI, angles radians
counter-clockwise (REP-103).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def _frozen_array(values: FloatArray, shape: tuple[int | None, ...], name: str) -> FloatArray:
    """Return a read-only float64 copy of `values`; raise ValueError unless its shape matches (None = any length)."""
    array = np.array(values, dtype=np.float64)
    if array.shape != shape and (
        array.ndim != len(shape)
        or any(want is not None and want != got for want, got in zip(shape, array.shape, strict=True))
    ):
        raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, slots=True, eq=False)
class LaserScan:
    """One turn of a planar laser, as individual samples in the order in which they were taken.

    stamp_ns: acquisition time of the first sample. angles_rad: (N,) in the laser frame, counter-clockwise, any order.
    ranges_m: (N,); 0, NaN, infinite, < range_min_m or >= range_max_m means "no measurement", never "free".
    offsets_s: (N,) time of each sample after stamp_ns (all 0 where the source does not tell).
    intensities: (N,) or None where the sensor does not measure it. complete: False for a partial turn or one with a
    gap in its bytes. Raises ValueError for shapes that disagree.
    """

    stamp_ns: int
    angles_rad: FloatArray
    ranges_m: FloatArray
    offsets_s: FloatArray
    range_min_m: float
    range_max_m: float
    frame_id: str = "laser"
    intensities: FloatArray | None = None
    complete: bool = True

    def __post_init__(self) -> None:
        ranges_m = _frozen_array(self.ranges_m, (None,), "ranges_m")
        object.__setattr__(self, "ranges_m", ranges_m)
        object.__setattr__(self, "angles_rad", _frozen_array(self.angles_rad, ranges_m.shape, "angles_rad"))
        object.__setattr__(self, "offsets_s", _frozen_array(self.offsets_s, ranges_m.shape, "offsets_s"))
        if self.intensities is not None:
            object.__setattr__(self, "intensities", _frozen_array(self.intensities, ranges_m.shape, "intensities"))

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(N,) True where the sample is a measurement."""
        ranges = self.ranges_m
        return np.isfinite(ranges) & (ranges > 0) & (ranges >= self.range_min_m) & (ranges < self.range_max_m)


@dataclass(frozen=True, slots=True, eq=False)
class Odometry:
    """Planar wheel (or other external) odometry: pose (x, y, yaw) of child_frame in frame, in m and rad.

    twist is (vx, vy, wz) in the child frame, m/s and rad/s.
    """

    stamp_ns: int
    pose: FloatArray
    twist: FloatArray
    frame_id: str = "odom"
    child_frame_id: str = "base_link"

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", _frozen_array(self.pose, (3,), "pose"))
        object.__setattr__(self, "twist", _frozen_array(self.twist, (3,), "twist"))


@dataclass(frozen=True, slots=True, eq=False)
class Imu:
    """Turning speeds (3,) in rad/s and accelerations (3,) in m/s², as felt: a car that stands feels +9.81 along z.

    Axes of frame_id: x ahead, y left, z up (REP-103).
    """

    stamp_ns: int
    angular_velocity_radps: FloatArray
    acceleration_mps2: FloatArray
    frame_id: str = "base_link"

    def __post_init__(self) -> None:
        for name in ("angular_velocity_radps", "acceleration_mps2"):
            object.__setattr__(self, name, _frozen_array(getattr(self, name), (3,), name))


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """Pose of child frame in parent frame: translation (3,) in m, quaternion (4,) as x, y, z, w."""

    stamp_ns: int
    parent: str
    child: str
    translation: FloatArray
    quaternion: FloatArray
    static: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "translation", _frozen_array(self.translation, (3,), "translation"))
        object.__setattr__(self, "quaternion", _frozen_array(self.quaternion, (4,), "quaternion"))


@dataclass(frozen=True, slots=True)
class Pinhole:
    """A rectified camera without distortion: image size, focal lengths and principal point, all in pixels.

    A point (x, y, z) of the optical frame (x right, y down, z ahead) is seen at (fx x / z + cx, fy y / z + cy); whole
    numbers are the middles of pixels.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float


@dataclass(frozen=True, slots=True, eq=False)
class DepthImage:
    """One frame of a depth camera.

    depth: (rows, cols) uint16, row 0 at the top; z along the optical axis in units of unit_m, 0 means "no measurement",
    never "free". stamp_ns: middle of the exposure where it is known, else its start. sequence: the camera's frame
    number, -1 where the source has none. Raises ValueError where the image does not have the camera's size.
    """

    stamp_ns: int
    depth: NDArray[np.uint16]
    unit_m: float
    camera: Pinhole
    frame_id: str = "camera_depth_optical_frame"
    sequence: int = -1

    def __post_init__(self) -> None:
        depth = np.array(self.depth, dtype=np.uint16)
        if depth.shape != (self.camera.height, self.camera.width):
            raise ValueError(
                f"depth has shape {depth.shape}, expected ({self.camera.height}, {self.camera.width}) as the camera"
            )
        depth.setflags(write=False)
        object.__setattr__(self, "depth", depth)


@dataclass(frozen=True, slots=True)
class RawChunk:
    """Bytes exactly as one read of the lidar's port returned them; stamp_ns is the clock right after that read."""

    stamp_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class LidarStream:
    """A lidar began to stream: all that decoding the raw chunks after this message needs.

    answer_type: 0x81 standard nodes, 0x82 express, 0x84 ultra, 0x85 dense capsules. sample_us: time per sample.
    range_max_m: the mode's maximum distance.
    """

    stamp_ns: int
    model: str
    firmware: str
    hardware: int
    serial: str
    baud: int
    mode: str
    answer_type: int
    sample_us: float
    range_max_m: float
    range_min_m: float = 0.15
    frame_id: str = "laser"


@dataclass(frozen=True, slots=True, eq=False)
class GridSnapshot:
    """A map as other tools see it (nav_msgs/OccupancyGrid).

    cells: (rows, cols) int8, -1 unknown, 0 free to 100 occupied, row 0 at the lowest y. origin is the pose (x, y, yaw)
    of the lower-left corner of cell (0, 0) in frame_id.
    """

    stamp_ns: int
    resolution_m: float
    origin: FloatArray
    cells: NDArray[np.int8]
    frame_id: str = "map"

    def __post_init__(self) -> None:
        object.__setattr__(self, "origin", _frozen_array(self.origin, (3,), "origin"))
        cells = np.array(self.cells, dtype=np.int8)
        if cells.ndim != 2:
            raise ValueError(f"cells has shape {cells.shape}, expected (rows, cols)")
        cells.setflags(write=False)
        object.__setattr__(self, "cells", cells)


@dataclass(frozen=True, slots=True, eq=False)
class PlannedPath:
    """A way to drive, as other tools see it (nav_msgs/Path): poses (N, 3) of base_link, x, y and yaw in frame_id.

    yaw is where the car points, also while it drives backwards. Raises ValueError for poses that are not finite.
    """

    stamp_ns: int
    poses: FloatArray
    frame_id: str = "map"

    def __post_init__(self) -> None:
        poses = _frozen_array(self.poses, (None, 3), "poses")
        if not np.isfinite(poses).all():
            raise ValueError("poses holds values that are not finite")
        object.__setattr__(self, "poses", poses)


@dataclass(frozen=True, slots=True)
class VelocityCommand:
    """What a car was told, as other tools see it (geometry_msgs/Twist): speed ahead and turning speed of base_link."""

    stamp_ns: int
    speed_mps: float
    yaw_rate_radps: float


Message = LaserScan | Odometry | Imu | Transform | RawChunk | LidarStream | DepthImage
Product = GridSnapshot | PlannedPath | VelocityCommand
"""What came of messages: recorded for other tools, never replayed."""
Recordable = Message | Product
