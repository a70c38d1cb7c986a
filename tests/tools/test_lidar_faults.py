"""What `evaluate lidar` shows, on shorter streams; a decoder that is fooled must be found out."""

from __future__ import annotations

import pytest

import drivers.rplidar_protocol as protocol
from tools.byte_faults import FAULTS
from tools.lidar_faults import CAPSULE_KINDS, fault_cost, unnoticed_single_faults
from tools.lidar_streams import STREAM_KINDS


@pytest.mark.parametrize("kind", STREAM_KINDS, ids=lambda kind: kind.name)
@pytest.mark.parametrize("faults", [*((fault,) for fault in FAULTS), FAULTS], ids="-".join)
def test_two_bad_bytes_in_a_thousand(kind, faults):
    cost = fault_cost(kind, faults, 0.002, 20_000, seed=5)
    assert cost.hit_packets > 30
    assert cost.decoded > 0.4 * cost.samples
    assert (cost.false_turns, cost.false_whole, cost.angles_off) == (0, 0, 0)
    assert abs(cost.turns - cost.true_turns) <= 2
    assert cost.loss_per_hit <= 2.0
    assert cost.worst_loss_per_hit <= 2.0
    if kind.answer == protocol.Answer.NODES:
        assert cost.wrong_distances <= cost.unavoidable_distances + 2
    else:
        assert cost.missed_at_most is not None
        assert cost.missed <= cost.missed_at_most


@pytest.mark.parametrize("kind", STREAM_KINDS, ids=lambda kind: kind.name)
def test_without_faults_nothing_is_lost(kind):
    cost = fault_cost(kind, FAULTS, 0.0, 10_000, seed=1)
    assert (cost.hit_packets, cost.missed, cost.wrong_distances) == (0, 0, 0)
    assert cost.whole_turns >= cost.turns - 2
    assert cost.expected_missed in (0.0, None)


def test_every_changed_byte_of_a_capsule_is_noticed():
    changes, unnoticed = unnoticed_single_faults(CAPSULE_KINDS[0], seed=0)
    assert (changes, unnoticed) == (84 * 255, 0)
