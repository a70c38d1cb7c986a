"""A binary heap in two arrays, keys and what they stand for, for searches in compiled code."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Keys = NDArray[Any]  # of 32 or 64 bits, as the caller made them
Items = NDArray[Any]


@njit(cache=True)
def push(keys: Keys, items: Items, count: int, key: float, item: int) -> tuple[Keys, Items, int]:
    """Add an item to the first count ones; returns the arrays, larger ones where they were full, and how many it holds.

    The item of the least key is items[0].
    """
    if count == len(keys):
        more_keys, more_items = np.empty(2 * count, keys.dtype), np.empty(2 * count, items.dtype)
        more_keys[:count], more_items[:count] = keys, items
        keys, items = more_keys, more_items
    place = count
    while place:
        parent = (place - 1) >> 1
        if keys[parent] <= key:
            break
        keys[place], items[place] = keys[parent], items[parent]
        place = parent
    keys[place], items[place] = key, item
    return keys, items, count + 1


@njit(cache=True)
def pop(keys: Keys, items: Items, count: int) -> int:
    """Take the item of the least key off count >= 1 ones; returns how many are left."""
    count -= 1
    key, item = keys[count], items[count]
    place = 0
    while True:
        child = 2 * place + 1
        if child >= count:
            break
        if child + 1 < count and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[place], items[place] = keys[child], items[child]
        place = child
    keys[place], items[place] = key, item
    return count
