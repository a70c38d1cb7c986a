"""A stamped sequence of planar poses and its TUM text form (t x y z qx qy qz qw)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.errors import TrajectoryError, unreadable

FloatArray = NDArray[np.float64]
StampArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses (N, 3) of base_link as x, y, yaw in one fixed frame at strictly rising stamps_ns (N,)."""

    stamps_ns: StampArray
    poses: FloatArray

    def __post_init__(self) -> None:
        stamps = np.array(self.stamps_ns, dtype=np.int64)
        poses = np.array(self.poses, dtype=np.float64).reshape(-1, 3)
        if stamps.ndim != 1 or len(stamps) != len(poses):
            raise ValueError(f"{stamps.shape} stamps for {poses.shape} poses; expected (N,) and (N, 3)")
        if np.any(np.diff(stamps) <= 0):
            raise ValueError("the stamps of a trajectory must rise strictly")
        if not np.isfinite(poses).all():
            raise ValueError("the poses of a trajectory must be finite")
        for name, array in (("stamps_ns", stamps), ("poses", poses)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def length_m(self) -> float:
        """Distance driven, as the sum of the steps."""
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum()) if len(self) > 1 else 0.0

    def at(self, stamps_ns: StampArray) -> FloatArray:
        """Return the poses (M, 3) interpolated at the stamps (M,); x, y and yaw linearly, ends held."""
        start = self.stamps_ns[0]
        seconds = (self.stamps_ns - start) * 1e-9
        query = (np.asarray(stamps_ns, dtype=np.int64) - start) * 1e-9
        unwrapped = np.column_stack([self.poses[:, :2], np.unwrap(self.poses[:, 2])])
        columns = [np.interp(query, seconds, unwrapped[:, axis]) for axis in range(3)]
        return np.column_stack([columns[0], columns[1], se2.wrap_angle(columns[2])])


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write the trajectory as TUM text; stamps keep all their nanoseconds."""
    lines = []
    for stamp, (x, y, yaw) in zip(trajectory.stamps_ns.tolist(), trajectory.poses.tolist(), strict=True):
        sign = "-" if stamp < 0 else ""
        seconds, nanoseconds = divmod(abs(stamp), 1_000_000_000)
        qz, qw = float(np.sin(yaw / 2.0)), float(np.cos(yaw / 2.0))
        lines.append(f"{sign}{seconds}.{nanoseconds:09d} {x:.9f} {y:.9f} 0 0 0 {qz:.12f} {qw:.12f}\n")
    path.write_text("".join(lines), encoding="ascii")


def read_tum(path: Path) -> Trajectory:
    """Read TUM text; raise TrajectoryError with the line number where a line does not parse."""
    stamps: list[int] = []
    poses: list[tuple[float, float, float]] = []
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise TrajectoryError(f"{path}: cannot read the trajectory: {unreadable(error)}") from error
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        fields = line.split()
        try:
            if len(fields) != 8:
                raise ValueError(f"{len(fields)} fields")
            x, y, _, qx, qy, qz, qw = (float(field) for field in fields[1:])
            stamps.append(parse_stamp_ns(fields[0]))
        except ValueError as error:
            raise TrajectoryError(f"{path}:{number}: expected 't x y z qx qy qz qw': {error}") from error
        poses.append((x, y, float(np.arctan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz)))))
    if not stamps:
        raise TrajectoryError(f"{path}: the trajectory holds no pose")
    try:
        return Trajectory(np.array(stamps, dtype=np.int64), np.array(poses))
    except ValueError as error:
        raise TrajectoryError(f"{path}: {error}") from error


def parse_stamp_ns(text: str) -> int:
    """Parse decimal seconds to int nanoseconds without a detour over floating point where there is no exponent."""
    if "e" in text.lower():
        return round(float(text) * 1e9)
    whole, _, fraction = text.lstrip("-").partition(".")
    value = int(whole or "0") * 1_000_000_000 + int((fraction + "000000000")[:9])
    return -value if text.startswith("-") else value
