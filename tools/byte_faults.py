"""Faults of a serial line: bytes replaced, bits flipped, bytes lost, bytes too many. With a seed and the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
IntArray = NDArray[np.int64]

FAULTS = ("replaced", "flipped", "lost", "added")


@dataclass(frozen=True, slots=True, eq=False)
class Damaged:
    """Damaged bytes (M,); origin (M,): the place in the clean stream that each came from, -1 for one added."""

    data: Bytes
    origin: IntArray

    def hit_packets(self, clean: Bytes, size: int) -> NDArray[np.bool_]:
        """(P,) which packets of the clean stream have a byte changed, missing, or too many in or before them."""
        hit = np.zeros(len(clean) // size, dtype=np.bool_)
        kept = self.origin >= 0
        hit[self.origin[kept][self.data[kept] != clean[self.origin[kept]]] // size] = True
        missing = np.ones(len(clean), dtype=np.bool_)
        missing[self.origin[kept]] = False
        hit[np.flatnonzero(missing) // size] = True
        behind_added = np.flatnonzero(~kept[:-1] & kept[1:]) + 1
        hit[self.origin[behind_added] // size] = True
        return hit


def damage(clean: Bytes, rate: float, faults: tuple[str, ...], seed: int) -> Damaged:
    """Let each byte (N,) suffer a fault with this probability, of the kinds named in equal shares."""
    random = np.random.default_rng(seed)
    count = len(clean)
    fault = np.where(random.random(count) < rate, random.integers(0, len(faults), count), -1)
    named = {name: fault == place for place, name in enumerate(faults)}
    none = np.zeros(count, dtype=np.bool_)
    data = clean.copy()
    replaced, flipped = named.get("replaced", none), named.get("flipped", none)
    data[replaced] += random.integers(1, 256, count, dtype=np.uint8)[replaced]
    data[flipped] ^= np.left_shift(1, random.integers(0, 8, count)).astype(np.uint8)[flipped]
    kept = np.flatnonzero(~named.get("lost", none))
    before = np.flatnonzero(named.get("added", none)[kept])
    added = random.integers(0, 256, len(before), dtype=np.uint8)
    return Damaged(np.insert(data[kept], before, added), np.insert(kept, before, -1))


def expected_misses(capsules: int, size: int, rate: float, faults: tuple[str, ...]) -> float:
    """How many of so many capsules with faulty bytes pass the XOR of their bytes, on average.

    For changed bytes, the sum over the 256 characters of XOR: the mean of (-1)^(w.x) over what one byte adds to the
    sum, to the power of the bytes. The first two bytes have four bits each in the sum; a change of their other four
    always shows. A byte lost or added puts one strange byte into the sum: it passes once in 256 times.
    """
    each = rate / len(faults)
    flips, swaps = (each if name in faults else 0.0 for name in ("flipped", "replaced"))
    untouched = 1.0 - flips - swaps
    bits = (np.arange(256)[:, None] >> np.arange(8) & 1).astype(np.float64)  # (256 characters, 8 bits)
    body = untouched + flips * (1 - 2 * bits).mean(axis=1) - swaps / 255
    body[0] = 1.0
    heads = np.ones(256)
    for half in (bits[:, :4], bits[:, 4:]):
        swapped = np.where(half.any(axis=1), -1.0, 15.0)
        heads *= untouched + flips * (1 - 2 * half).sum(axis=1) / 8 + swaps * swapped / 255
    passing = (heads * body ** (size - 2)).mean() - untouched**size
    shifts = rate - flips - swaps
    unshifted = (1.0 - shifts) ** size
    shifted_once = size * shifts * (1.0 - shifts) ** (size - 1)
    return max(float(capsules * (unshifted * passing + shifted_once / 256)), 0.0)


def most_likely_at_most(mean: float, certainty: float = 0.999) -> int:
    """The count that a Poisson variable of this mean stays at or below with this certainty."""
    term = total = math.exp(-mean)
    count = 0
    while total < certainty:
        count += 1
        term *= mean / count
        total += term
    return count
