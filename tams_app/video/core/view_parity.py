"""The sending side of one view's parity, and what the decision about it is made from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tams_app.records import Image
from tams_app.video.core.parity import ParityEncoder

_GRID = 16  # pixels between two that are looked at
_GREEN = 1
_CHANGE = 12  # of 255: more than a camera's noise
_SMOOTHING = 1 / 30  # a second of frames


class ViewParity:
    """Protects one view's frames; `groups` may be set by any thread.

    Attributes:
        groups: parity packets for each frame, 0 for none.
        packets_per_frame: media packets, smoothed over a second.
        changed_share: of the picture since the frame before, smoothed over a second.
    """

    def __init__(self, ssrc: int, numbered: bool = False) -> None:
        """`numbered`: for the receiver's feedback (`ParityEncoder`)."""
        self.groups = 0
        self.packets_per_frame = 1.0
        self.changed_share = 0.0
        self._encoder = ParityEncoder(ssrc, numbered)
        self._last: NDArray[np.int16] | None = None

    def captured(self, image: Image) -> None:
        """A frame that will be encoded: 20 µs."""
        seen = image[_GRID // 2 :: _GRID, _GRID // 2 :: _GRID, _GREEN].astype(np.int16)
        if self._last is not None and seen.shape == self._last.shape:
            changed = float(np.mean(np.abs(seen - self._last) > _CHANGE))
            self.changed_share += _SMOOTHING * (changed - self.changed_share)
        self._last = seen

    def protect(self, packets: Sequence[bytes]) -> list[bytes]:
        """The parity packets to send behind the packets of one frame."""
        self.packets_per_frame += _SMOOTHING * (len(packets) - self.packets_per_frame)
        return self._encoder.protect(packets, self.groups) if self.groups else []
