"""Whether a JPEG picture arrived whole."""

from __future__ import annotations

import ctypes
import re
from functools import cache

LACKS = "is not watched for JPEGs that lack a part; install libturbojpeg0 (Ubuntu: libturbojpeg)"
_END, _SCAN = b"\xff\xd9", b"\xff\xda"  # markers: never within the data of a scan
_RESTART, _RESTARTS = re.compile(rb"\xff([\xd0-\xd7])"), bytes(range(0xD0, 0xD8))
# libjpeg's warnings of missing data. Not those of a few bytes too many before a marker: Logitech's
# cameras fill up restart intervals of whole pictures so, with up to 10 bytes as far as reported.
_DAMAGE = re.compile(rb"Premature end|Corrupt JPEG data: (?!(\d|1[0-6]) extraneous bytes)")
_GREY, _STOP_ON_WARNING, _WARNING, _SHRINK = 6, 8192, 0, 8  # turbojpeg.h; an eighth is the least


def damage_of(jpeg: bytes) -> str:
    """What is wrong with the picture, "" if nothing is found.

    Data lost within it are found by the order of restart markers and by libjpeg's first warning.
    Pictures that cannot be decoded at all are left to the decoder.
    """
    scan = jpeg.rfind(_SCAN)
    if (end := jpeg.find(_END, max(scan, 0))) < 0:
        return "JPEG pictures lack their end"
    restarts = b"".join(_RESTART.findall(jpeg, scan, end))
    in_order = (_RESTARTS * (len(restarts) // 8 + 1)).startswith(restarts)
    library = turbojpeg()
    if not in_order or (library and _DAMAGE.match(_warning(library, jpeg))):
        return "JPEG pictures lack a part"
    return ""


@cache
def turbojpeg() -> ctypes.CDLL | None:
    """The library that finds holes; None where it is not installed."""
    try:
        library = ctypes.CDLL("libturbojpeg.so.0")
    except OSError:
        return None
    library.tjInitDecompress.restype = ctypes.c_void_p
    library.tjGetErrorStr2.restype = ctypes.c_char_p
    return library


def _warning(library: ctypes.CDLL, jpeg: bytes) -> bytes:
    """libjpeg's first warning when it decodes the picture, b"" if it gives none."""
    # one for each picture: it keeps tables, and cameras leave out the standard ones
    decoder = ctypes.c_void_p(library.tjInitDecompress())
    try:
        picture = decoder, jpeg, ctypes.c_ulong(len(jpeg))
        sizes = [ctypes.c_int() for _ in range(4)]
        library.tjDecompressHeader3(*picture, *map(ctypes.byref, sizes))
        width, height = (-(-size.value // _SHRINK) for size in sizes[:2])
        how = ctypes.create_string_buffer(width * height), width, 0, height, _GREY, _STOP_ON_WARNING
        if not width * height or not library.tjDecompress2(*picture, *how):
            return b""
        is_warning = library.tjGetErrorCode(decoder) == _WARNING
        return bytes(library.tjGetErrorStr2(decoder)) if is_warning else b""
    finally:
        library.tjDestroy(decoder)
