from __future__ import annotations

import numpy as np
import pytest

from drivers.rplidar_encoding import encode_nodes
from drivers.rplidar_node_turns import NodePiece, NodeTurns, signed_angle_q6

STEP = 128  # 2 deg: 180 nodes a turn


def turning(first_deg: int, count: int, flags: tuple[int, ...]) -> bytes:
    """Nodes 2 deg apart, with the turn's flag at these places."""
    angle_q6 = (first_deg * 64 + STEP * np.arange(count)) % 23040
    flag = np.isin(np.arange(count), flags)
    return encode_nodes(angle_q6, np.full(count, 4000), np.full(count, 15), flag).tobytes()


def lengths(pieces: list[NodePiece]) -> list[tuple[int, bool, bool]]:
    return [(len(piece.packets), piece.ends_turn, piece.guessed) for piece in pieces]


@pytest.mark.parametrize("flag", [48, 50, 52])
def test_one_flag_near_zero_begins_the_turn(flag: int) -> None:
    assert lengths(NodeTurns().take(turning(260, 100, (flag,)))) == [(flag, True, False)]


def test_a_lost_flag_is_made_up_for_by_the_angle() -> None:
    assert lengths(NodeTurns().take(turning(260, 100, ()))) == [(50, True, True)]


def test_of_two_flags_that_nearer_to_zero_counts_and_is_a_guess() -> None:
    assert lengths(NodeTurns().take(turning(260, 100, (43, 49)))) == [(49, True, True)]


def test_a_flag_behind_the_passage_begins_nothing() -> None:
    assert lengths(NodeTurns().take(turning(260, 100, (49, 58)))) == [(49, True, False)]


def test_turns_are_the_same_one_node_at_a_time() -> None:
    rows = turning(100, 640, (130, 310, 308, 490))
    at_once = lengths(NodeTurns().take(rows))
    turns = NodeTurns()
    singly = [piece for at in range(0, len(rows), 5) for piece in turns.take(rows[at : at + 5])]
    assert lengths(singly) == at_once
    assert at_once == [(130, True, False), (180, True, True), (180, True, False)]


def test_a_gap_over_zero_ends_the_turn_once() -> None:
    turns = NodeTurns()
    before = turns.take(turning(260, 40, ())) + turns.gap()
    assert lengths(before) == [(40, False, False)]
    assert lengths(turns.take(turning(4, 30, (2,)))) == [(0, True, True)]
    assert lengths(turns.gap()) == [(30, False, False)]


def test_a_gap_behind_zero_at_the_start_of_a_stream_ends_no_turn() -> None:
    turns = NodeTurns()
    assert lengths(turns.take(turning(18, 25, ())) + turns.gap()) == [(25, False, False)]
    assert turns.take(turning(72, 30, ())) == []


def test_a_gap_beside_the_flag_makes_no_second_turn() -> None:
    turns = NodeTurns()
    before = turns.take(turning(260, 51, (49,))) + turns.gap()
    assert lengths(before) == [(49, True, True), (2, False, False)]
    assert turns.take(turning(4, 30, ())) == []


def test_a_gap_before_zero_leaves_the_turn_to_its_flag() -> None:
    turns = NodeTurns()
    turns.take(turning(260, 30, ()))
    turns.gap()
    assert lengths(turns.take(turning(350, 40, (4,)))) == [(4, True, False)]


def test_a_head_that_stands_still_at_zero_is_let_go() -> None:
    turns = NodeTurns()
    standing = encode_nodes(np.zeros(3000, dtype=np.int64), np.full(3000, 4000), np.full(3000, 15), np.ones(3000, bool))
    assert lengths(turns.take(standing.tobytes())) == [(3000, False, False)]


def test_signed_angles() -> None:
    assert [signed_angle_q6(turning(degrees, 1, ()), 0) // 64 for degrees in (0, 179, 180, 359)] == [0, 179, -180, -1]
