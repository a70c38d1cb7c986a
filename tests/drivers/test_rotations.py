from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drivers.rotations import quaternion


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4))
def test_the_quaternion_of_a_rotation_gives_it_back(values):
    length = np.linalg.norm(values)
    if length > 1e-3:
        matrix = Rotation.from_quat(np.array(values) / length).as_matrix()
        assert Rotation.from_quat(quaternion(matrix)).as_matrix() == pytest.approx(matrix, abs=1e-9)
