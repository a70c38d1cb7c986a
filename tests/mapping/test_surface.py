from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping import se2
from mapping.surface import facings_of, share_across, surface_of

ORIGIN = np.zeros(2)


def wall(yaw: float, distance_m: float, bearings: np.ndarray) -> np.ndarray:
    """Samples (N, 2) of an endless wall, its normal at an angle of yaw, where rays from (0, 0) hit it."""
    ranges = distance_m / np.cos(bearings)
    return se2.transform_points(
        [0.0, 0.0, yaw], np.column_stack([distance_m * np.ones_like(bearings), 0 * bearings])
    ) + (np.column_stack([-np.sin(yaw) * ranges * np.sin(bearings), np.cos(yaw) * ranges * np.sin(bearings)]))


@given(
    yaw=st.floats(-np.pi, np.pi),
    distance_m=st.floats(0.3, 8.0),
    sensor=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
)
def test_samples_of_a_wall_lie_on_its_line_and_face_the_sensor(yaw: float, distance_m: float, sensor) -> None:
    seen = wall(yaw, distance_m, np.linspace(-0.9, 0.9, 120))
    surface = surface_of(seen + sensor, np.array(sensor))
    towards = -np.array([np.cos(yaw), np.sin(yaw)])
    straight = surface.reaches > 0.0
    assert straight.all()
    np.testing.assert_allclose(surface.normals, np.tile(towards, (120, 1)), atol=1e-6)
    np.testing.assert_allclose(np.einsum("na,na->n", surface.normals, surface.points), surface.levels, atol=1e-6)
    np.testing.assert_allclose(surface.ranges, np.hypot(*(surface.points - sensor).T))


@given(st.integers(0, 2**32 - 1), st.integers(0, 60))
def test_the_order_of_samples_does_not_matter_and_angles_rise(seed: int, count: int) -> None:
    generator = np.random.default_rng(seed)
    points = generator.uniform(-5.0, 5.0, (count, 2))
    sensor = generator.uniform(-0.5, 0.5, 2)
    surface, shuffled = surface_of(points, sensor), surface_of(generator.permutation(points), sensor)
    for name in ("points", "angles", "ranges", "normals", "levels", "reaches"):
        np.testing.assert_array_equal(getattr(surface, name), getattr(shuffled, name))
    assert np.all(np.diff(surface.angles) >= 0.0)
    rays = surface.points - sensor
    np.testing.assert_allclose(
        surface.ranges[:, None] * np.exp(1j * surface.angles)[:, None], (rays @ [1, 1j])[:, None]
    )
    lengths = np.hypot(*surface.normals.T)
    assert np.all((lengths == 0.0) | (np.abs(lengths - 1.0) < 1e-12))
    assert np.array_equal(lengths > 0.0, surface.reaches > 0.0)


def test_a_wall_across_the_seam_of_the_angles_is_one_wall() -> None:
    surface = surface_of(wall(np.pi, 2.0, np.linspace(-0.4, 0.4, 81)), ORIGIN)
    assert np.ptp(surface.angles) > 6.0  # it is seen at both ends of the scale
    np.testing.assert_allclose(surface.normals, np.tile([1.0, 0.0], (81, 1)), atol=1e-9)


def test_a_corner_has_no_third_wall(room, site) -> None:
    surface = surface_of(site(room, 360, 0.0).look(np.array([4.0, 2.5, 0.0])), ORIGIN)
    straight = surface.reaches > 0.0
    assert straight.mean() > 0.85
    # All walls of the room are parallel to an axis; cells of 2 cm and corners bend single lines.
    off = np.abs(np.sin(2.0 * np.arctan2(surface.normals[straight, 1], surface.normals[straight, 0])))
    assert np.quantile(off, 0.9) < 0.05
    assert np.quantile(off, 0.98) < np.sin(2.0 * np.radians(20.0))


def test_scattered_points_are_no_wall() -> None:
    bearings = np.linspace(-np.pi, np.pi, 90, endpoint=False)
    ranges = np.where(np.arange(90) % 2, 2.0, 4.0)
    surface = surface_of(ranges[:, None] * np.column_stack([np.cos(bearings), np.sin(bearings)]), ORIGIN)
    assert not surface.reaches.any()
    assert not surface.normals.any()


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_points_are_no_wall(count: int) -> None:
    surface = surface_of(np.array([[1.0, 0.0], [1.0, 0.05]])[:count], ORIGIN)
    assert len(surface.points) == count
    assert not surface.reaches.any()


@pytest.mark.parametrize(("count", "kept"), [(400, 400), (401, 201), (1000, 334), (3600, 400)])
def test_large_scans_are_thinned_evenly_after_the_lines_are_fitted(count: int, kept: int) -> None:
    points = wall(0.3, 2.0, np.linspace(-1.0, 1.0, count))
    surface = surface_of(points, ORIGIN)
    assert len(surface.points) == kept
    assert np.ptp(np.diff(surface.angles)) < 1e-9
    assert np.all(surface.reaches > 0.0)


def test_walls_across_are_few_in_a_corridor_and_half_in_a_square_room() -> None:
    along, across = np.tile([0.0, 1.0], (95, 1)), np.tile([1.0, 0.0], (5, 1))
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    assert share_across(np.vstack([along, across]) @ turn.T) == pytest.approx(0.05)
    assert share_across(np.vstack([along, along[:, ::-1]])) == pytest.approx(0.5)
    assert share_across(np.zeros((7, 2))) == 0.0


@given(
    yaw=st.floats(-np.pi, np.pi),
    distance_m=st.floats(0.3, 8.0),
    sensor=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
)
def test_every_sample_of_a_wall_faces_as_the_wall_does(yaw: float, distance_m: float, sensor) -> None:
    seen = np.random.default_rng(0).permutation(wall(yaw, distance_m, np.linspace(-0.9, 0.9, 120)))
    facings = facings_of(seen + sensor, np.array(sensor))
    np.testing.assert_allclose(np.exp(1j * facings), -np.exp(1j * yaw) * np.ones(120), atol=1e-6)


def test_where_there_is_no_straight_wall_a_sample_faces_the_sensor() -> None:
    points = np.array([[2.0, 0.0], [0.0, 3.0], [-1.0, -1.0]])
    facings = facings_of(points, np.array([0.0, 1.0]))
    towards = np.array([0.0, 1.0]) - points
    np.testing.assert_allclose(np.exp(1j * facings), towards @ [1, 1j] / np.hypot(*towards.T))
    assert facings_of(np.zeros((0, 2)), ORIGIN).shape == (0,)
