"""MRPT's icp-slam as a peer, if the program is installed (Debian package mrpt-apps): run beside, never imported.

Two traps of its converter carmen2rawlog 2.5.8: it takes 0.5 deg between beams for granted unless a PARAM line says
otherwise, and it gives all scans one time, with which icp-slam ignores the wheels: the log's times are put in.
"""

from __future__ import annotations

import gzip
import os
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from drivers.carmen_lines import NO_RETURN_M
from drivers.carmen_log import is_carmen_log
from drivers.errors import RecordingError
from drivers.messages import LaserScan, Odometry
from drivers.recording_reader import open_recording
from mapping.trajectory import Trajectory
from tools.errors import ToolError
from tools.slam_bench import RelationScore, score_by_relations
from tools.slam_peers import PeerCost

NAME = "MRPT icp-slam"
PROGRAMS = ("icp-slam", "carmen2rawlog")

_ODOMETRY = re.compile(rb"CObservationOdometry")
# MRPT counts 100 ns from the year 1601.
_EPOCH_TICKS = 116_444_736_000_000_000
_NOT_BEFORE, _NOT_AFTER = (_EPOCH_TICKS + years * 315_576_000_000_000 for years in (30, 200))

# MRPT's own demonstration settings for icp-slam (icp-slam_demo_classic), without windows and with the pose log only.
_SETTINGS = """[ICP]
maxIterations = 80
minAbsStep_trans = 1e-6
minAbsStep_rot = 1e-6
thresholdDist = 0.3
thresholdAng_DEG = 5
ALFA = 0.8
smallestThresholdDist = 0.05
onlyClosestCorrespondences = true
onlyUniqueRobust = true
ICP_algorithm = icpClassic
corresponding_points_decimation = 5
[MappingApplication]
rawlog_file = {rawlog}
rawlog_offset = 0
logOutput_dir = {output}
LOG_FREQUENCY = 1000000000
SAVE_3D_SCENE = 0
SAVE_POSE_LOG = 0
CAMERA_3DSCENE_FOLLOWS_ROBOT = 1
SHOW_PROGRESS_3D_REAL_TIME = 0
SHOW_PROGRESS_3D_REAL_TIME_DELAY_MS = 0
SHOW_LASER_SCANS_3D = false
localizationLinDistance = 0.2
localizationAngDistance = 5
insertionLinDistance = 1.2
insertionAngDistance = 45.0
minICPgoodnessToAccept = 0.40
matchAgainstTheGrid = 0
occupancyGrid_count = 0
gasGrid_count = 0
landmarksMap_count = 0
beaconMap_count = 0
pointsMap_count = 1
likelihoodMapSelection = -1
[MappingApplication_pointsMap_00_insertOpts]
minDistBetweenLaserPoints = 0.05
fuseWithExisting = false
isPlanarMap = 1
"""


def bench_icp_slam(path: Path, relations: tuple[Path, ...]) -> PeerCost:
    """Run icp-slam on a CARMEN log; a row without figures where it is not installed or the log is of another kind."""
    if missing := [name for name in PROGRAMS if shutil.which(name) is None]:
        return PeerCost(NAME, f"not installed ({', '.join(missing)}; Debian: mrpt-apps)")
    if not path.is_file() or not is_carmen_log(path):
        return PeerCost(NAME, "reads CARMEN logs only")
    with TemporaryDirectory() as folder:
        work = Path(folder)
        stamps = _write_sorted_log(path, work / "log.clf")
        _run(["carmen2rawlog", "-q", "-w", "-i", "log.clf", "-o", "log.rawlog"], work)
        (work / "settings.ini").write_text(_SETTINGS.format(rawlog="log.rawlog", output="out"), encoding="ascii")
        stamped = gzip.compress(with_times(gzip.decompress((work / "log.rawlog").read_bytes()), stamps), 1)
        (work / "log.rawlog").write_bytes(stamped)
        cpu_s, wall_s, peak_mb = _run(["icp-slam", "settings.ini", "log.rawlog"], work)
        estimated = work / "out" / "log_estimated_path.txt"
        score, note = _score(estimated, stamps, relations)
    duration_s = float(np.ptp(stamps)) * 1e-9
    return PeerCost(
        NAME, note, cpu_s * 1e3 / len(stamps), cpu_s / duration_s, wall_s / duration_s, peak_mb, score
    )  # fmt: skip


def _write_sorted_log(path: Path, written: Path) -> list[int]:
    """Write the log's scans as CARMEN lines in the order of time, as this project maps them; return their stamps in ns.

    The beams' spacing stands first, in the way that the converter reads.
    """
    stamps: list[int] = []
    wheels = np.zeros(3)
    with open_recording(path) as recording, written.open("w", encoding="ascii") as lines:
        for message in recording.messages():
            if isinstance(message, Odometry):
                wheels = message.pose
            elif isinstance(message, LaserScan):
                if not stamps:
                    spacing_deg = 180.0 / len(message.ranges_m)
                    lines.write(f"PARAM laser_front_laser_resolution {spacing_deg:g} 0.0 peer 0.0\n")
                stamps.append(message.stamp_ns)
                seconds = f"{message.stamp_ns * 1e-9:.6f}"
                ranges = " ".join(
                    f"{range_m:.3f}" for range_m in np.where(message.valid, message.ranges_m, NO_RETURN_M)
                )
                pose = " ".join(f"{value:.6f}" for value in wheels)
                lines.write(f"FLASER {len(message.ranges_m)} {ranges} {pose} {pose} {seconds} peer {seconds}\n")
    if len(stamps) < 2:
        raise RecordingError(f"{path}: fewer than two scans in it: nothing to measure")
    return stamps


def with_times(rawlog: bytes, stamps: list[int]) -> bytes:
    """Return an unpacked rawlog whose observations, an odometry and a scan for each stamp in ns, have times that rise.

    Raises ToolError where the converter has written something else than one time for all.
    """
    first = _ODOMETRY.search(rawlog)
    windows = () if first is None else range(first.end(), min(first.end() + 200, len(rawlog) - 8))
    for start in windows:
        time_bytes = rawlog[start : start + 8]
        if _NOT_BEFORE <= int.from_bytes(time_bytes, "little") < _NOT_AFTER:
            pieces = rawlog.split(time_bytes)
            if len(pieces) == 2 * len(stamps) + 1:
                return b"".join([part for pair in zip(pieces, _times(stamps), strict=True) for part in pair])
    raise ToolError("carmen2rawlog wrote another form of rawlog than version 2.5.8 does: leave it out, --no-peers")


def _times(stamps: list[int]) -> Iterator[bytes]:
    """Yield MRPT's time of each observation, two a stamp and never stepping back, and nothing at the end."""
    last = 0
    for stamp_ns in stamps:
        last = max(last + 10, stamp_ns // 100 + _EPOCH_TICKS)
        yield last.to_bytes(8, "little")
        yield last.to_bytes(8, "little")
    yield b""


def _run(command: list[str], folder: Path) -> tuple[float, float, float]:
    """Run a program to its end; return CPU and wall time in s and its peak memory in MB. Raises ToolError."""
    began = time.perf_counter()
    with (folder / "output.txt").open("wb") as output:
        process = subprocess.Popen(  # noqa: S603 - a program of the user's own system, by a fixed name
            command, cwd=folder, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT
        )
        _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        said = (folder / "output.txt").read_text(encoding="utf-8", errors="replace").strip().splitlines()
        reason = next((line for line in said if "Message:" in line), said[-1] if said else "it said nothing")
        raise ToolError(f"{command[0]} ended with {process.returncode}: {reason.strip()[:200]}")
    return usage.ru_utime + usage.ru_stime, time.perf_counter() - began, usage.ru_maxrss * 1024e-6


def _score(estimated: Path, stamps: list[int], relations: tuple[Path, ...]) -> tuple[RelationScore | None, str]:
    """Return the errors of its path: its rows are pairs, for odometry and scan, in the order of the log."""
    rows = np.loadtxt(estimated, ndmin=2)
    if len(rows) != 2 * len(stamps):
        return None, f"{len(rows)} poses for {len(stamps)} scans: not scored"
    first = np.concatenate([[True], np.diff(stamps) > 0])
    trajectory = Trajectory(np.array(stamps, dtype=np.int64)[first], rows[1::2, 1:4][first])
    return score_by_relations(trajectory, relations), "wheels as guess, no loops, its demo settings"
