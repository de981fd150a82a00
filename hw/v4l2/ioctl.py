"""The few questions TAMS asks a V4L2 device itself (linux/videodev2.h); v4l2src streams."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
from collections.abc import Callable, Iterator
from itertools import count
from types import TracebackType
from typing import TypeVar

CAPTURES_VIDEO = 0x0000_0001  # V4L2_CAP_VIDEO_CAPTURE
HAS_OWN_CAPABILITIES = 0x8000_0000  # V4L2_CAP_DEVICE_CAPS
COMPRESSED = 0x0001  # V4L2_FMT_FLAG_COMPRESSED
DISCRETE = 1  # V4L2_FRMSIZE_TYPE_DISCRETE and V4L2_FRMIVAL_TYPE_DISCRETE
CONTROL_CLASS = 6  # V4L2_CTRL_TYPE_CTRL_CLASS: a heading, not a control
UNUSABLE = 0x0001 | 0x0004  # V4L2_CTRL_FLAG_DISABLED, _READ_ONLY

_CAPTURE = 1  # V4L2_BUF_TYPE_VIDEO_CAPTURE
_NEXT_CONTROL = 0x8000_0000  # V4L2_CTRL_FLAG_NEXT_CTRL
_END = (errno.EINVAL, errno.ENOTTY)  # no more of them; none at all
_u32, _s32, _char = ctypes.c_uint32, ctypes.c_int32, ctypes.c_char


class Capability(ctypes.Structure):
    """struct v4l2_capability"""

    _fields_ = (
        ("driver", _char * 16),
        ("card", _char * 32),
        ("bus_info", _char * 32),
        ("version", _u32),
        ("capabilities", _u32),
        ("device_caps", _u32),
        ("reserved", _u32 * 3),
    )


class Format(ctypes.Structure):
    """struct v4l2_fmtdesc"""

    _fields_ = (
        ("index", _u32),
        ("type", _u32),
        ("flags", _u32),
        ("description", _char * 32),
        ("pixelformat", _u32),
        ("mbus_code", _u32),
        ("reserved", _u32 * 3),
    )


class FrameSize(ctypes.Structure):
    """struct v4l2_frmsizeenum; `size`: width, height, or min, max, step of width, then height"""

    _fields_ = (
        ("index", _u32),
        ("pixel_format", _u32),
        ("type", _u32),
        ("size", _u32 * 6),
        ("reserved", _u32 * 2),
    )


class FrameInterval(ctypes.Structure):
    """struct v4l2_frmivalenum; `interval`: a fraction, or shortest, longest and step"""

    _fields_ = (
        ("index", _u32),
        ("pixel_format", _u32),
        ("width", _u32),
        ("height", _u32),
        ("type", _u32),
        ("interval", _u32 * 6),
        ("reserved", _u32 * 2),
    )


class ControlInfo(ctypes.Structure):
    """struct v4l2_queryctrl"""

    _fields_ = (
        ("id", _u32),
        ("type", _u32),
        ("name", _char * 32),
        ("minimum", _s32),
        ("maximum", _s32),
        ("step", _s32),
        ("default", _s32),
        ("flags", _u32),
        ("reserved", _u32 * 2),
    )


class ControlValue(ctypes.Structure):
    """struct v4l2_control"""

    _fields_ = (("id", _u32), ("value", _s32))


S = TypeVar("S", bound=ctypes.Structure)

_READ, _READ_WRITE = 2, 3


def _request(direction: int, number: int, structure: type[ctypes.Structure]) -> int:
    """_IOR and _IOWR of linux/ioctl.h."""
    return direction << 30 | ctypes.sizeof(structure) << 16 | ord("V") << 8 | number


_QUERYCAP = _request(_READ, 0, Capability)
_ENUM_FMT = _request(_READ_WRITE, 2, Format)
_G_CTRL = _request(_READ_WRITE, 27, ControlValue)
_S_CTRL = _request(_READ_WRITE, 28, ControlValue)
_QUERYCTRL = _request(_READ_WRITE, 36, ControlInfo)
_ENUM_FRAMESIZES = _request(_READ_WRITE, 74, FrameSize)
_ENUM_FRAMEINTERVALS = _request(_READ_WRITE, 75, FrameInterval)


class V4l2Device:
    """An open video node; another process may stream from it. Every call may raise OSError."""

    def __init__(self, node: str) -> None:
        self._fd = os.open(node, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def __enter__(self) -> V4l2Device:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        os.close(self._fd)

    def capability(self) -> Capability:
        """Name, bus and abilities."""
        return self._ask(_QUERYCAP, Capability())

    def formats(self) -> Iterator[Format]:
        """The pixel formats it can capture."""
        return self._enumerate(_ENUM_FMT, lambda index: Format(index=index, type=_CAPTURE))

    def frame_sizes(self, pixel_format: int) -> Iterator[FrameSize]:
        """The frame sizes of one format; a single range if they are not discrete."""
        return self._enumerate(
            _ENUM_FRAMESIZES, lambda index: FrameSize(index=index, pixel_format=pixel_format)
        )

    def frame_intervals(
        self, pixel_format: int, width: int, height: int
    ) -> Iterator[FrameInterval]:
        """The frame intervals [s] of one size; a single range if they are not discrete."""
        return self._enumerate(
            _ENUM_FRAMEINTERVALS,
            lambda index: FrameInterval(
                index=index, pixel_format=pixel_format, width=width, height=height
            ),
        )

    def controls(self) -> Iterator[ControlInfo]:
        """Everything that can be set, headings left out."""
        last = 0
        while self._next(_QUERYCTRL, found := ControlInfo(id=last | _NEXT_CONTROL)):
            last = found.id
            if found.type != CONTROL_CLASS and not found.flags & UNUSABLE:
                yield found

    def control(self, control_id: int) -> int:
        """The present value of a control."""
        return int(self._ask(_G_CTRL, ControlValue(id=control_id)).value)

    def set_control(self, control_id: int, value: int) -> None:
        """Set a control; drivers may round the value."""
        self._ask(_S_CTRL, ControlValue(id=control_id, value=value))

    def _enumerate(self, request: int, asked: Callable[[int], S]) -> Iterator[S]:
        """What the driver answers to index 0, 1, ...; a range stands alone."""
        for index in count():
            found = asked(index)
            if not self._next(request, found):
                return
            yield found
            if isinstance(found, FrameSize | FrameInterval) and found.type != DISCRETE:
                return

    def _ask(self, request: int, content: S) -> S:
        fcntl.ioctl(self._fd, request, content)
        return content

    def _next(self, request: int, content: ctypes.Structure) -> bool:
        """Fill `content`; False if the enumeration has ended."""
        try:
            fcntl.ioctl(self._fd, request, content)
        except OSError as error:
            if error.errno in _END:
                return False
            raise
        return True
