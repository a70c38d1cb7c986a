from __future__ import annotations

import numpy as np
import pytest

from drivers.emulated_faults import FaultScript, parse_script
from drivers.faulty_line import FaultyLine

MS = 1_000_000
S = 1_000_000_000


class Source:
    """Sends ten bytes each ms, from the first on; answers ANSWER."""

    def __init__(self) -> None:
        self.sent = 0
        self.powered: list[int] = []

    def receive(self, data: bytes, now_ns: int) -> bytes:
        return b"ANSWER"

    def due(self, now_ns: int) -> bytes:
        first, self.sent = self.sent, max(self.sent, now_ns // MS * 10)
        return bytes(number % 251 for number in range(first, self.sent))

    def power_up(self, now_ns: int) -> None:
        self.powered.append(now_ns)


def line(script: str, seed: int = 0) -> FaultyLine:
    faults = FaultScript(parse_script(script), seed)
    faults.begin(0)
    return FaultyLine(Source(), faults, 115200)


def heard(script: str, step_ms: int = 1, seed: int = 0, until_ms: int = 2000) -> bytes:
    wire = line(script, seed)
    return b"".join(wire.due(at * MS) for at in range(0, until_ms + 1, step_ms))


def test_a_good_line_changes_nothing() -> None:
    assert heard("") == Source().due(2 * S)


@pytest.mark.parametrize("script", ["flip=0.01", "drop=0.01", "flip=0.01\ndrop=0.01"])
def test_damage_depends_on_the_seed_alone(script: str) -> None:
    assert heard(script) == heard(script, step_ms=50) != heard(script, seed=1)


def test_a_flipped_byte_has_one_bit_wrong() -> None:
    sent, got = (np.frombuffer(heard(script), dtype=np.uint8) for script in ("", "flip=0.01"))
    wrong = np.unpackbits((sent ^ got)[:, None], axis=1).sum(axis=1)
    assert set(wrong) == {0, 1}
    assert wrong.mean() == pytest.approx(0.01, abs=0.002)


def test_dropped_bytes_are_missing() -> None:
    assert len(heard("drop=0.1")) == pytest.approx(18_000, abs=300)


def test_silence_loses_and_a_stall_keeps() -> None:
    sent = heard("")
    assert heard("silence@0.5+0.5") == sent[:4990] + sent[9990:]
    wire = line("stall@0.5+0.5")
    before = b"".join(wire.due(at * MS) for at in range(1000))
    assert before == sent[:4990]
    assert before + wire.due(S) == sent[:10_000]


def test_an_adapter_hands_over_every_so_often() -> None:
    wire = line("latency=0.016")
    sizes = [len(wire.due(at * MS)) for at in range(161)]
    assert [at for at, size in enumerate(sizes) if size] == list(range(16, 161, 16))
    assert sum(sizes) == 1600


def test_pieces_come_at_the_pace_of_the_wire() -> None:
    wire = line("chunk=7")
    wire.due(9 * MS)
    first = wire.due(10 * MS)
    assert len(first) % 7 in (0, 10 % 7)
    rest = b"".join(wire.due(10 * MS + at * MS // 10) for at in range(400))
    assert len(first + rest) >= 100


def test_slow_answers_keep_their_place_in_line() -> None:
    wire = line("slow=0.3")
    assert wire.receive(b"?", 0) == b""
    assert b"".join(wire.due(at * MS) for at in range(300)) == b""
    assert wire.due(300 * MS).startswith(b"ANSWER\x00\x01")


def test_unplugging_loses_what_was_under_way() -> None:
    device = Source()
    faults = FaultScript(parse_script("stall@0+9"))
    faults.begin(0)
    wire = FaultyLine(device, faults, 115200)
    wire.due(S)
    wire.power_up(2 * S)
    assert device.powered == [2 * S]
    assert wire.due(10 * S) == bytes(number % 251 for number in range(10_000, 100_000))
