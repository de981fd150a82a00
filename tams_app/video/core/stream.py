"""What is decided of one view's stream before it starts."""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.config import VideoConfig
from tams_app.video.core.codecs import X264, Encoder


@dataclass(frozen=True, slots=True)
class StreamSettings:
    """How one view is encoded and sent.

    rtx: packets are kept to be sent again (`RepairRule.rtx`). start_kbps: the target until the
    first is set; below source_drop_below_kbps whole frames are dropped. encoder: one that is here
    (`installed_codecs`).
    """

    view: str
    config: VideoConfig
    rtx: bool
    start_kbps: float
    source_drop_below_kbps: float
    encoder: Encoder = X264
