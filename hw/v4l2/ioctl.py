"""What a V4L2 device answers, as linux/videodev2.h numbers and lays out its questions."""

from __future__ import annotations

import errno
import fcntl
import struct
from collections.abc import Iterator
from io import FileIO
from typing import Any

# Number, and layout of the structure that goes there and back.
QUERYCAP = 0, "<16s32s32s6I"  # driver, card, bus, version, capabilities, those of the node
ENUM_FMT = 2, "<3I32s5I"  # index, type, flags, description, fourcc
G_CTRL = 27, "<Ii"  # id, value
S_CTRL = 28, "<Ii"
ENUM_FRAMESIZES = 74, "<11I"  # index, fourcc, kind, width and height or their ranges
ENUM_FRAMEINTERVALS = 75, "<13I"  # index, fourcc, width, height, kind, one or two fractions [s]
QUERY_EXT_CTRL = 103, "<2I32sqqQqI39I"  # id, type, name, minimum, maximum, step, default, flags

_MOST = 128  # answers of a list
_END = (errno.EINVAL, errno.ENOTTY, errno.ENODATA, errno.EPIPE)


def ask(device: FileIO, question: tuple[int, str], *given: int) -> tuple[Any, ...]:
    """The structure that the driver answers with; `given`: how that of the question begins.

    OSError if it refuses.
    """
    number, layout = question
    size = struct.calcsize(layout)
    direction = 2 if question is QUERYCAP else 3  # read, or written and read
    asked = b"".join((one & 0xFFFF_FFFF).to_bytes(4, "little") for one in given)
    request = direction << 30 | size << 16 | ord("V") << 8 | number
    return struct.unpack(layout, fcntl.ioctl(device, request, asked.ljust(size, b"\0")))


def every(
    device: FileIO,
    question: tuple[int, str],
    *given: int,
    next_flag: int = 0,
) -> Iterator[tuple[Any, ...]]:
    """All answers of a list, whose question begins with an index.

    `next_flag`: the question is instead the number of the last answer with this flag, which asks
    for the one after it.
    """
    index = next_flag
    for _ in range(_MOST):
        try:
            answer = ask(device, question, index, *given)
        except OSError as error:
            if error.errno in _END:
                return
            raise
        yield answer
        index = answer[0] | next_flag if next_flag else answer[0] + 1
