"""The map while the robot drives: it must become what the scans at their present places draw, and wait for nobody."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from mapping import se2
from mapping.background import at_once
from mapping.grid import GridBuilder, OccupancyGrid
from mapping.live_grid import LiveGrid
from mapping.scan_archive import PlacedScans, ScanArchive
from mapping.sensor_models import LidarModel

SENSOR = np.array([0.1, 0.0])
SCANS_A_KEYFRAME = 4
KEYFRAMES = 60


class Graph:
    """Stands for a graph whose keyframes stand side by side; each sees four walls around itself."""

    def __init__(self) -> None:
        self.archive = ScanArchive(10**9)
        self.poses = np.zeros((0, 3))
        self.out: set[int] = set()
        self._square = np.array([[x, y] for x in (-1.0, 1.0) for y in np.linspace(-1.0, 1.0, 30)])

    def drive(self, live: LiveGrid, keyframes: int, after: Callable[[int], None] = lambda number: None) -> None:
        for _ in range(keyframes):
            number = len(self.poses)
            self.poses = np.vstack([self.poses, [0.3 * number, 0.0, 0.0]])
            after(number)
            for place in range(SCANS_A_KEYFRAME):
                relative = np.array([0.05 * place, 0.0, 0.0])
                self.archive.add(
                    100 * number + place, number, relative, self._square, matched=True, known=True,
                    is_keyframe=place == 0,
                )  # fmt: skip
                live.add(self)

    @property
    def keyframe_poses(self) -> np.ndarray:
        return self.poses

    def placed(self) -> PlacedScans:
        in_map = np.array([number not in self.out for number in range(len(self.poses))], dtype=np.bool_)
        return PlacedScans(self.archive, self.poses, in_map)

    def drawn(self) -> OccupancyGrid:
        """Return the map of all scans where they lie now."""
        builder, placed = GridBuilder(0.05, LidarModel()), self.placed()
        for number in range(len(placed)):
            scan = placed.get(number)
            if scan is not None:
                pose, points = scan
                builder.add_scan(se2.transform_points(pose, SENSOR), se2.transform_points(pose, points))
        return builder.grid()


def live_grid(background=at_once) -> LiveGrid:
    return LiveGrid(0.05, LidarModel(), SENSOR, background)


def assert_same(one: OccupancyGrid, other: OccupancyGrid) -> None:
    np.testing.assert_array_equal(one.origin, other.origin)
    np.testing.assert_array_equal(one.log_odds, other.log_odds)


def loop_at_the_25th(graph: Graph) -> Callable[[int], None]:
    """A loop closes: half of the keyframes move by two cells."""

    def close(number: int) -> None:
        if number == 25:
            graph.poses[10:, 1] += 0.1

    return close


def test_where_nothing_moves_it_is_the_map_of_all_scans_after_each() -> None:
    graph, live = Graph(), live_grid()
    for _ in range(5):
        graph.drive(live, 3)
        assert_same(live.grid(), graph.drawn())
    assert live.redrawn == 0


def test_once_walls_have_moved_it_is_drawn_anew() -> None:
    graph, live = Graph(), live_grid()
    graph.drive(live, 26, loop_at_the_25th(graph))
    assert not np.array_equal(live.grid().log_odds.shape, graph.drawn().log_odds.shape) or not np.array_equal(
        live.grid().log_odds, graph.drawn().log_odds
    )
    graph.drive(live, KEYFRAMES - 26)
    assert live.redrawn == 1
    assert_same(live.grid(), graph.drawn())


def test_less_than_half_a_cell_is_nothing_to_redraw_for() -> None:
    graph, live = Graph(), live_grid()

    def close(number: int) -> None:
        if number == 25:
            graph.poses[10:, 1] += 0.02

    graph.drive(live, KEYFRAMES, close)
    assert live.redrawn == 0


@pytest.mark.parametrize("kind", ["thread", "as late as can be"])
def test_a_background_gives_the_same_bits(kind: str) -> None:
    there, then = Graph(), live_grid()
    there.drive(then, KEYFRAMES, loop_at_the_25th(there))
    with ThreadPoolExecutor(1) as pool:
        background = (lambda task: pool.submit(task).result) if kind == "thread" else (lambda task: task)
        graph, live = Graph(), live_grid(background)
        graph.drive(live, KEYFRAMES, loop_at_the_25th(graph))
    assert live.redrawn == 1
    assert_same(live.grid(), then.grid())


def test_while_it_is_drawn_anew_the_old_one_goes_on_growing() -> None:
    asked: list[Callable[[], None]] = []

    def background(task):
        asked.append(task)
        return task

    graph, live = Graph(), live_grid(background)
    graph.drive(live, 26, loop_at_the_25th(graph))
    width = live.grid().log_odds.shape[1]
    assert len(asked) == 1
    graph.drive(live, 1)
    assert live.redrawn == 0 or live.grid().log_odds.shape[1] > width
    assert live.grid().log_odds.shape[1] > width


def test_a_piece_whose_place_is_unknown_is_drawn_when_it_is_known() -> None:
    graph, live = Graph(), live_grid()
    graph.drive(live, 10)
    graph.out = set(range(10, 30))
    graph.drive(live, 10)
    assert_same(live.grid(), graph.drawn())
    assert live.redrawn == 0
    graph.out = set()
    graph.drive(live, 10)
    assert live.redrawn == 1
    assert_same(live.grid(), graph.drawn())


def test_a_piece_is_not_kept_waiting_because_the_map_was_drawn_anew_a_moment_ago() -> None:
    graph, live = Graph(), live_grid()
    graph.drive(live, 26, loop_at_the_25th(graph))
    graph.drive(live, 4)
    assert live.redrawn == 1
    graph.out = {30, 31}
    graph.drive(live, 2)
    graph.out = set()
    graph.drive(live, 3)
    assert live.redrawn == 2
    assert_same(live.grid(), graph.drawn())


def test_an_earlier_drive_is_drawn_by_the_background_and_not_while_mapping_waits() -> None:
    graph = Graph()
    graph.drive(live_grid(), 40)
    tasks: list[Callable[[], None]] = []

    def background(task):
        tasks.append(task)
        return task

    live = live_grid(background)
    live.resume(graph)
    assert not live.grid().known.any()
    graph.drive(live, 1)
    assert len(tasks) == 1
    assert live.grid().known.sum() < 0.2 * graph.drawn().known.sum()
    graph.drive(live, 4)
    assert live.redrawn == 1
    assert_same(live.grid(), graph.drawn())


def test_scans_that_are_taken_back_leave_no_hole() -> None:
    graph, live = Graph(), live_grid()
    graph.drive(live, 5)
    graph.archive.remove_last(2)
    graph.drive(live, 5)
    lacking = live.grid().log_odds.shape
    assert lacking == graph.drawn().log_odds.shape
