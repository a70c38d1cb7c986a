"""Poses that came with a recording, as planar odometry: of the car, else of the place below a camera.

A camera that is held in the hand has no base_link: its car is taken to be the point on the floor below it, headed where
it looks, with another mount in every frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.messages import Odometry, Transform
from mapping.depth_projection import CameraMount
from mapping.frames import matrix4

FloatArray = NDArray[np.float64]

_STILL = np.zeros(3)


class RecordedPoses:
    """Follows transforms from the root of their tree to a car's frame, or to its camera's.

    base_frames: what the car may be called. T_level_root (4, 4): the root in a level frame whose floor is at z = 0.
    """

    def __init__(self, base_frames: Sequence[str], camera_frame: str, T_level_root: FloatArray) -> None:
        self._base_frames = base_frames
        self._camera_frame = camera_frame.lstrip("/")
        self._T_level_root = T_level_root
        self._above: dict[str, tuple[str, FloatArray]] = {}
        self._moving: set[str] = set()

    def add(self, transform: Transform) -> Odometry | None:
        """Take in a transform; return the pose that it gives, None for a static one or one of something else."""
        child = transform.child.lstrip("/")
        self._above[child] = (transform.parent.lstrip("/"), matrix4(transform))
        if transform.static:
            return None
        self._moving.add(child)
        for base in (*self._base_frames, self._camera_frame):
            chain = self._chain(base)
            if child in chain and chain[0] in self._above and self._moving.intersection(chain):
                place = self._T_level_root @ self._place(chain)
                pose = below(place)[0] if base == self._camera_frame else planar(place)
                return Odometry(transform.stamp_ns, pose, _STILL, "recorded", base)
        return None

    @property
    def mount(self) -> CameraMount | None:
        """Where the camera sits, as the last transforms say; None before there is any, or where they are the car's."""
        place = self.camera_place
        return None if place is None else below(place)[1]

    @property
    def camera_place(self) -> FloatArray | None:
        """T_level_optical (4, 4) of a camera that is tracked itself, as the last transforms say."""
        for base in self._base_frames:
            if self._moving.intersection(self._chain(base)):
                return None
        chain = self._chain(self._camera_frame)
        if chain[0] not in self._above:
            return None
        return self._T_level_root @ self._place(chain)

    def _chain(self, frame: str) -> list[str]:
        """Return the frame and those above it, without the root."""
        chain = [frame]
        while (above := self._above.get(chain[-1])) is not None and above[0] in self._above and above[0] not in chain:
            chain.append(above[0])
        return chain

    def _place(self, chain: Sequence[str]) -> FloatArray:
        place = np.eye(4)
        for frame in chain:
            place = self._above[frame][1] @ place
        return place


def below(T_level_optical: FloatArray) -> tuple[FloatArray, CameraMount]:
    """Return the pose (3,) on the floor below a camera, headed where it looks, and the camera's mount there."""
    x, y = T_level_optical[:2, 3].tolist()
    yaw = math.atan2(T_level_optical[1, 2], T_level_optical[0, 2])
    T_level_base = np.eye(4)
    T_level_base[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    T_level_base[:2, 3] = x, y
    return np.array([x, y, yaw]), CameraMount.from_matrix4(np.linalg.inv(T_level_base) @ T_level_optical)


def levelled(gravity: FloatArray) -> FloatArray:
    """Return T_level_root (4, 4) for the direction (3,) of gravity in the root: z up, the origin where it was.

    x is as near to the z of the root as it goes: ahead, for a first camera. The height of the floor stays unknown.
    """
    up = -gravity / np.linalg.norm(gravity)
    ahead = np.eye(3)[2 if abs(up[2]) < 0.9 else 0]
    ahead = ahead - up * float(up @ ahead)
    ahead /= np.linalg.norm(ahead)
    turn = np.eye(4)
    turn[:3, :3] = np.stack([ahead, np.cross(up, ahead), up])
    return turn


def floor_height(heights_m: FloatArray) -> float:
    """Return the height of the floor among heights (N,) of points on everything: the lowest level with many points."""
    if len(heights_m) == 0:
        return 0.0
    low, high = np.percentile(heights_m, [0.1, 99.9])
    edges = np.arange(low - 0.1, high + 0.1, 0.05)
    counts, _ = np.histogram(heights_m, edges)
    lowest = int(np.flatnonzero(counts > 0.2 * counts.max())[0])
    return float(edges[lowest] + 0.025)


def planar(T_level_base: FloatArray) -> FloatArray:
    """Return the pose (3,) of a car (4, 4) on the floor."""
    x, y = T_level_base[:2, 3].tolist()
    return np.array([x, y, math.atan2(T_level_base[1, 0], T_level_base[0, 0])])
