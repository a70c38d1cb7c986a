"""A log with the pose of every scan: what is needed to replay parts of a drive on a map of another part."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.messages import LaserScan, Odometry
from drivers.recording_reader import open_recording
from mapping import se2
from mapping.deskew import deskew, reference_offset_s
from mapping.odometry import LidarOdometry, OdometrySettings
from mapping.trajectory import Trajectory, read_tum
from tools.config import Config
from tools.errors import ToolError
from tools.pipeline import LidarDecoding, look_ahead

FloatArray = NDArray[np.float64]
_LEAST_SCANS = 20


@dataclass(frozen=True, slots=True, eq=False)
class DrivenLog:
    """N scans: stamps_ns (N,), poses (N, 3) of base_link, and points, de-skewed and in the body frame, of each.

    wheels: odometry of the wheels, None where the log has none; sensor (2,): the laser's place on the body.
    """

    stamps_ns: NDArray[np.int64]
    poses: FloatArray
    points: tuple[FloatArray, ...]
    wheels: Trajectory | None
    sensor: FloatArray

    @property
    def travelled_m(self) -> FloatArray:
        """(N,) metres driven at each scan."""
        return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.poses[:, :2], axis=0).T))])


def read_driven_log(log: Path, trajectory: Path, config: Config) -> DrivenLog:
    """Read the scans of a recording that have a pose at their stamp in a trajectory of the same log; raises ToolError.

    The motion during a turn of the laser is undone with the trajectory.
    """
    track = read_tum(trajectory)
    kept: list[tuple[int, FloatArray]] = []
    wheel_poses: dict[int, FloatArray] = {}
    with open_recording(log) as recording:
        scan_topic = config.replay.scan_topic
        mount = look_ahead(recording.messages(scan_topic), config).mount
        decoding = LidarDecoding()
        for message in recording.messages(scan_topic):
            for decoded in decoding.feed(message):
                if isinstance(decoded, Odometry):
                    wheel_poses[decoded.stamp_ns] = decoded.pose
                elif isinstance(decoded, LaserScan):
                    reference_s = reference_offset_s(decoded.offsets_s)
                    stamp_ns = decoded.stamp_ns + round(reference_s * 1e9)
                    if _has(track, stamp_ns) and (not kept or stamp_ns > kept[-1][0]):
                        valid = decoded.valid
                        raw = mount.to_body(decoded.angles_rad[valid], decoded.ranges_m[valid])
                        offsets = decoded.offsets_s[valid]
                        kept.append((stamp_ns, deskew(raw, offsets, reference_s, _twist(track, decoded))))
    if len(kept) < _LEAST_SCANS:
        raise ToolError(f"{trajectory}: {len(kept)} scans of {log} have a pose in it: give the trajectory of this log")
    stamps = np.array([stamp_ns for stamp_ns, _ in kept], dtype=np.int64)
    ordered = sorted(wheel_poses)
    wheels = Trajectory(np.array(ordered), np.array([wheel_poses[s] for s in ordered])) if len(ordered) > 1 else None
    poses = track.poses[np.searchsorted(track.stamps_ns, stamps)]
    return DrivenLog(stamps, poses, tuple(points for _, points in kept), wheels, mount.pose[:2])


def odometry_from(log: DrivenLog, start: int) -> Iterator[tuple[int, FloatArray]]:
    """Yield scan numbers from `start` on with T_odom_base (3,), as a robot that is switched on there finds them.

    Laser odometry with an empty local map; the guess is the wheels' motion, or the last one again without wheels. The
    log's poses have no part in it.
    """
    odometry = LidarOdometry(OdometrySettings())
    pose, moved = se2.IDENTITY, se2.IDENTITY
    for number in range(start, len(log.stamps_ns)):
        if number > start:
            if log.wheels is not None:
                moved = se2.between(*log.wheels.at(log.stamps_ns[number - 1 : number + 1]))
            match = odometry.match(log.points[number], se2.compose(pose, moved))
            moved, pose = se2.between(pose, match.pose), match.pose
        odometry.learn(log.points[number], pose)
        yield number, pose


def _has(track: Trajectory, stamp_ns: int) -> bool:
    index = int(np.searchsorted(track.stamps_ns, stamp_ns))
    return index < len(track) and int(track.stamps_ns[index]) == stamp_ns


def _twist(track: Trajectory, scan: LaserScan) -> FloatArray:
    """Return the mean twist (3,) during a turn."""
    sweep_s = float(scan.offsets_s.max(initial=0.0))
    if sweep_s <= 0.0:
        return np.zeros(3)
    first, last = track.at(np.array([scan.stamp_ns, scan.stamp_ns + round(sweep_s * 1e9)]))
    return se2.log(se2.between(first, last)) / sweep_s
