"""Video4Linux2 as bytes: request numbers and struct layouts of <linux/videodev2.h> and <linux/uvcvideo.h>.

For systems with 64-bit pointers and little-endian words (x86_64, aarch64); padding is written out, so the layouts are
the same everywhere. Sizes and offsets were compared with a compiled program over the kernel's headers.
"""

from __future__ import annotations

import struct

# struct v4l2_capability: driver, card, bus, version, capabilities, capabilities of this node
CAPABILITY = struct.Struct("<16s32s32sIII12x")
# struct v4l2_fmtdesc: index, type, flags, description, pixel format
FORMAT_DESCRIPTION = struct.Struct("<III32sI16x")
# struct v4l2_format with v4l2_pix_format: type, width, height, pixel format, field, bytes per line, bytes per image
IMAGE_FORMAT = struct.Struct("<I4xIIIIII176x")
# struct v4l2_requestbuffers: count, type, memory
REQUEST_BUFFERS = struct.Struct("<III8x")
# struct v4l2_buffer: index, type, bytes used, flags, field, seconds, microseconds, sequence, memory, offset, length
BUFFER = struct.Struct("<IIIII4xqq16xIII4xI12x")
# struct v4l2_streamparm with v4l2_captureparm: type, capability, mode, numerator and denominator of the interval in s
STREAM_PARAMETERS = struct.Struct("<IIIII184x")
# struct v4l2_frmsizeenum: index, pixel format, type, width, height
FRAME_SIZE = struct.Struct("<IIIII24x")
# struct v4l2_frmivalenum: index, pixel format, width, height, type, numerator and denominator of the interval in s
FRAME_INTERVAL = struct.Struct("<IIIIIII24x")
# enum v4l2_buf_type as the bare int that STREAMON and STREAMOFF take
BUFFER_TYPE = struct.Struct("<I")
# struct uvc_xu_control_query: unit, selector, query, size, address of the data
EXTENSION_QUERY = struct.Struct("<BBBxH2xQ")

_WRITES, _READS = 1, 2  # as seen by the program: what it hands over, what it gets


def request_number(direction: int, group: str, number: int, layout: struct.Struct) -> int:
    """Return the number of an ioctl as <asm-generic/ioctl.h> builds it."""
    return direction << 30 | layout.size << 16 | ord(group) << 8 | number


QUERYCAP = request_number(_READS, "V", 0, CAPABILITY)
ENUM_FMT = request_number(_READS | _WRITES, "V", 2, FORMAT_DESCRIPTION)
S_FMT = request_number(_READS | _WRITES, "V", 5, IMAGE_FORMAT)
REQBUFS = request_number(_READS | _WRITES, "V", 8, REQUEST_BUFFERS)
QUERYBUF = request_number(_READS | _WRITES, "V", 9, BUFFER)
QBUF = request_number(_READS | _WRITES, "V", 15, BUFFER)
DQBUF = request_number(_READS | _WRITES, "V", 17, BUFFER)
STREAMON = request_number(_WRITES, "V", 18, BUFFER_TYPE)
STREAMOFF = request_number(_WRITES, "V", 19, BUFFER_TYPE)
S_PARM = request_number(_READS | _WRITES, "V", 22, STREAM_PARAMETERS)
ENUM_FRAMESIZES = request_number(_READS | _WRITES, "V", 74, FRAME_SIZE)
ENUM_FRAMEINTERVALS = request_number(_READS | _WRITES, "V", 75, FRAME_INTERVAL)
UVC_CONTROL_QUERY = request_number(_READS | _WRITES, "u", 0x21, EXTENSION_QUERY)

CAP_VIDEO_CAPTURE = 0x00000001
CAP_META_CAPTURE = 0x00800000
CAP_STREAMING = 0x04000000
CAP_DEVICE_CAPS = 0x80000000  # the field "capabilities of this node" is filled in

TYPE_VIDEO_CAPTURE = 1  # V4L2_BUF_TYPE_VIDEO_CAPTURE
MEMORY_MMAP = 1
FIELD_NONE = 1  # progressive
DISCRETE = 1  # V4L2_FRMSIZE_TYPE_DISCRETE, V4L2_FRMIVAL_TYPE_DISCRETE
CAP_TIMEPERFRAME = 0x1000  # the rate can be set

BUFFER_ERROR = 0x0040  # V4L2_BUF_FLAG_ERROR: the content may be damaged
TIMESTAMP_MASK = 0xE000
TIMESTAMP_MONOTONIC = 0x2000

UVC_SET_CUR, UVC_GET_CUR, UVC_GET_MIN, UVC_GET_MAX, UVC_GET_LEN = 0x01, 0x81, 0x82, 0x83, 0x85


def fourcc(code: str) -> int:
    """Return the number of a pixel format's four letters; raises ValueError for any other count."""
    if len(code) != 4:
        raise ValueError(f"pixel format {code!r}: expected four characters, pad with spaces")
    return int.from_bytes(code.encode("ascii"), "little")


def fourcc_text(number: int) -> str:
    """Return the four letters of a pixel format's number."""
    return number.to_bytes(4, "little").decode("ascii", errors="replace")


Z16 = fourcc("Z16 ")
