from __future__ import annotations

import numpy as np
import pytest

from drivers.messages import DepthImage, Pinhole

CAMERA = Pinhole(4, 3, 2.0, 2.0, 1.5, 1.0)


def test_a_depth_image_is_a_read_only_copy():
    depth = np.arange(12, dtype=np.uint16).reshape(3, 4)
    image = DepthImage(5, depth, 0.001, CAMERA)
    depth[:] = 0
    assert image.depth.tolist() == np.arange(12).reshape(3, 4).tolist()
    with pytest.raises(ValueError, match="read-only"):
        image.depth[0, 0] = 1


def test_an_image_of_another_size_is_refused():
    with pytest.raises(ValueError, match=r"depth has shape \(4, 3\), expected \(3, 4\)"):
        DepthImage(5, np.zeros((4, 3), np.uint16), 0.001, CAMERA)
