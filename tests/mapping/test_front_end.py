from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest

from drivers.messages import LaserScan, Odometry
from mapping import se2
from mapping.front_end import FrontEnd, FrontEndSettings, TrackedScan
from mapping.graph_slam import GraphSettings, GraphSlam
from mapping.match_doubt import DoubtSettings
from mapping.mount import Mount

ALONG = ((9.0, (0.5, 0.0, 0.0)),)
START = (6.0, 4.8, 0.0)


def track(
    messages: Iterable[LaserScan | Odometry], settings: FrontEndSettings | None = None
) -> tuple[FrontEnd, list[TrackedScan]]:
    front, tracked = FrontEnd(settings or FrontEndSettings(), Mount()), []
    for message in messages:
        tracked += front.add_scan(message) if isinstance(message, LaserScan) else front.add_odometry(message)
    return front, tracked + front.finish()


def off_m(tracked: list[TrackedScan], drive) -> np.ndarray:
    """How far (N,) each pose lies from the truth, as seen from the first."""
    truth = drive.truth.at(np.array([scan.stamp_ns for scan in tracked]))
    poses = np.array([scan.match.pose for scan in tracked])
    return np.hypot(*(poses - se2.between(truth[0], truth))[:, :2].T)


@pytest.fixture(scope="module")
def along(simulate_drive: Callable, building):
    """Nine seconds at 0.5 m/s along the corridor, past doors."""
    return simulate_drive(ALONG, start=START, occupied=building.occupied, samples=360)


def test_keyframes_come_by_distance_and_by_turn_and_their_links_lead_along_the_drive(winding) -> None:
    front, tracked = track(winding.scans)
    keyframes = [scan for scan in tracked if scan.keyframe is not None]
    assert len(front.keyframes) == len(keyframes)
    assert [scan.keyframe.number for scan in keyframes] == list(range(len(keyframes)))
    assert [scan.keyframe.connected for scan in keyframes] == [False] + [True] * (len(keyframes) - 1)
    truth = winding.truth.at(np.array([scan.stamp_ns for scan in keyframes]))
    steps = se2.between(truth[:-1], truth[1:])
    # Each step is the distance or the turn of a keyframe and at most one scan's motion (4 cm, 6 deg) more.
    assert np.all((np.hypot(*steps[:, :2].T) > 0.22) | (np.abs(steps[:, 2]) > 0.15))
    assert np.hypot(*steps[:, :2].T).max() < 0.25 + 0.06
    assert np.abs(steps[:, 2]).max() < 0.175 + 0.12
    off = se2.between(steps, np.array([scan.keyframe.T_previous_this for scan in keyframes[1:]]))
    assert np.hypot(*off[1:, :2].T).max() < 0.03
    for scan in keyframes[1:]:
        information = scan.keyframe.information
        assert np.linalg.eigvalsh(information)[0] > 0.05**-2  # no worse than the prior


def test_a_scan_that_is_no_keyframe_leaves_no_trace_in_the_store(along) -> None:
    front, tracked = track(along.scans[:3])
    assert (len(tracked), len(front.keyframes)) == (3, 1)
    np.testing.assert_allclose(
        np.sort(np.hypot(*front.keyframes.snapshot().points_of(0).T)),
        np.sort(np.hypot(*tracked[0].points.T)),
        atol=1e-5,
    )


def test_tracking_twice_gives_the_same_bits(along) -> None:
    (_, one), (_, again) = track(along.scans[:40]), track(along.scans[:40])
    np.testing.assert_array_equal([scan.match.pose for scan in one], [scan.match.pose for scan in again])


def test_two_seconds_without_scans_are_bridged(along) -> None:
    """The robot has driven on by 1 m: farther than the scan match reaches from where its last speed says."""
    scans = [*along.scans[:40], *along.scans[60:]]
    front, tracked = track(scans)
    assert (front.counters.lost, len(tracked)) == (0, len(scans))
    assert front.counters.rescued >= 1
    assert off_m(tracked, along)[-20:].max() < 0.06


def test_two_seconds_without_sight_are_bridged(along) -> None:
    blind = [replace(scan, ranges_m=np.zeros(360)) if 40 <= n < 60 else scan for n, scan in enumerate(along.scans)]
    front, tracked = track(blind)
    assert (front.counters.lost, front.counters.unmatched) == (0, 20)
    assert not any(scan.match.accepted for scan in tracked[40:60])
    assert off_m(tracked, along)[-20:].max() < 0.06


def test_scans_that_come_in_bursts_are_tracked_without_wheels(along) -> None:
    """Three scans within milliseconds, then nothing: a velocity over such an interval means nothing."""
    first_ns = along.scans[0].stamp_ns
    bursts = [
        replace(scan, stamp_ns=first_ns + 300_000_000 * (n // 3 + 1) + 1_000_000 * (n % 3), offsets_s=np.zeros(360))
        for n, scan in enumerate(along.scans)
    ]
    front, tracked = track(bursts)
    assert (front.counters.mapped, front.counters.lost) == (len(bursts), 0)
    truth = along.truth.at(np.array([scan.stamp_ns for scan in along.scans]))
    poses = np.array([scan.match.pose for scan in tracked])
    assert np.hypot(*(poses - se2.between(truth[0], truth))[:, :2].T).max() < 0.08


def test_a_velocity_that_misleads_gives_way_to_standing_still(along) -> None:
    """The robot stops dead from a good speed; the guess of its velocity is off by more than is believed unasked."""
    standing = [replace(along.scans[40], stamp_ns=scan.stamp_ns) for scan in along.scans[41:60]]
    front, tracked = track([*along.scans[:41:8], *standing])
    assert (front.counters.lost, front.counters.unmatched) == (0, 0)
    assert all(scan.match.accepted for scan in tracked)


def test_without_rescue_the_same_gap_would_end_the_tracking(along) -> None:
    scans = [*along.scans[:40], *along.scans[60:]]
    narrow = DoubtSettings(rescue_m=0.0, rescue_m_per_s=0.0, rescue_rad=0.0, rescue_rad_per_s=0.0)
    front, tracked = track(scans, FrontEndSettings(doubt=narrow))
    assert front.counters.rescued == 0
    assert front.counters.unmatched > 10 or off_m(tracked, along)[-20:].max() > 0.3


@pytest.mark.parametrize("nothing", [0.0, np.nan, np.inf])
def test_thirty_percent_invalid_ranges_do_no_harm(nothing: float, along) -> None:
    generator = np.random.default_rng(9)
    scans = [
        replace(scan, ranges_m=np.where(generator.random(360) < 0.3, nothing, scan.ranges_m)) for scan in along.scans
    ]
    front, tracked = track(scans)
    assert front.counters.mapped == len(scans)
    assert off_m(tracked, along).max() < 0.06


def test_one_stamp_from_the_future_is_taken_back(along) -> None:
    scans = list(along.scans[:30])
    scans[12] = replace(scans[12], stamp_ns=scans[12].stamp_ns + 10**15)
    front, tracked = track(scans)
    assert [scan.retracted for scan in tracked if scan.retracted] == [1]
    assert (front.counters.skipped_out_of_order, front.counters.mapped) == (3, 27)
    # Two more went by until it was plain whose stamp was wrong.
    (taken_back,) = (number for number, scan in enumerate(tracked) if scan.stamp_ns > along.truth.stamps_ns[-1])
    assert tracked[taken_back + 1].retracted == 1
    sound = tracked[:taken_back] + tracked[taken_back + 1 :]
    assert off_m(sound, along).max() < 0.06


def test_with_wheels_only_the_chain_is_that_of_the_wheels(winding) -> None:
    messages = sorted([*winding.scans, *winding.odometry], key=lambda message: message.stamp_ns)
    front, tracked = track(messages, FrontEndSettings(wheels_only=True))
    assert front.counters.rescued == front.counters.lost == 0
    poses = [np.zeros(3)]
    for scan in tracked[1:]:
        if scan.keyframe is not None:
            poses.append(se2.compose(poses[-1], scan.keyframe.T_previous_this))
    keyframes = [scan.match.pose for scan in tracked if scan.keyframe is not None]
    np.testing.assert_allclose(poses, keyframes, atol=1e-9)


# A robot that is carried away


def mapped(scans: Iterable[LaserScan]) -> tuple[FrontEnd, GraphSlam]:
    front = FrontEnd(FrontEndSettings(), Mount())
    graph = GraphSlam(GraphSettings(), front.keyframes)
    for scan in scans:
        for tracked in front.add_scan(scan):
            graph.add(tracked)
    graph.finish()
    return front, graph


def later(scans: Iterable[LaserScan], seconds: float) -> list[LaserScan]:
    return [replace(scan, stamp_ns=scan.stamp_ns + round(seconds * 1e9)) for scan in scans]


def out_of_the_room(speed: float) -> list[tuple[float, tuple[float, float, float]]]:
    """From (8.4, 2.6) through the room, out of its door and along the corridor to the corner."""
    turn_s, turn = 0.6 * np.pi / 2.0 / speed, speed / 0.6
    return [
        (1.9 / speed, (speed, 0.0, 0.0)),
        (turn_s, (speed, 0.0, turn)),
        (1.0 / speed, (speed, 0.0, 0.0)),
        (turn_s, (speed, 0.0, -turn)),
        (3.1 / speed, (speed, 0.0, 0.0)),
    ]


@pytest.fixture(scope="module")
def first_visit(simulate_drive: Callable, building):
    """Out of the room, around the corner of the corridor and up: 20 s."""
    legs = (*out_of_the_room(0.6), (np.pi / 2.0, (0.6, 0.0, 1.0)), (3.2 / 0.6, (0.6, 0.0, 0.0)))
    return simulate_drive(legs, start=(8.4, 2.6, 0.0), occupied=building.occupied, samples=360)


def test_a_kidnapped_robot_is_tied_to_the_map_at_its_right_place(first_visit, simulate_drive, building) -> None:
    back = simulate_drive(out_of_the_room(0.4), start=(8.4, 2.6, 0.0), occupied=building.occupied, samples=360)
    count = len(first_visit.scans)
    front, graph = mapped([*first_visit.scans, *later(back.scans, 21.0)])
    assert front.counters.lost == 1
    one, other = graph.segments()
    assert (one.in_map, other.in_map) == (True, True)
    poses = graph.trajectory()
    off = np.hypot(*(poses.poses - _truth_of(poses.stamps_ns, first_visit, back, 21.0))[:, :2].T)
    assert off[:count].max() < 0.08
    assert off[poses.stamps_ns >= other.start_ns].max() < 0.1


def test_a_kidnapped_robot_in_an_unknown_place_bends_no_map(first_visit, simulate_drive) -> None:
    elsewhere = simulate_drive([(14.0, (0.3, 0.0, 0.1))], samples=360)
    front, graph = mapped([*first_visit.scans, *later(elsewhere.scans, 21.0)])
    assert front.counters.lost >= 1
    segments = graph.segments()
    assert [segment.in_map for segment in segments] == [True] + [False] * (len(segments) - 1)
    poses = graph.trajectory()
    mine = poses.stamps_ns < first_visit.scans[-1].stamp_ns
    truth = _truth_of(poses.stamps_ns, first_visit, first_visit, 0.0)
    assert np.hypot(*(poses.poses - truth)[mine, :2].T).max() < 0.08


def _truth_of(stamps_ns: np.ndarray, one, other, seconds: float) -> np.ndarray:
    """Where the car was at the stamps (N,), as seen from its first scan: in one drive, then in the other."""
    start = one.truth.at(stamps_ns[:1])[0]
    begins = other.scans[0].stamp_ns + round(seconds * 1e9)
    in_other = other.truth.at(stamps_ns - round(seconds * 1e9))
    return se2.between(start, np.where((stamps_ns < begins)[:, None], one.truth.at(stamps_ns), in_other))


# Corridors


@pytest.fixture(scope="module")
def corridor(simulate_drive: Callable, carved):
    """22 m at 0.8 m/s along a corridor: a door frame every few metres, and 9 m of plain wall; its ends are far."""
    niches = [
        (x, y, x + 0.9, y + 0.16) for x, y in ((5.0, 16.08), (8.5, 13.76), (12.3, 16.08), (24.5, 13.76), (28.0, 16.08))
    ]
    hall = carved(60.0, 30.0, (2.0, 13.9, 58.0, 16.1), *niches)
    return simulate_drive(((27.5, (0.8, 0.0, 0.0)),), start=(6.0, 15.0, 0.0), occupied=hall, samples=360)


def slid_m(tracked: list[TrackedScan], drive) -> float:
    """How much longer than it was the way along the corridor has become."""
    truth = drive.truth.at(np.array([tracked[-1].stamp_ns]))[0]
    return float(tracked[-1].match.pose[0] - (truth[0] - drive.truth.poses[0, 0]))


def test_a_corridor_does_not_slide_without_wheels(corridor) -> None:
    _, held = track(corridor.scans)
    assert abs(slid_m(held, corridor)) < 0.25
    settings = FrontEndSettings()
    _, clinging = track(corridor.scans, replace(settings, keyframes=replace(settings.keyframes, open_share=0.0)))
    assert abs(slid_m(clinging, corridor)) > 1.0  # point to point: the way becomes shorter with every scan


def test_a_corridor_does_not_slide_with_wheels(corridor) -> None:
    messages = sorted([*corridor.scans, *corridor.odometry], key=lambda message: message.stamp_ns)
    _, tracked = track(messages)
    assert abs(slid_m(tracked, corridor)) < 0.1


def narrow(scans: Iterable[LaserScan]) -> list[LaserScan]:
    """What a sensor sees that looks 43 deg to either side."""
    kept = []
    for scan in scans:
        ahead = np.abs(se2.wrap_angle(scan.angles_rad)) < np.radians(43.0)
        arrays = (scan.angles_rad[ahead], scan.ranges_m[ahead], np.zeros(int(ahead.sum())))
        middle_ns = scan.stamp_ns + round(float(np.median(scan.offsets_s[ahead])) * 1e9)
        kept.append(LaserScan(middle_ns, *arrays, scan.range_min_m, scan.range_max_m))
    return kept


def wheels_of(drive, way: float, turn: float, every_ns: int = 50_000_000) -> list[Odometry]:
    """Odometry whose ways and turns are too long by these factors."""
    stamps = np.arange(drive.truth.stamps_ns[0], drive.truth.stamps_ns[-1], every_ns)
    steps = se2.log(se2.between(drive.truth.at(stamps)[:-1], drive.truth.at(stamps)[1:])) * (way, way, turn)
    poses = [se2.IDENTITY]
    for step in steps:
        poses.append(se2.compose(poses[-1], se2.exp(step)))
    return [Odometry(stamp, pose, np.zeros(3)) for stamp, pose in zip(stamps.tolist(), poses, strict=True)]


def by_stamps(*kinds: Iterable[LaserScan | Odometry]) -> list[LaserScan | Odometry]:
    return sorted((message for kind in kinds for message in kind), key=lambda message: message.stamp_ns)


def test_a_narrow_view_is_tied_to_wheels_and_better_than_either_alone(winding) -> None:
    scans, wheels = narrow(winding.scans), wheels_of(winding, 1.0, 1.1)
    _, tracked = track(by_stamps(scans, wheels))
    assert sum(scan.wheel_guess for scan in tracked) > 0.9 * len(scans)
    _, by_wheels = track(by_stamps(scans, wheels), FrontEndSettings(wheels_only=True))
    _, by_sight = track(scans)
    assert off_m(tracked, winding).max() < 0.15
    assert off_m(tracked, winding).max() < 0.6 * off_m(by_wheels, winding).max()
    assert off_m(tracked, winding).max() < 0.3 * off_m(by_sight, winding).max()


def test_wheels_that_contradict_what_a_narrow_view_sees_are_noticed(winding) -> None:
    """For 2 s of a turn the wheels say that the robot stands."""
    wheels = wheels_of(winding, 1.0, 1.0)
    begin_ns, end_ns = (winding.truth.stamps_ns[0] + second * 10**9 for second in (3, 5))
    stood = next(message.pose for message in wheels if message.stamp_ns >= begin_ns)
    lying = [replace(m, pose=stood) if begin_ns <= m.stamp_ns < end_ns else m for m in wheels]
    honest, lied_to = (track(by_stamps(narrow(winding.scans), each))[0] for each in (wheels, lying))
    assert honest.counters.unmatched == honest.counters.rescued == 0
    assert lied_to.counters.unmatched + lied_to.counters.rescued >= 5
