"""The configured encoder and decoder, as this machine has them."""

from __future__ import annotations

from dataclasses import replace

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.errors import SetupError
from tams_app.video.core.codecs import DECODERS, ENCODERS, Codecs


def installed_codecs(config: VideoConfig) -> Codecs:
    """What `config.encoder` and `config.decoder` name; SetupError if this machine lacks it."""
    for key, element in (("encoder", config.encoder), ("decoder", config.decoder)):
        if missing := gst.missing_elements((element,)):
            default = VideoConfig.model_fields[key].default
            raise SetupError(
                f"video.{key}: GStreamer lacks {element}; install {missing[element]}, or leave the "
                f"key out for {default}"
            )
    encoder, decoder = ENCODERS[config.encoder], DECODERS[config.decoder]
    return Codecs(
        replace(encoder, settings=gst.known_settings(encoder.element, encoder.settings)),
        replace(decoder, settings=gst.known_settings(decoder.element, decoder.settings)),
    )
