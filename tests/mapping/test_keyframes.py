from __future__ import annotations

import numpy as np

from mapping.keyframes import KeyframeStore
from mapping.surface import Surface, surface_of

SENSOR = np.array([0.1, -0.05])
COLUMNS = ("points", "angles", "ranges", "normals", "levels", "reaches")


def random_surface(seed: int, count: int = 300) -> Surface:
    generator = np.random.default_rng(seed)
    return surface_of(generator.uniform(-5.0, 5.0, (count, 2)), SENSOR)


def test_keyframes_come_back_with_single_precision() -> None:
    store, surfaces = KeyframeStore(SENSOR), [random_surface(seed, 50 + seed) for seed in range(5)]
    assert [store.add(surface) for surface in surfaces] == [0, 1, 2, 3, 4]
    clouds = store.snapshot()
    assert len(store) == len(clouds) == 5
    np.testing.assert_array_equal(clouds.sensor, SENSOR)
    for number, surface in enumerate(surfaces):
        np.testing.assert_allclose(clouds.points_of(number), surface.points, atol=1e-6)
        mine = slice(clouds.starts[number], clouds.starts[number + 1])
        for name in COLUMNS:
            np.testing.assert_array_equal(getattr(clouds, name)[mine], getattr(surface, name).astype(np.float32))


def test_a_snapshot_does_not_change_when_the_store_grows() -> None:
    store = KeyframeStore(SENSOR)
    for seed in range(3):
        store.add(random_surface(seed))
    snapshot = store.snapshot()
    before = {name: getattr(snapshot, name).copy() for name in (*COLUMNS, "starts")}
    for seed in range(1100):  # 330 000 samples: every array is made anew more than once
        store.add(random_surface(seed % 7))
    assert (len(snapshot), len(store)) == (3, 1103)
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(snapshot, name), values)
    np.testing.assert_allclose(store.snapshot().points_of(1102), random_surface(1099 % 7).points, atol=1e-6)


def test_the_last_keyframe_can_be_taken_back() -> None:
    store = KeyframeStore(SENSOR)
    store.add(random_surface(0))
    store.add(random_surface(1))
    store.remove_last()
    assert (len(store), len(store.snapshot())) == (1, 1)
    assert store.add(random_surface(2)) == 1
    clouds = store.snapshot()
    np.testing.assert_allclose(clouds.points_of(0), random_surface(0).points, atol=1e-6)
    np.testing.assert_allclose(clouds.points_of(1), random_surface(2).points, atol=1e-6)


def test_a_scan_without_samples_is_a_keyframe_too() -> None:
    store = KeyframeStore(SENSOR)
    store.add(random_surface(0, count=0))
    store.add(random_surface(1))
    assert store.snapshot().points_of(0).shape == (0, 2)
    assert len(KeyframeStore(SENSOR).snapshot()) == 0


def test_one_scan_larger_than_the_store_fits() -> None:
    store = KeyframeStore(SENSOR)
    count = 200_000
    columns = {name: np.full(count, 2.0) for name in ("angles", "ranges", "levels", "reaches")}
    store.add(Surface(np.full((count, 2), 1.0), normals=np.full((count, 2), 0.5), **columns))
    assert len(store.snapshot().points_of(0)) == count
