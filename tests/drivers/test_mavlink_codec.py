"""Messages survive the way there and back, however the bytes are cut and whatever stands between."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.mavlink_codec import MavlinkCodec, read_telemetry_log

pytest.importorskip("pymavlink")


def packets(number: int) -> list[bytes]:
    codec = MavlinkCodec(7, 1)
    return [codec.encode("NAMED_VALUE_FLOAT", time_boot_ms=k, name=b"speed", value=k / 4) for k in range(number)]


@given(st.lists(st.integers(1, 40), min_size=1, max_size=60))
def test_cuts_change_nothing(sizes: list[int]) -> None:
    data, decoder, found = b"".join(packets(5)), MavlinkCodec(255, 191), []
    for size in (*sizes, len(data)):
        found += decoder.decode(data[:size])
        data = data[size:]
    assert [(message.get_srcSystem(), message.value) for message in found] == [(7, k / 4) for k in range(5)]
    assert decoder.bytes_bad == 0


def test_a_flipped_bit_costs_one_message_and_is_counted() -> None:
    first, second, third = packets(3)
    damaged = bytearray(second)
    damaged[14] ^= 0x10
    decoder = MavlinkCodec(255, 191)
    assert [message.value for message in decoder.decode(first + bytes(damaged) + third)] == [0.0, 0.5]
    assert decoder.bytes_bad == len(second)


def test_sequence_numbers_count_on() -> None:
    assert [packet[4] for packet in packets(258)][-3:] == [255, 0, 1]


def test_a_field_that_is_missing_is_told() -> None:
    with pytest.raises(TypeError, match="value"):
        MavlinkCodec(1, 1).encode("NAMED_VALUE_FLOAT", time_boot_ms=0, name=b"speed")


def test_telemetry_log_with_rubbish_between() -> None:
    first, second = packets(2)
    log = struct.pack(">Q", 5) + first + b"\xfd\x00rubbish" + struct.pack(">Q", 9) + second
    assert [(stamp, message.value) for stamp, message in read_telemetry_log(log)] == [(5000, 0.0), (9000, 0.25)]
