from __future__ import annotations

import importlib.util
import logging
import sys

import numpy as np
import pytest

from drivers.messages import DepthImage, Pinhole
from mapping.depth_projection import CameraMount, project
from mapping.open3d_projection import best_projection, open3d_projection

has_open3d = importlib.util.find_spec("open3d") is not None


@pytest.fixture(autouse=True)
def afresh():
    best_projection.cache_clear()
    yield
    best_projection.cache_clear()


@pytest.mark.skipif(not has_open3d, reason="Open3D is not installed: make setup-depth")
def test_open3d_agrees_with_numpy_point_by_point():
    camera = Pinhole(60, 40, 40.0, 41.0, 30.2, 19.1)
    depth = np.random.default_rng(3).integers(0, 6000, (40, 60)).astype(np.uint16)
    depth[depth < 600] = 0
    image, mount = DepthImage(0, depth, 0.001, camera), CameraMount(0.1, 0.02, 0.2, 0.03, 0.1, -0.2)
    found, expected = open3d_projection()(image, mount), project(image, mount)
    assert found.shape == expected.shape

    def ordered(points):
        return points[np.lexsort(np.round(points, 3).T)]

    np.testing.assert_allclose(ordered(found), ordered(expected), atol=2e-3)  # float32; its points come in any order
    assert open3d_projection()(DepthImage(0, depth * 0, 0.001, camera), mount).shape == (0, 3)


def test_without_open3d_numpy_does_it_and_the_log_says_so_once(monkeypatch, caplog):
    monkeypatch.setitem(sys.modules, "open3d", None)  # Python's own way to say that a module cannot be imported
    with caplog.at_level(logging.WARNING):
        assert best_projection() is project
        assert best_projection() is project
    assert [record.name for record in caplog.records] == ["mapping.open3d_projection"]
    assert "numpy" in caplog.text
