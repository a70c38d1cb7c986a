"""Where a sensor sits on the body, from the static transforms of a robot (ROS /tf_static)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from drivers.messages import Transform
from mapping.errors import MappingError
from mapping.mount import Mount

FloatArray = NDArray[np.float64]

MAX_TILT_RAD = np.radians(10.0)


def planar_transform(stamp_ns: int, parent: str, child: str, pose: FloatArray, *, inverted: bool = False) -> Transform:
    """Return a static transform for a pose (x, y, yaw) or, with a height, (x, y, z, yaw); inverted = roll of pi."""
    x, y, z, yaw = pose if len(pose) == 4 else (pose[0], pose[1], 0.0, pose[2])
    half = yaw / 2.0
    upright = np.array([0.0, 0.0, np.sin(half), np.cos(half)])
    hanging = np.array([np.cos(half), np.sin(half), 0.0, 0.0])  # roll by pi first, then yaw
    quaternion = hanging if inverted else upright
    return Transform(stamp_ns, parent, child, np.array([x, y, z]), quaternion, static=True)


def find_mount(transforms: Iterable[Transform], base: str, sensor: str) -> Mount | None:
    """Return the sensor's mount on the base by chaining static transforms; None where they are not connected.

    Raises MappingError for a sensor that is tilted by more than MAX_TILT_RAD: its scans are not a floor plan.
    """
    T_base_sensor = find_pose(transforms, base, sensor)
    if T_base_sensor is None:
        return None
    tilt = float(np.arccos(min(abs(T_base_sensor[2, 2]), 1.0)))
    if tilt > MAX_TILT_RAD:
        raise MappingError(
            f"laser '{sensor}' is tilted by {np.degrees(tilt):.0f} deg on '{base}': planar mapping needs it level"
        )
    yaw = np.arctan2(T_base_sensor[1, 0], T_base_sensor[0, 0])
    pose = np.array([T_base_sensor[0, 3], T_base_sensor[1, 3], yaw])
    return Mount(pose, inverted=bool(T_base_sensor[2, 2] < 0.0))


def find_pose(transforms: Iterable[Transform], base: str, sensor: str) -> FloatArray | None:
    """Return T_base_sensor (4, 4) by chaining static transforms; None where they are not connected."""
    base, sensor = base.lstrip("/"), sensor.lstrip("/")
    edges: dict[str, list[tuple[str, FloatArray]]] = {}
    for transform in transforms:
        parent, child = transform.parent.lstrip("/"), transform.child.lstrip("/")
        matrix = matrix4(transform)
        edges.setdefault(parent, []).append((child, matrix))
        edges.setdefault(child, []).append((parent, np.asarray(np.linalg.inv(matrix), dtype=np.float64)))
    reached = {base: np.eye(4)}
    frontier = [base]
    while frontier and sensor not in reached:
        frame = frontier.pop()
        for neighbour, matrix in edges.get(frame, []):
            if neighbour not in reached:
                reached[neighbour] = reached[frame] @ matrix
                frontier.append(neighbour)
    return reached.get(sensor)


def matrix4(transform: Transform) -> FloatArray:
    """Return T_parent_child as a 4x4 matrix."""
    x, y, z, w = transform.quaternion / np.linalg.norm(transform.quaternion)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = transform.translation
    return matrix
