"""`evaluate robustness`: what wrong loop closures and faults of the input do to the map of a log with ground truth.

Errors are of the relations metric, over what is in the map: a piece of the drive whose place is not known is named as
lost and does not count. A fault's map is compared with the sound log's over the same relations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.messages import LaserScan, Odometry
from drivers.recording_reader import open_recording
from mapping.loop_closure import Closure
from mapping.mount import Mount
from mapping.relations import Relations, relation_errors
from mapping.slam import Mapper, MappingSettings
from mapping.sweep import reverse_sweep
from mapping.trajectory import Trajectory
from tools.config import Config
from tools.errors import ToolError
from tools.input_faults import FAULTS, FaultyLog, Messages
from tools.pipeline import LidarDecoding, look_ahead
from tools.results import Report
from tools.wrong_closures import agreeing_closures, random_closures

RANDOM_CLOSURES, GROUPS, GROUP_SIZE = 100, 5, 10
MOST_CHANGE = 0.10  # of the error, by wrong closures
# A map with a fault in its log is bent when its errors grow more than by half and by what follows: a look that is
# missing or half blind costs accuracy, which is no bend.
MOST_GROWTH, FREE_M, FREE_DEG = 0.5, 0.01, 0.1

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class SoundLog:
    """A log as it was recorded, and what maps it."""

    messages: Messages
    settings: MappingSettings
    mount: Mount


def read_log(path: Path, config: Config, seconds: float | None = None) -> SoundLog:
    """Read scans and odometry, only the first seconds if given.

    Raises RecordingError, or ToolError where there is no scan in it.
    """
    with open_recording(path) as recording:
        topic = config.replay.scan_topic
        setup = look_ahead(recording.messages(topic), config)
        decoding = LidarDecoding()
        messages: list[LaserScan | Odometry] = []
        for message in recording.messages(topic):
            for decoded in decoding.feed(message):
                if isinstance(decoded, LaserScan):
                    messages.append(reverse_sweep(decoded) if setup.sweep.is_reversed else decoded)
                elif isinstance(decoded, Odometry):
                    messages.append(decoded)
    if not any(isinstance(message, LaserScan) for message in messages):
        raise ToolError(f"{path}: no scan in it: give a log with laser scans")
    end_ns = np.inf if seconds is None else messages[0].stamp_ns + seconds * 1e9
    kept = [message for message in messages if message.stamp_ns <= end_ns]
    return SoundLog(kept, config.mapping_settings(), setup.mount)


def evaluate_robustness(
    log: SoundLog, relations: Relations, parts: Sequence[str], seed: int, on_progress: Progress
) -> Report:
    """Map the sound log, then each case of the parts, 'closures' and 'faults'; return a row for each."""
    mapper = _mapped(log.messages, log)
    report: Report = {"seed": seed, "scans": mapper.counters.mapped}
    if "closures" in parts:
        report["closures"] = _closure_rows(mapper, relations, seed, on_progress)
    if "faults" in parts:
        mapper.refine()
        report["faults"] = _fault_rows(log, mapper.trajectory, relations, seed, on_progress)
    return report


def _mapped(messages: Messages, log: SoundLog) -> Mapper:
    mapper = Mapper(log.settings, log.mount)
    for message in messages:
        if isinstance(message, LaserScan):
            mapper.add_scan(message)
        else:
            mapper.add_odometry(message)
    mapper.finish()
    return mapper


def _closure_rows(mapper: Mapper, relations: Relations, seed: int, on_progress: Progress) -> list[Report]:
    """Return a row for the graph without, and with each kind of, wrong closures: settled anew and refined."""
    graph = mapper.graph
    poses, real = graph.keyframe_poses, graph.closures
    cases: list[tuple[str, tuple[Closure, ...]]] = [
        ("none", ()),
        (f"{RANDOM_CLOSURES} random", random_closures(poses, real, RANDOM_CLOSURES, seed)),
    ]
    for group in range(1, GROUPS + 1):
        wrong = agreeing_closures(poses, real, GROUP_SIZE, seed + group)
        cases.append((f"{GROUP_SIZE} that agree, group {group}", wrong))
    rows: list[Report] = []
    for name, wrong in cases:
        tried = graph.with_closures(wrong)
        settled = relation_errors(tried.trajectory(), relations)
        believed = {id(closure) for closure in tried.closures}  # the refinement replaces what it has learned from
        tried.refine()
        refined = relation_errors(tried.trajectory(), relations)
        row: Report = {
            "case": name,
            "injected": len(wrong),
            "wrong_believed": sum(id(closure) in believed for closure in wrong),
            "real_withdrawn": sum(id(closure) not in believed for closure in real),
            "graph_m": settled.mean_m,
            "graph_deg": settled.mean_deg,
            "refined_m": refined.mean_m,
            "refined_deg": refined.mean_deg,
        }
        sound = rows[0] if rows else row
        changes = {key: row[key] / sound[key] - 1.0 for key in ("graph_m", "graph_deg", "refined_m", "refined_deg")}
        row["change"] = max(changes.values(), key=abs)
        row["bent"] = bool(max(map(abs, changes.values())) >= MOST_CHANGE)
        rows.append(row)
        on_progress(f"{name}: {row['refined_m']:.4f} m, {row['refined_deg']:.3f} deg, change {row['change']:+.1%}")
    return rows


def _fault_rows(
    log: SoundLog, sound: Trajectory, relations: Relations, seed: int, on_progress: Progress
) -> list[Report]:
    """Return a row for each fault, the refined map of the sound log being `sound`."""
    rows: list[Report] = []
    for number, (name, fault) in enumerate(FAULTS.items()):
        faulty = fault(log.messages, sound, np.random.default_rng([seed, number]))
        mapper = _mapped(faulty.messages, log)
        mapper.refine()
        row = {"case": name} | fault_row(mapper, faulty, sound, relations)
        rows.append(row)
        on_progress(f"{name}: {row['verdict']}")
    return rows


def fault_row(mapper: Mapper, faulty: FaultyLog, sound: Trajectory, relations: Relations) -> Report:
    """Return the verdict on a map of a faulty log, against the sound log's map over the same relations."""
    mapped = faulty.in_true_time(mapper.trajectory)
    start_ns = int(sound.stamps_ns[0])
    lost = [
        {"from_s": _seconds(faulty, segment.start_ns, start_ns), "to_s": _seconds(faulty, segment.end_ns, start_ns)}
        for segment in mapper.graph.segments()
        if not segment.in_map
    ]
    row: Report = {
        "scans_in_map": len(mapped),
        "unmatched": mapper.counters.unmatched,
        "rescued": mapper.counters.rescued,
        "times_lost": mapper.counters.lost,
        "disturbed": [{"from_s": (a - start_ns) * 1e-9, "to_s": (b - start_ns) * 1e-9} for a, b in faulty.windows],
        "not_in_map": lost,
    }
    errors = relation_errors(mapped, relations)
    same = relation_errors(_only(sound, mapped), relations)
    bent = (
        errors.mean_m > (1.0 + MOST_GROWTH) * same.mean_m + FREE_M
        or errors.mean_deg > (1.0 + MOST_GROWTH) * same.mean_deg + FREE_DEG
    )
    row |= {
        "relations": errors.relations,
        "mean_m": errors.mean_m,
        "max_m": errors.max_m,
        "mean_deg": errors.mean_deg,
        "max_deg": errors.max_deg,
        "sound_mean_m": same.mean_m,
        "sound_mean_deg": same.mean_deg,
        "bent": bool(bent),
        "verdict": "BENT" if bent else "part lost, rest usable" if lost else "usable",
    }
    return row


def _seconds(faulty: FaultyLog, stamp_ns: int, start_ns: int) -> float:
    return (faulty.true_ns.get(stamp_ns, stamp_ns) - start_ns) * 1e-9


def _only(trajectory: Trajectory, other: Trajectory) -> Trajectory:
    """Return the poses at the instants that the other one has too."""
    shared = np.isin(trajectory.stamps_ns, other.stamps_ns)
    return Trajectory(trajectory.stamps_ns[shared], trajectory.poses[shared])
