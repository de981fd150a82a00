"""How coarsely a frame was quantised, read from its H.264 bytes.

The quantisation parameter (QP, 0 to 51) with which a picture's first slice begins: pic_init_qp of
its picture parameter set plus slice_qp_delta (ITU-T H.264, 7.3.2 and 7.3.3). Progressive pictures
of I and P slices, as x264 makes them here; anything else has no answer.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

_SLICE, _IDR_SLICE, _SPS, _PPS = 1, 5, 7, 8
_HEADER_BYTES = 64  # of a NAL unit: what is read here lies far within
_WITH_CHROMA_FORMAT = (100, 110, 122, 244, 44, 83, 86, 118, 128)
_P, _I = 0, 2
_QPS = range(52)


@dataclass(frozen=True, slots=True)
class _Sequence:
    frame_num_bits: int
    order_type: int
    order_bits: int


@dataclass(frozen=True, slots=True)
class _Picture:
    cabac: bool
    orders_fields: bool
    references: int
    weighted: bool
    init_qp: int
    redundant: bool


class SliceQp:
    """Reads one view's frames in their order; remembers the parameter sets of its keyframes."""

    def __init__(self) -> None:
        self._sequence: _Sequence | None = None
        self._pictures: dict[int, _Picture | None] = {}  # by the sets' numbers

    def read(self, data: bytes) -> int | None:
        """The QP of an Annex B access unit; None if it does not tell."""
        try:
            for kind, reference, bits in _units(data):
                if kind == _SPS:
                    self._sequence = _sequence(bits)
                elif kind == _PPS:
                    number = bits.ue()
                    self._pictures[number] = _picture(bits)
                elif kind in (_SLICE, _IDR_SLICE):
                    if self._sequence is None:
                        return None
                    return self._slice_qp(bits, kind == _IDR_SLICE, reference, self._sequence)
        except IndexError:  # the unit ends within its header
            pass
        return None

    def _slice_qp(self, bits: _Bits, idr: bool, reference: bool, sequence: _Sequence) -> int | None:
        bits.ue()
        kind = bits.ue() % 5
        picture = self._pictures.get(bits.ue())
        if kind not in (_P, _I) or picture is None:
            return None
        bits.u(sequence.frame_num_bits)
        if idr:
            bits.ue()
        if sequence.order_type == 0:
            bits.u(sequence.order_bits)
            if picture.orders_fields:
                bits.se()
        if picture.redundant:
            bits.ue()
        if kind == _P:
            _skip_references(bits, picture)
        if reference:
            _skip_marking(bits, idr)
        if picture.cabac and kind == _P:
            bits.ue()
        qp = picture.init_qp + bits.se()
        return qp if qp in _QPS else None


class _Bits:
    """Bits of one NAL unit from behind its first byte, emulation prevention removed."""

    def __init__(self, data: bytes) -> None:
        self._value = int.from_bytes(data, "big")
        self._left = 8 * len(data)

    def u(self, count: int) -> int:
        """An unsigned number of `count` bits; IndexError behind the end."""
        self._left -= count
        if self._left < 0:
            raise IndexError
        return (self._value >> self._left) & ((1 << count) - 1)

    def ue(self) -> int:
        """An Exp-Golomb number."""
        zeros = 0
        while not self.u(1):
            zeros += 1
        return (1 << zeros) - 1 + self.u(zeros)

    def se(self) -> int:
        """A signed Exp-Golomb number."""
        number = self.ue()
        return (number + 1) // 2 if number % 2 else -(number // 2)


def _units(data: bytes) -> Iterator[tuple[int, bool, _Bits]]:
    """Type, whether it is referred to, and content of each NAL unit's beginning."""
    start = data.find(b"\0\0\1")
    while 0 <= start < len(data) - 3:
        begin = start + 3
        # a slice is the last that is asked for, so its end is not looked for
        kind, reference = data[begin] & 31, bool(data[begin] >> 5 & 3)
        content = data[begin + 1 : begin + 1 + _HEADER_BYTES].replace(b"\0\0\3", b"\0\0")
        yield kind, reference, _Bits(content)
        start = data.find(b"\0\0\1", begin)


def _sequence(bits: _Bits) -> _Sequence | None:
    profile = bits.u(8)
    bits.u(16)
    bits.ue()
    if profile in _WITH_CHROMA_FORMAT:
        if bits.ue() == 3:
            return None  # separate colour planes put a field into the slice header
        bits.ue(), bits.ue()
        bits.u(1)
        if bits.u(1):
            return None  # scaling matrices
    frame_num_bits = bits.ue() + 4
    order_type = bits.ue()
    if order_type == 1:
        return None
    order_bits = bits.ue() + 4 if order_type == 0 else 0
    bits.ue()
    bits.u(1)
    bits.ue(), bits.ue()
    if not bits.u(1):
        return None  # interlaced
    return _Sequence(frame_num_bits, order_type, order_bits)


def _picture(bits: _Bits) -> _Picture | None:
    bits.ue()
    cabac, orders_fields = bool(bits.u(1)), bool(bits.u(1))
    if bits.ue():
        return None  # slice groups
    references = bits.ue() + 1
    bits.ue()
    weighted = bool(bits.u(1))
    bits.u(2)
    init_qp = 26 + bits.se()
    bits.se(), bits.se()
    bits.u(2)
    return _Picture(cabac, orders_fields, references, weighted, init_qp, bool(bits.u(1)))


def _skip_references(bits: _Bits, picture: _Picture) -> None:
    references = bits.ue() + 1 if bits.u(1) else picture.references
    if bits.u(1):
        while bits.ue() != 3:
            bits.ue()
    if picture.weighted:
        bits.ue(), bits.ue()
        for _ in range(references):
            for numbers in (2, 4):  # luma, chroma
                if bits.u(1):
                    for _ in range(numbers):
                        bits.se()


def _skip_marking(bits: _Bits, idr: bool) -> None:
    if idr:
        bits.u(2)
    elif bits.u(1):
        while (operation := bits.ue()) != 0:
            bits.ue()
            if operation == 3:
                bits.ue()
