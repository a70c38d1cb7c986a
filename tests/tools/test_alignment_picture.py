from __future__ import annotations

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from tools.alignment_picture import HEIGHT_PX, VERDICT_COLORS_BGR, WIDTH_PX, AlignmentView, draw_alignment
from tools.map_overlay import COLORS_BGR

POSE = np.array([0.5, -0.3, 0.2])
OTHER = np.array([-1.0, 2.0, 3.0])


def room(rows=80, cols=120, resolution_m=0.05):
    cells = np.full((rows, cols), -4.0, np.float32)
    cells[[0, -1]] = 4.0
    cells[:, [0, -1]] = 4.0
    return OccupancyGrid(cells, resolution_m, np.zeros(3))


def unknown():
    return OccupancyGrid(np.zeros((20, 20), np.float32), 0.05, np.zeros(3))


def has(image, color):
    return bool((image == np.array(color, np.uint8)).all(axis=2).any())


VIEWS = {
    "accepted": AlignmentView(
        "accepted", "58 m of common wall", POSE, 0.97, np.eye(3) * 1e-4, 0.99, 0.6, 58.0, 0.4,
        points_a=np.ones((4, 2)), points_b=np.ones((4, 2)), slide=(0.3, 4.0), names=("a.yaml", "b.yaml"),
    ),
    "refused": AlignmentView(
        "refused", "too little wall in common " * 20, POSE, 0.1, alternatives=((OTHER, 0.05),) * 5,
        score=np.random.default_rng(0).random((30, 40)), score_extent_m=(-4.0, 4.0, -3.0, 3.0),
    ),
    "ambiguous": AlignmentView(
        "AMBIGUOUS", "two places", POSE, 0.5, alternatives=((OTHER, 0.45), (POSE, 0.01)),
    ),
    "ambiguous without a second place": AlignmentView("ambiguous", "why", POSE),
    "nothing found": AlignmentView("refused", "no motion fits two matches"),
    "nothing found, scores": AlignmentView(
        "refused", "", score=np.zeros((3, 4)), score_extent_m=(0.0, 1.0, 0.0, 1.0), alternatives=((POSE, 0.01),)
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", VIEWS)
def test_every_verdict_gives_one_page_in_its_colour_the_same_each_time(name):
    view = VIEWS[name]
    image = draw_alignment(room(), room(50, 60), view)
    assert image.shape == (HEIGHT_PX, WIDTH_PX, 3)
    assert image.dtype == np.uint8
    for verdict, color in VERDICT_COLORS_BGR.items():
        assert has(image, color) == (verdict == view.verdict.lower())
    assert np.array_equal(image, draw_alignment(room(), room(50, 60), view))
    for edge in (image[:6], image[-6:], image[:, :8], image[:, -8:]):
        assert (edge == 255).all()  # nothing is cut off


def test_ambiguous_shows_two_places_side_by_side():
    main = draw_alignment(room(), room(), VIEWS["ambiguous"])[150:930, 24:1048]
    walls = (main == np.array(COLORS_BGR["wall b"], np.uint8)).all(axis=2)
    assert walls[:, :500].any() or walls[:380].any()
    assert walls[:, 524:].any()
    single = draw_alignment(room(), room(), VIEWS["ambiguous without a second place"])[150:930, 24:1048]
    assert not np.array_equal(main, single)


def test_maps_without_a_place_are_shown_in_no_common_frame():
    image = draw_alignment(room(), room(50, 60), VIEWS["nothing found"])
    assert not has(image, COLORS_BGR["conflict"])
    assert not has(image, COLORS_BGR["wall both"])


@pytest.mark.parametrize(
    ("a", "b"),
    [
        (room(20, 20), room(20, 20)),
        (room(3, 3), room(1500, 1500)),
        (room(1500, 1500, 0.02), room(2, 2)),
        (room(8, 3000), room(3000, 8)),
        (unknown(), room()),
        (unknown(), unknown()),
        (OccupancyGrid(np.ones((1, 1), np.float32), 0.05, np.zeros(3)), room()),
    ],
)
def test_maps_of_any_size_fit_the_page(a, b):
    for view in (VIEWS["accepted"], VIEWS["ambiguous"], VIEWS["nothing found"]):
        image = draw_alignment(a, b, view)
        assert image.shape == (HEIGHT_PX, WIDTH_PX, 3)
        assert (image[:, -8:] == 255).all()


def test_maps_far_apart_are_drawn():
    far = AlignmentView("refused", "far", np.array([1e6, -1e6, 1.0]), slide=(1.0, 1e6))
    assert draw_alignment(room(), room(), far).shape == (HEIGHT_PX, WIDTH_PX, 3)


def test_a_wall_of_one_cell_of_a_large_map_is_on_the_page():
    cells = np.full((2500, 2500), -4.0, np.float32)
    cells[1234, 100:2400] = 4.0
    wall = OccupancyGrid(cells, 0.05, np.zeros(3))
    free = OccupancyGrid(np.full((2500, 2500), -4.0, np.float32), 0.05, np.zeros(3))
    main = draw_alignment(wall, free, AlignmentView("refused", "why", np.zeros(3)))[150:930, 24:1048]
    red = (main == np.array(COLORS_BGR["conflict"], np.uint8)).all(axis=2).any(axis=0)
    assert red.sum() > 0.85 * 770  # the wall's length in pixels, without a gap but for letters and axes
