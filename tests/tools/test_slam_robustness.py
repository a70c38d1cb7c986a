from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from drivers.messages import LaserScan, Odometry
from mapping import se2
from mapping.graph_slam import GraphSettings
from mapping.mount import Mount
from mapping.relations import Relations
from mapping.slam import Mapper, MappingSettings
from mapping.trajectory import Trajectory
from tools.input_faults import FaultyLog
from tools.simulator import SimulatedLidar, drive_along
from tools.slam_robustness import SoundLog, evaluate_robustness, fault_row
from tools.world import office

SCANS_PER_S = 4
BEARINGS_CW = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False)
# Through the corridor and two rooms and back again: 35 m, of which the last 15 were seen before.
TOUR = (
    (5.8, 5.7), (8.0, 5.8), (10.2, 5.5), (11.3, 6.1), (11.6, 7.1), (11.5, 8.6), (11.9, 9.8), (13.1, 9.9), (13.8, 8.8),
    (13.2, 7.7), (12.0, 7.2), (11.4, 6.4), (10.6, 5.7), (9.0, 5.7), (8.1, 5.8), (7.4, 6.2), (7.0, 6.9), (6.7, 7.7),
    (6.0, 8.5), (5.0, 8.9), (3.9, 9.2), (2.9, 9.4), (1.6, 9.3), (0.9, 8.5), (1.3, 7.5), (2.3, 7.1), (2.9, 6.2),
    (3.9, 5.7), (5.6, 5.75), (8.0, 5.8), (10.2, 5.6),
)  # fmt: skip


@cache
def drive() -> tuple[list[LaserScan | Odometry], Trajectory]:
    """Scans without a sweep and odometry of a simulated drive through the office, and where the car was."""
    path = drive_along(TOUR, speed_mps=0.6)
    stamps = np.arange(0, path.stamps_ns[-1], round(1e9 / SCANS_PER_S), dtype=np.int64)
    truth = Trajectory(stamps, path.at(stamps))
    lidar = SimulatedLidar(office(), path, Mount(), start_delay_s=0.0, seed=4)
    messages: list[LaserScan | Odometry] = []
    for stamp, pose in zip(stamps.tolist(), se2.between(truth.poses[0], truth.poses), strict=True):
        ranges = lidar(np.full(len(BEARINGS_CW), stamp), BEARINGS_CW)
        messages.append(Odometry(stamp, pose, np.zeros(3)))
        messages.append(LaserScan(stamp, -BEARINGS_CW, ranges, np.zeros(len(ranges)), 0.15, 12.0))
    return messages, truth


def relations() -> Relations:
    """True relative poses of scans 1, 6 and 30 s apart."""
    _, truth = drive()
    first = np.concatenate([np.arange(0, len(truth) - step, 7) for step in (5, 25, 125)])
    second = np.concatenate([np.arange(0, len(truth) - step, 7) + step for step in (5, 25, 125)])
    return Relations(
        truth.stamps_ns[first], truth.stamps_ns[second], se2.between(truth.poses[first], truth.poses[second])
    )


def sound_log(settings: MappingSettings) -> SoundLog:
    return SoundLog(drive()[0], settings, Mount())


def mapped(messages: list[LaserScan | Odometry], settings: MappingSettings) -> Mapper:
    mapper = Mapper(settings, Mount())
    for message in messages:
        mapper.add_scan(message) if isinstance(message, LaserScan) else mapper.add_odometry(message)
    mapper.finish()
    return mapper


def test_wrong_closures_do_not_bend_a_simulated_map() -> None:
    report = evaluate_robustness(sound_log(MappingSettings()), relations(), ["closures"], 0, lambda _: None)
    sound, *wrong = report["closures"]
    assert sound["injected"] == 0
    assert sound["refined_m"] < 0.02
    assert [row["injected"] for row in wrong] == [100, 10, 10, 10, 10, 10]
    assert not any(row["wrong_believed"] or row["real_withdrawn"] or row["bent"] for row in wrong)


def test_closures_that_are_believed_whatever_they_say_are_seen_to_bend_it() -> None:
    credulous = GraphSettings()
    credulous = replace(
        credulous,
        loops=replace(credulous.loops, kernels=(1e9,), withdrawn_chi2=np.inf),
        refinement=replace(credulous.refinement, gates_m=(0.1,)),
    )
    log = sound_log(replace(MappingSettings(), graph=credulous))
    rows = evaluate_robustness(log, relations(), ["closures"], 0, lambda _: None)["closures"]
    assert all(row["bent"] and row["wrong_believed"] == row["injected"] for row in rows[1:])


def test_a_map_that_follows_lying_wheels_is_called_bent() -> None:
    messages, truth = drive()
    wheels_only = replace(MappingSettings(), wheels_only=True, graph=GraphSettings(loop_closure=False))
    middle = int(truth.stamps_ns[len(truth) // 2])
    turned = np.array([0.0, 0.0, 0.3])  # the wheels slip once: a turn that nobody sees
    slipped = [
        replace(message, pose=se2.compose(turned, message.pose))
        if isinstance(message, Odometry) and message.stamp_ns > middle
        else message
        for message in messages
    ]
    honest = fault_row(mapped(messages, wheels_only), FaultyLog(messages, []), truth, relations())
    assert (honest["verdict"], honest["bent"]) == ("usable", False)
    bent = fault_row(mapped(slipped, wheels_only), FaultyLog(slipped, [(middle, middle)]), truth, relations())
    assert (bent["verdict"], bent["bent"]) == ("BENT", True)


def test_what_is_not_in_the_map_is_named_and_does_not_count() -> None:
    messages, truth = drive()
    first, last = (int(truth.stamps_ns[len(truth) * share // 10]) for share in (4, 7))
    # No wheels, and the laser sees nothing for a third of the drive: nothing can tell where the rest belongs.
    blind = [
        replace(message, ranges_m=np.zeros(len(BEARINGS_CW))) if first <= message.stamp_ns <= last else message
        for message in messages
        if isinstance(message, LaserScan)
    ]
    no_loops = replace(MappingSettings(), graph=GraphSettings(loop_closure=False))
    mapper = mapped([*blind], no_loops)
    mapper.refine()
    row = fault_row(mapper, FaultyLog([*blind], [(first, last)]), truth, relations())
    assert (row["verdict"], row["bent"], row["times_lost"]) == ("part lost, rest usable", False, 1)
    (lost,) = row["not_in_map"]
    end_s = (truth.stamps_ns[-1] - truth.stamps_ns[0]) * 1e-9
    assert lost["from_s"] > (last - truth.stamps_ns[0]) * 1e-9
    assert lost["to_s"] == pytest.approx(end_s)
    assert row["scans_in_map"] <= len(truth) * 0.4 + 1
    assert row["relations"] < len(relations())
