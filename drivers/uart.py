"""What a UART makes of bytes that were sent at another speed than it listens at."""

from __future__ import annotations

import numpy as np

BITS_PER_BYTE = 10  # 8N1: start, eight data bits from the lowest, stop


def misread(data: bytes, sent_baud: int, heard_baud: int) -> bytes:
    """The bytes that a receiver at heard_baud gets from data sent back to back at sent_baud, the line idle after it.

    Sampled as hardware does, in the middle of each of its own bits after a falling edge; a missing stop bit gives 0.
    """
    if sent_baud == heard_baud or not data:
        return data
    if heard_baud <= 0 or sent_baud <= 0:  # speed 0 means "hung up"
        return b""
    octets = np.unpackbits(np.frombuffer(data, dtype=np.uint8)[:, None], axis=1, bitorder="little")
    line = np.pad(octets, ((0, 0), (1, 1)), constant_values=((0, 0), (0, 1))).reshape(-1)
    bit = sent_baud / heard_baud  # sent bits per bit of the receiver
    idle = np.ones(int(BITS_PER_BYTE * bit) + 2, dtype=np.uint8)
    line = np.concatenate((line, idle))
    falls = np.flatnonzero((line[1:] == 0) & (line[:-1] == 1)) + 1
    heard = bytearray()
    middles = (np.arange(1, BITS_PER_BYTE) + 0.5) * bit
    start = 0 if line[0] == 0 else int(falls[0]) if len(falls) else len(line)
    while start + BITS_PER_BYTE * bit < len(line):
        bits = line[(start + middles).astype(np.int64)]
        heard.append(int(np.packbits(bits[:8], bitorder="little")[0]) if bits[8] else 0)
        later = np.searchsorted(falls, start + (BITS_PER_BYTE - 0.5) * bit)
        if later == len(falls):
            break
        start = int(falls[later])
    return bytes(heard)
