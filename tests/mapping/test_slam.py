from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.messages import LaserScan, Odometry
from mapping import se2
from mapping.metrics import absolute_trajectory_error
from mapping.mount import Mount
from mapping.slam import MappedScan, Mapper, MappingSettings

FloatArray = NDArray[np.float64]

SIDEWAYS = Mount(np.array([-0.04, 0.0, np.pi / 2]))
UPSIDE_DOWN = Mount(np.array([0.1, 0.05, -0.7]), inverted=True)
START_NS = 1_700_000_000_000_000_000


def map_messages(
    messages: Iterable[LaserScan | Odometry], mount: Mount | None = None, settings: MappingSettings | None = None
) -> tuple[Mapper, list[MappedScan]]:
    mapper = Mapper(settings or MappingSettings(), mount or Mount())
    mapped: list[MappedScan] = []
    for message in messages:
        mapped += mapper.add_scan(message) if isinstance(message, LaserScan) else mapper.add_odometry(message)
    return mapper, mapped + mapper.finish()


def as_received(drive) -> list[LaserScan | Odometry]:
    """The messages in the order in which they come: a scan when its turn is over."""

    def end_ns(message: LaserScan | Odometry) -> float:
        return message.stamp_ns + (1e9 * message.offsets_s[-1] if isinstance(message, LaserScan) else 0.0)

    return sorted([*drive.scans, *drive.odometry], key=end_ns)


@pytest.mark.parametrize("mount", [Mount(), SIDEWAYS, UPSIDE_DOWN], ids=["centred", "sideways", "upside down"])
@pytest.mark.parametrize("with_wheels", [False, True], ids=["laser only", "with wheels"])
def test_a_simulated_drive_is_recovered_for_the_robot_not_the_laser(
    mount: Mount, with_wheels: bool, simulate_drive: Callable
) -> None:
    legs = ((1, (0.4, 0, 0)), (2, (0.4, 0, 0.5)), (2, (0.4, 0, -1)), (2.5, (0.4, 0, 1)), (1.5, (0.4, 0, 0.2)))
    drive = simulate_drive(legs, mount=mount)
    mapper, mapped = map_messages(as_received(drive) if with_wheels else drive.scans, mount)
    assert len(mapped) == mapper.counters.mapped == len(drive.scans)
    error = absolute_trajectory_error(mapper.trajectory, drive.truth, align=False)
    # Ranges carry 1 cm of noise and walls are sampled every few cm: a few millimetres an estimate. The first scan
    # cannot be de-skewed (its motion is unknown, 4 cm over the turn), which shifts the frame by up to half of that.
    assert error.rms_m < 0.02
    assert error.max_m < 0.05
    assert error.mean_deg < 0.5
    assert error.max_deg < 2.0  # where the turn rate jumps by 2 rad/s, one scan is de-skewed with the old one


def test_mapping_the_same_messages_twice_gives_the_same_bits(winding) -> None:
    first, _ = map_messages(as_received(winding))
    again, _ = map_messages(as_received(winding))
    np.testing.assert_array_equal(first.trajectory.stamps_ns, again.trajectory.stamps_ns)
    np.testing.assert_array_equal(first.trajectory.poses, again.trajectory.poses)
    np.testing.assert_array_equal(first.grid().log_odds, again.grid().log_odds)
    np.testing.assert_array_equal(first.grid().origin, again.grid().origin)


def test_the_map_is_the_room(winding, room: NDArray[np.bool_]) -> None:
    mapper, _ = map_messages(winding.scans)
    grid = mapper.grid()
    first_pose = winding.truth.at(mapper.trajectory.stamps_ns[:1])[0]

    def room_at(rows: NDArray[np.intp], cols: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return the room's cells (N, 81) within 8 cm of each cell's centre."""
        points = se2.transform_points(first_pose, grid.cell_centers(rows, cols))
        cells = np.floor(points / 0.02).astype(int)
        steps = np.stack(np.meshgrid(range(-4, 5), range(-4, 5)), axis=-1).reshape(-1, 2)
        around = np.clip(cells[:, np.newaxis] + steps, 0, [399, 299])
        return room[around[..., 1], around[..., 0]]

    walls = room_at(*np.nonzero(grid.occupied))
    free = room_at(*np.nonzero(grid.free))
    # 8 cm = half a cell's diagonal (3.5 cm) + three sigma of the range (3 cm) + the drift stated above. The turn rate
    # jumps by up to 2 rad/s, where one scan is a degree off: walls 5 m away are drawn 9 cm off, some into the solid.
    assert walls.any(axis=1).mean() > 0.99
    assert (~walls).any(axis=1).mean() > 0.95
    assert (~free).any(axis=1).mean() > 0.999
    assert np.count_nonzero(grid.free) * 0.05**2 > 0.7 * np.count_nonzero(~room) * 0.02**2


def test_stamps_are_the_middle_of_the_turns(winding) -> None:
    _, mapped = map_messages(winding.scans[:5])
    for scan, result in zip(winding.scans, mapped, strict=False):
        assert result.stamp_ns == scan.stamp_ns + round(scan.offsets_s[-1] / 2.0 * 1e9)


def test_stating_the_wrong_mount_yields_the_lasers_path(simulate_drive: Callable) -> None:
    drive = simulate_drive([(2.0, (0.4, 0.0, 0.0))], mount=SIDEWAYS)
    as_robot, _ = map_messages(drive.scans, SIDEWAYS)
    as_laser, _ = map_messages(drive.scans, Mount())
    # 0.4 m/s from the middle of the first turn to that of the last, 1.9 s later, for 2 cm of error.
    assert as_robot.trajectory.poses[-1][:2] == pytest.approx([0.76, 0.0], abs=0.02)
    assert as_laser.trajectory.poses[-1][:2] == pytest.approx([0.0, -0.76], abs=0.02)


def test_a_standing_robot_stays(simulate_drive: Callable) -> None:
    drive = simulate_drive([(2.0, (0.0, 0.0, 0.0))])
    mapper, _ = map_messages(drive.scans)
    # The local map keeps points 16 cm apart, so that the first scans fit it to about 1 cm even without noise.
    assert np.abs(mapper.trajectory.poses[:, :2]).max() < 0.02
    assert np.abs(mapper.trajectory.poses[:, 2]).max() < np.radians(0.5)


def test_space_is_cleared_from_the_laser_not_from_the_axle() -> None:
    ahead = np.linspace(-0.5, 0.5, 60)
    scan = LaserScan(START_NS, ahead, np.full(60, 3.0), np.zeros(60), 0.15, 12.0)
    mapper, _ = map_messages([scan], Mount(np.array([1.0, 0.5, 0.0])))
    known = mapper.grid().cell_centers(*np.nonzero(mapper.grid().known))
    nearest = known[np.argmin(known[:, 0])]
    assert nearest == pytest.approx([1.0, 0.5], abs=0.05)  # one cell


# Wheel odometry


def test_a_scan_waits_for_the_odometry_of_its_time(winding) -> None:
    mapper = Mapper(MappingSettings(), Mount())
    first, second = winding.scans[:2]
    mapper.add_odometry(winding.odometry[0])
    assert mapper.add_scan(first) == []
    waited: list[MappedScan] = []
    for message in winding.odometry[1:]:
        done = mapper.add_odometry(message)
        if done:
            waited = done
            break
        assert message.stamp_ns < first.stamp_ns + round(first.offsets_s[-1] * 1e9)
    assert [result.stamp_ns for result in waited] == [first.stamp_ns + round(first.offsets_s[-1] / 2.0 * 1e9)]
    assert mapper.add_scan(second) == []
    assert len(mapper.finish()) == 1


def test_without_any_odometry_a_scan_does_not_wait(winding) -> None:
    mapper = Mapper(MappingSettings(), Mount())
    assert len(mapper.add_scan(winding.scans[0])) == 1


def test_odometry_that_has_stopped_is_given_up_after_the_stated_time(winding) -> None:
    mapper = Mapper(MappingSettings(wheel_wait_s=0.5), Mount())
    mapper.add_odometry(winding.odometry[0])
    done = [len(mapper.add_scan(scan)) for scan in winding.scans[:10]]
    # At 10 Hz the first scan is 0.6 s old, the first time more than 0.5 s, when the seventh ends; then one a scan.
    assert done == [0, 0, 0, 0, 0, 0, 1, 1, 1, 1]
    assert len(mapper.finish()) == 6
    assert mapper.counters.wheel_guesses == 0


def test_odometry_is_ignored_on_request(winding) -> None:
    settings = MappingSettings(use_wheel_odometry=False)
    mapper, mapped = map_messages(as_received(winding)[:200], settings=settings)
    without, _ = map_messages([m for m in as_received(winding)[:200] if isinstance(m, LaserScan)], settings=settings)
    assert not any(result.wheel_guess for result in mapped)
    np.testing.assert_array_equal(mapper.trajectory.poses, without.trajectory.poses)


def test_odometry_carries_the_robot_where_the_laser_sees_nothing(winding) -> None:
    blind = [replace(s, ranges_m=np.zeros(400)) if 20 <= i < 30 else s for i, s in enumerate(winding.scans)]
    mapper, _ = map_messages(as_received(replace(winding, scans=blind)))
    assert mapper.counters.unmatched == 10
    error = absolute_trajectory_error(mapper.trajectory, winding.truth, align=False)
    assert error.max_m < 0.05  # the simulated wheels are exact: as good as without the gap


def test_wheels_alone_give_the_path_of_the_wheels(winding) -> None:
    mapper, _ = map_messages(as_received(winding), settings=MappingSettings(wheels_only=True))
    error = absolute_trajectory_error(mapper.trajectory, winding.truth, align=False)
    # The simulated wheels are exact; messages 20 ms apart where the turn rate jumps, and truth interpolated linearly.
    assert error.max_m < 0.005
    without, _ = map_messages(winding.scans[:5], settings=MappingSettings(wheels_only=True))
    assert (without.counters.mapped, without.counters.unmatched) == (1, 4)


# What is wrong with scans


def test_partial_scans_are_counted_and_left_out(winding) -> None:
    scans = [part_of(scan, 0.2) if index % 3 == 1 else scan for index, scan in enumerate(winding.scans[:30])]
    mapper, mapped = map_messages(scans)
    assert (mapper.counters.mapped, mapper.counters.skipped_partial, len(mapped)) == (20, 10, 20)


def test_turns_with_a_gap_are_mapped(winding) -> None:
    mapper, _ = map_messages([part_of(scan, 0.6) for scan in winding.scans[:30]])
    assert (mapper.counters.mapped, mapper.counters.skipped_partial) == (29, 1)


def test_the_map_begins_with_a_whole_turn(winding) -> None:
    whole, _ = map_messages(winding.scans[1:20])
    begun, _ = map_messages([part_of(winding.scans[0], 0.6), *winding.scans[1:20]])
    np.testing.assert_array_equal(begun.trajectory.poses, whole.trajectory.poses)
    assert begun.counters.skipped_partial == 1


def part_of(scan: LaserScan, share: float) -> LaserScan:
    """The first samples of a turn, the rest being lost."""
    kept = slice(round(len(scan.ranges_m) * share))
    return replace(
        scan,
        angles_rad=scan.angles_rad[kept],
        ranges_m=scan.ranges_m[kept],
        offsets_s=scan.offsets_s[kept],
        complete=False,
    )


def test_scans_out_of_order_are_counted_and_left_out(winding) -> None:
    order = [0, 1, 2, 1, 3, 3, 0, 4]
    mapper, _ = map_messages([winding.scans[index] for index in order])
    assert (mapper.counters.mapped, mapper.counters.skipped_out_of_order) == (5, 3)
    assert len(mapper.trajectory) == 5


@pytest.mark.parametrize("nothing", [0.0, np.nan, np.inf, 0.1, 12.0, 99.0])
def test_scans_without_a_measurement_are_counted_and_draw_nothing(nothing: float, winding) -> None:
    blind = [replace(scan, ranges_m=np.full(400, nothing)) for scan in winding.scans[:3]]
    mapper, mapped = map_messages(blind)
    assert mapper.counters.unmatched == 3
    assert not any(result.match.accepted for result in mapped)
    assert not mapper.grid().known.any()


@pytest.mark.parametrize("nothing", [0.0, np.nan, np.inf])
def test_missing_samples_among_good_ones_do_no_harm(nothing: float, winding) -> None:
    missing = np.random.default_rng(4).random(400) < 0.4  # an A2 in a large room returns as few as 60 %
    scans = [replace(scan, ranges_m=np.where(missing, nothing, scan.ranges_m)) for scan in winding.scans[:50]]
    mapper, _ = map_messages(scans)
    assert mapper.counters.mapped == 50
    assert absolute_trajectory_error(mapper.trajectory, winding.truth, align=False).max_m < 0.05


@pytest.mark.parametrize("position", [0, 1, 5])
def test_scans_without_any_sample_are_counted(position: int, winding) -> None:
    empty = replace(winding.scans[position], angles_rad=np.zeros(0), ranges_m=np.zeros(0), offsets_s=np.zeros(0))
    scans = [*winding.scans[:position], empty, *winding.scans[position + 1 : 8]]
    mapper, mapped = map_messages(scans)
    assert (mapper.counters.unmatched, mapper.counters.mapped, len(mapped)) == (1, 7, 8)


def test_scans_without_times_are_taken_as_instants(winding) -> None:
    scans = [replace(scan, offsets_s=np.zeros(400)) for scan in winding.scans[:5]]
    mapper, _ = map_messages(scans)
    assert mapper.trajectory.stamps_ns.tolist() == [scan.stamp_ns for scan in scans]


def test_no_input_is_no_map() -> None:
    mapper, mapped = map_messages([])
    assert (mapped, len(mapper.trajectory)) == ([], 0)
    assert not mapper.grid().known.any()


# Mount


def test_samples_become_points_of_the_body() -> None:
    ahead_and_left = np.array([0.0, np.pi / 2]), np.array([2.0, 1.0])
    points = Mount(np.array([0.1, 0.2, np.pi / 2])).to_body(*ahead_and_left)
    np.testing.assert_allclose(points, [[0.1, 2.2], [-0.9, 0.2]], atol=1e-12)
    upside_down = Mount(np.array([0.1, 0.2, 0.0]), inverted=True).to_body(*ahead_and_left)
    np.testing.assert_allclose(upside_down, [[2.1, 0.2], [0.1, -0.8]], atol=1e-12)


def test_one_stamp_from_the_future_costs_three_scans_not_all(winding) -> None:
    scans = list(winding.scans[:20])
    scans[8] = replace(scans[8], stamp_ns=scans[8].stamp_ns + 10**15)
    mapper, _ = map_messages(scans)
    assert mapper.counters.skipped_out_of_order == 3
    assert len(mapper.trajectory) == 17  # without the two, and without the pose whose stamp was wrong
    assert mapper.trajectory.stamps_ns[-1] < scans[8].stamp_ns


def test_a_clock_that_steps_back_costs_no_pose_that_was_there(winding) -> None:
    before, after = winding.scans[:20], winding.scans[20:]
    stepped = [replace(scan, stamp_ns=scan.stamp_ns - 10**9) for scan in after]
    mapper, _ = map_messages([*before, *stepped])
    assert mapper.counters.skipped_out_of_order == 10
    assert len(mapper.trajectory) == len(winding.scans) - 10 == mapper.counters.mapped


def test_a_blind_car_is_not_thought_to_drive_on(winding) -> None:
    seen = winding.scans[:15]
    blind = [replace(scan, ranges_m=np.zeros_like(scan.ranges_m)) for scan in winding.scans[15:45]]
    mapper, mapped = map_messages([*seen, *blind])
    poses = np.array([each.pose for each in mapped])
    assert mapper.counters.unmatched == 30
    assert np.hypot(*(poses[-1] - poses[14])[:2]) < 0.4 * 0.5 + 0.05  # half a second of the last speed
    assert np.array_equal(poses[-1], poses[-10])
    assert len(mapper.trajectory) == 15  # where it was while it was blind, nobody knows
