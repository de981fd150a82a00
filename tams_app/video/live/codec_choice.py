"""Choice of a session's encoder and decoder: those asked for if they work here, else software.

What works is tried in a process of its own (`codec_probe`): a driver may hang or crash.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import partial
from typing import Any, TypeVar

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.errors import HelperError
from tams_app.runtime.process import HelperProcess
from tams_app.video.core.codecs import AVDEC, DECODERS, ENCODERS, X264, Codecs, Decoder, Encoder

PROBE_TIMEOUT_S = 8.0
_END_S = 0.3

_Codec = TypeVar("_Codec", Encoder, Decoder)


def choose_codecs(
    config: VideoConfig, starts_at_capacity: bool, timeout_s: float = PROBE_TIMEOUT_S
) -> Codecs:
    """The codecs of `config.encoder` and `config.decoder` for all views.

    `auto` is the first that works, hardware before software. Software is not probed. An encoder
    that keeps the bitrate it begins with is used only if it is named and `starts_at_capacity`: the
    budgets that learn the capacity begin at the floors.
    """
    choose = partial(_choose, config, timeout_s)
    encoder, of_encoder = choose("encoder", config.encoder, ENCODERS, X264)
    decoder, of_decoder = choose("decoder", config.decoder, DECODERS, AVDEC)
    if not encoder.adjustable:
        remark = f"video.encoder: {encoder.element} cannot change its bitrate while it plays"
        if starts_at_capacity:
            remark += (
                ": each view keeps the one that it begins with, and frames are left out where its "
                "target is less"
            )
        else:
            encoder = X264
            remark += f", and would stay at the floor; {encoder.element} is used"
        of_encoder += (remark,)
    return Codecs(encoder, decoder, of_encoder + of_decoder)


def _choose(
    config: VideoConfig,
    timeout_s: float,
    key: str,
    word: str,
    known: dict[str, _Codec],
    software: _Codec,
) -> tuple[_Codec, tuple[str, ...]]:
    """The codec, and why each one is not used that was asked for or is there."""
    chosen, automatic = software, word == "auto"
    refusals = []
    for codec in known.values() if automatic else (known[word],):
        if codec is software:
            break
        if gst.missing_elements((codec.element,)):
            if not automatic:
                refusals.append(f"{codec.element} is not on this machine")
            continue
        try:
            fitted = replace(codec, **_probed(key, codec, config, timeout_s))
        except HelperError as refusal:
            refusals.append(str(refusal))
            continue
        if automatic and isinstance(fitted, Encoder) and not fitted.adjustable:
            refusals.append(f"{codec.element} cannot change its bitrate while it plays")
            continue
        chosen = fitted
        break
    return chosen, tuple(
        f"video.{key}: {refusal}; {chosen.element} is used" for refusal in refusals
    )


def _probed(
    kind: str, codec: Encoder | Decoder, config: VideoConfig, timeout_s: float
) -> dict[str, Any]:
    """The measured properties of the codec; HelperError with the reason if it does not work."""
    specification = {kind: asdict(codec), "video": config.model_dump(mode="json")}
    probe = HelperProcess(
        f"the probe of {codec.element}", "tams_app.video.live.codec_probe", specification, None
    )
    probe.start()
    try:
        found = probe.wait_ready(timeout_s)
    finally:
        probe.stop(_END_S)
    return found | {"settings": tuple(found["settings"])}
