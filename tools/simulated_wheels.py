"""Wheel odometry of a simulated car: what its encoder and its gyroscope make of a drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.messages import Odometry
from mapping import se2
from mapping.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class WheelNoise:
    """How wrong dead reckoning is; standard deviations all.

    way_scale: of the encoder (tyre radius), one error a drive; way_slip: share of each metre, at random (per root of a
    metre). yaw_scale: of the gyroscope, one error a drive; yaw_bias_rad_s: what is left of its bias after standing
    still, one value a drive; yaw_walk_rad: at random, per root of a second.
    """

    way_scale: float = 0.02
    way_slip: float = 0.01
    yaw_scale: float = 0.01
    yaw_bias_rad_s: float = 0.001
    yaw_walk_rad: float = 0.001


def wheel_odometry(drive: Trajectory, noise: WheelNoise, seed: int) -> list[Odometry]:
    """Return the messages of a drive, one for each of its poses; the first is at the odometry's origin."""
    random = np.random.default_rng([seed, 23])
    way_scale, yaw_scale, yaw_bias = 1.0 + random.standard_normal(3) * (
        noise.way_scale, noise.yaw_scale, noise.yaw_bias_rad_s,
    )  # fmt: skip
    yaw_bias -= 1.0
    steps = se2.log(se2.between(drive.poses[:-1], drive.poses[1:]))
    seconds = np.diff(drive.stamps_ns) * 1e-9
    slip, walk = random.standard_normal((2, len(steps)))
    steps[:, :2] *= way_scale
    steps[:, 0] += slip * noise.way_slip * np.sqrt(np.abs(steps[:, 0]))
    steps[:, 2] = steps[:, 2] * yaw_scale + yaw_bias * seconds + walk * noise.yaw_walk_rad * np.sqrt(seconds)
    poses = [se2.IDENTITY]
    for step in steps:
        poses.append(se2.compose(poses[-1], se2.exp(step)))
    twists = np.vstack([np.zeros((1, 3)), steps / seconds[:, np.newaxis]])
    return [
        Odometry(stamp, pose, twist) for stamp, pose, twist in zip(drive.stamps_ns.tolist(), poses, twists, strict=True)
    ]
