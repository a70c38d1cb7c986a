"""The heap against sorting."""

from __future__ import annotations

import numpy as np
import pytest

from planning.heap import pop, push


@pytest.mark.parametrize("kind", [(np.float32, np.int32), (np.float64, np.int64)])
def test_items_come_out_by_rising_key_also_when_the_arrays_grow(kind):
    wanted = np.random.default_rng(1).permutation(100)
    keys, items, count = np.empty(4, kind[0]), np.empty(4, kind[1]), 0
    for key in wanted.tolist():
        keys, items, count = push(keys, items, count, float(key), 10 * key)
    out = []
    while count:
        out.append(int(items[0]))
        count = pop(keys, items, count)
    assert out == [10 * key for key in range(100)]
