from __future__ import annotations

import numpy as np
import pytest

from tools.byte_faults import FAULTS, damage, expected_misses, most_likely_at_most

CLEAN = np.random.default_rng(0).integers(0, 256, 8400, dtype=np.uint8)


@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_not_hit_is_as_it_was(fault):
    damaged = damage(CLEAN, 0.01, (fault,), seed=1)
    kept = damaged.origin >= 0
    changed = damaged.data[kept] != CLEAN[damaged.origin[kept]]
    counts = {
        "replaced": changed.sum() if fault == "replaced" else 0,
        "flipped": changed.sum() if fault == "flipped" else 0,
        "lost": len(CLEAN) - kept.sum(),
        "added": (~kept).sum(),
    }
    assert 50 < counts[fault] < 130
    assert all(count == 0 for name, count in counts.items() if name != fault)
    assert (np.diff(damaged.origin[kept]) > 0).all()
    if fault == "flipped":
        differences = damaged.data[kept][changed] ^ CLEAN[damaged.origin[kept]][changed]
        assert set(differences.tolist()) <= {1 << bit for bit in range(8)}


def test_packets_hit_are_those_with_a_fault():
    assert not damage(CLEAN, 0.0, FAULTS, seed=1).hit_packets(CLEAN, 84).any()
    damaged = damage(CLEAN, 0.0005, FAULTS, seed=2)
    hit = damaged.hit_packets(CLEAN, 84)
    for packet in np.flatnonzero(~hit).tolist():
        places = np.flatnonzero(damaged.origin // 84 == packet)
        assert np.array_equal(damaged.data[places], CLEAN[packet * 84 : packet * 84 + 84])
        assert len(places) == places[-1] - places[0] + 1
    assert 0 < hit.sum() < 15


def test_the_same_seed_makes_the_same_faults():
    one, other = (damage(CLEAN, 0.01, FAULTS, seed=7) for _ in range(2))
    assert np.array_equal(one.data, other.data)


@pytest.mark.parametrize("fault", ["flipped", "replaced"])
def test_theory_agrees_with_trials(fault):
    # Of XOR alone, on short blocks with many faults, so that many pass: two bytes of head with four bits in the sum.
    random = np.random.default_rng(3)
    size, rate, trials = 12, 0.15, 400_000
    hit = random.random((trials, size)) < rate
    change = random.integers(1, 256, (trials, size)) if fault == "replaced" else 1 << random.integers(0, 8, hit.shape)
    change = np.where(hit, change, 0)
    check = np.bitwise_xor.reduce(change[:, 2:], axis=1) ^ (change[:, 0] & 15) ^ (change[:, 1] & 15) << 4
    passed = (check == 0) & (change[:, :2] < 16).all(axis=1) & hit.any(axis=1)
    expected = expected_misses(trials, size, rate, (fault,))
    assert passed.sum() == pytest.approx(expected, abs=5 * np.sqrt(expected))


def test_no_faults_no_misses():
    assert expected_misses(1000, 84, 0.0, FAULTS) == 0.0


def test_poisson_bound():
    assert most_likely_at_most(0.0) == 0
    counts = np.random.default_rng(1).poisson(4.5, 200_000)
    bound = most_likely_at_most(4.5)
    assert (counts > bound).mean() <= 0.0012
    assert (counts > bound - 1).mean() > 0.001
