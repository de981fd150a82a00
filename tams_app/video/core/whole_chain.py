"""Tracking of whole frames of one view: as they were encoded, every packet of their chain here.

A frame is predicted from the frames before it, back to the last keyframe: its chain. A packet that
is missing damages its frame and all that follow, up to a keyframe of which all packets are here.
Decoders do not report it (FINDINGS 4), so it is inferred from the gaps in the sequence numbers that
the
depayloader meets: of what was resent or restored in time it meets none. 3 s without a frame are a
gap, too: the numbers may have wrapped meanwhile. `concealment` infers the same afterwards, from the
fates of all packets; there a frame is concealed that is not whole here.
"""

from __future__ import annotations

_LENGTH_BYTES = 4  # before each NAL unit, as the depayloader puts them together (`avc`)
_TYPE, _IDR = 0x1F, 5


class WholeChain:
    """Judges the access units of one view, in the order of decoding."""

    def __init__(self) -> None:
        self.unbroken = False  # nothing can be predicted before the first keyframe
        self._gap_timestamp: int | None = None
        self._after_gap = False

    def gap(self, timestamp: int) -> None:
        """Packets are missing before the first one to come of the frame with this RTP timestamp.

        Which frame they were of is not known: it may be this one.
        """
        self.unbroken = False
        self._gap_timestamp, self._after_gap = timestamp, True

    def access_unit(self, timestamp: int, has_idr: bool, has_end: bool) -> bool:
        """Take in the end of a frame; True if it is whole.

        `has_end`: its last packet is here, as RTP's marker bit shows. The depayloader may hand out
        the remains of a frame before what follows the gap, or remains within what follows it.
        """
        is_complete = has_end and not self._after_gap and timestamp != self._gap_timestamp
        self._after_gap = False
        self.unbroken = is_complete and (has_idr or self.unbroken)
        return self.unbroken


def has_idr(access_unit: bytes) -> bool:
    """True if a slice of an IDR picture (H.264) is in it: no later frame needs one before it.

    Parameter sets alone make no keyframe, though GStreamer flags them as one.
    """
    at = 0
    while at + _LENGTH_BYTES < len(access_unit):
        if access_unit[at + _LENGTH_BYTES] & _TYPE == _IDR:
            return True
        at += _LENGTH_BYTES + int.from_bytes(access_unit[at : at + _LENGTH_BYTES])
    return False
