"""A robot's folder while its map grows, is half written, vanishes, shrinks, and begins anew."""

from __future__ import annotations

import os

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.map_io import write_lossless, write_map
from tools.robot_folder import NewsKind, RobotFolder


def room(width, first=0, seed=0):
    """A room of 4 m by so many cells, from column `first` of the world on, in the world's frame."""
    cells = np.full((80, width), -3.0, np.float32)
    cells[[0, -1]] = 3.0
    cells[np.random.default_rng(seed).random(cells.shape) < 0.02] = 3.0
    return OccupancyGrid(cells, 0.05, np.array([first * 0.05, 0.0, 0.0]))


@pytest.fixture
def folder(tmp_path):
    return RobotFolder(tmp_path)


def polls(folder, count=4):
    """The news of so many looks."""
    return [news for _ in range(count) if (news := folder.poll()) is not None]


def test_a_folder_that_is_not_there_or_empty_is_waited_for(folder, tmp_path):
    assert polls(RobotFolder(tmp_path / "later")) == []
    assert polls(folder) == []
    write_lossless(tmp_path / "map.npz", room(100))
    (news,) = polls(folder)
    assert news.kind is NewsKind.first
    assert news.map is folder.map


def test_a_map_that_grows_is_taken_up_once_a_version(folder, tmp_path):
    for width in (100, 140, 180):
        write_lossless(tmp_path / "map.npz", room(width))
        news = polls(folder)
        assert len(news) == 1
        assert news[0].map.grid.log_odds.shape == (80, width)
    assert news[0].kind is NewsKind.grown
    assert news[0].text == "36 m² (was 28)"


def test_the_same_content_written_again_is_no_news(folder, tmp_path):
    write_lossless(tmp_path / "map.npz", room(100))
    polls(folder)
    write_lossless(tmp_path / "map.npz", room(100))
    assert polls(folder) == []


def test_of_numbered_maps_the_newest_counts_by_its_time(folder, tmp_path):
    for number, width in ((2, 100), (1, 140)):
        write_lossless(tmp_path / f"map_{number}.npz", room(width))
        os.utime(tmp_path / f"map_{number}.npz", (2e9 - number, 2e9 - number))
    (news,) = polls(folder)
    assert news.map.path.name == "map_1.npz"


def test_an_image_is_read_only_when_it_stands_still(folder, tmp_path):
    write_map(tmp_path / "map", room(100))
    (tmp_path / "map.npz").unlink()
    whole = (tmp_path / "map.pgm").read_bytes()
    for length in (100, 2000, len(whole)):  # as a writer leaves it that does not rename
        (tmp_path / "map.pgm").write_bytes(whole[:length])
        assert folder.poll() is None
    (news,) = polls(folder)
    assert news.map.grid.known.all()


@pytest.mark.parametrize("name", ["map.npz", "map.pgm"])
def test_a_map_that_stays_half_written_is_named_once_and_the_last_good_one_kept(folder, tmp_path, name):
    write_map(tmp_path / "map", room(100))
    if name == "map.pgm":
        (tmp_path / "map.npz").unlink()
    polls(folder)
    good = folder.map
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[: len(whole) // 2])
    (news,) = polls(folder, 6)
    assert news.kind is NewsKind.trouble
    assert name in news.text
    assert "the last good one is kept" in news.text
    assert folder.map is good
    write_map(tmp_path / "map", room(140))
    if name == "map.pgm":
        (tmp_path / "map.npz").unlink()
    assert [news.kind for news in polls(folder)] == [NewsKind.grown]


def test_a_map_that_vanishes_is_named_once_kept_and_taken_up_again(folder, tmp_path):
    write_lossless(tmp_path / "map.npz", room(100))
    polls(folder)
    (tmp_path / "map.npz").unlink()
    (news,) = polls(folder, 6)
    assert news.text == "its map is gone: the last one is kept"
    assert folder.map is not None
    write_lossless(tmp_path / "map.npz", room(120))
    assert [news.kind for news in polls(folder)] == [NewsKind.grown]


def test_a_map_whose_image_is_missing_is_named(folder, tmp_path):
    write_map(tmp_path / "map", room(100))
    for name in ("map.npz", "map.pgm"):
        (tmp_path / name).unlink()
    (news,) = polls(folder, 6)
    assert "its image" in news.text


def test_an_image_that_changes_at_every_look_is_named(folder, tmp_path):
    write_map(tmp_path / "map", room(100))
    (tmp_path / "map.npz").unlink()
    news = []
    for number in range(40):
        os.utime(tmp_path / "map.pgm", (1e9 + number, 1e9 + number))
        news += polls(folder, 1)
    assert len(news) == 1
    assert "changes at every look" in news[0].text


@pytest.mark.parametrize(
    "new", [room(30), room(200, first=400), room(200, first=120, seed=1)], ids=["small", "elsewhere", "overlapping"]
)
def test_a_map_begun_anew_is_another_one_and_the_former_is_handed_over(folder, tmp_path, new):
    write_lossless(tmp_path / "map.npz", room(200))
    polls(folder)
    former = folder.map
    write_lossless(tmp_path / "map.npz", new)
    (news,) = polls(folder)
    assert news.kind is NewsKind.restarted
    assert "started again" in news.text
    assert news.former is former


def test_a_loop_closure_that_moves_a_part_is_no_new_start(folder, tmp_path):
    write_lossless(tmp_path / "map.npz", room(200))
    polls(folder)
    moved = OccupancyGrid(room(220).log_odds, 0.05, np.array([0.1, -0.3, 0.03]))
    write_lossless(tmp_path / "map.npz", moved)
    assert [news.kind for news in polls(folder)] == [NewsKind.grown]


def test_a_map_that_knows_nothing_is_named(folder, tmp_path):
    write_lossless(tmp_path / "map.npz", OccupancyGrid(np.zeros((9, 9), np.float32), 0.05, np.zeros(3)))
    (news,) = polls(folder)
    assert news.text == "map.npz has no known cell"
    assert folder.map is None


def test_the_end_of_a_run_is_told_by_its_report(folder, tmp_path):
    (tmp_path / "recording.mcap").write_bytes(b"")
    write_lossless(tmp_path / "map.npz", room(100))
    (news,) = polls(folder)
    assert not news.map.finished
    (tmp_path / "report.json").write_text("{}")
    (news,) = polls(folder)
    assert news.text == "its run has ended"
    assert news.map.finished
