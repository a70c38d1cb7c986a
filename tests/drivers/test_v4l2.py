"""Request numbers and sizes against those of a C program compiled over the kernel's headers (x86_64)."""

from __future__ import annotations

import struct

import pytest

from drivers import v4l2

COMPILED = {
    "QUERYCAP": 0x80685600,
    "ENUM_FMT": 0xC0405602,
    "S_FMT": 0xC0D05605,
    "REQBUFS": 0xC0145608,
    "QUERYBUF": 0xC0585609,
    "QBUF": 0xC058560F,
    "DQBUF": 0xC0585611,
    "STREAMON": 0x40045612,
    "STREAMOFF": 0x40045613,
    "S_PARM": 0xC0CC5616,
    "ENUM_FRAMESIZES": 0xC02C564A,
    "ENUM_FRAMEINTERVALS": 0xC034564B,
    "UVC_CONTROL_QUERY": 0xC0107521,
}


@pytest.mark.parametrize("name", COMPILED)
def test_request_numbers_are_the_kernels(name):
    assert getattr(v4l2, name) == COMPILED[name]


@pytest.mark.parametrize(
    ("layout", "offsets"),
    [
        (v4l2.CAPABILITY, {1: 16, 2: 48, 4: 84, 5: 88}),
        (v4l2.FORMAT_DESCRIPTION, {3: 12, 4: 44}),
        (v4l2.IMAGE_FORMAT, {1: 8, 3: 16, 5: 24, 6: 28}),
        (v4l2.BUFFER, {2: 8, 3: 12, 4: 16, 5: 24, 7: 56, 8: 60, 9: 64, 10: 72}),
        (v4l2.STREAM_PARAMETERS, {1: 4, 3: 12}),
        (v4l2.FRAME_SIZE, {1: 4, 2: 8, 3: 12}),
        (v4l2.FRAME_INTERVAL, {2: 8, 4: 16, 5: 20}),
        (v4l2.EXTENSION_QUERY, {2: 2, 3: 4, 4: 8}),
    ],
)
def test_fields_lie_where_the_compiler_puts_them(layout, offsets):
    zero = list(layout.unpack(bytes(layout.size)))
    for place, offset in offsets.items():
        fields = list(zero)
        fields[place] = b"\x01" if isinstance(zero[place], bytes) else 1
        assert layout.pack(*fields).index(1) == offset


def test_a_pixel_format_is_its_four_letters():
    assert v4l2.fourcc("Z16 ") == v4l2.Z16 == 0x2036315A == struct.unpack("<I", b"Z16 ")[0]
    assert v4l2.fourcc_text(v4l2.fourcc("YUYV")) == "YUYV"
    with pytest.raises(ValueError, match="expected four characters"):
        v4l2.fourcc("Z16")
