"""The process that tries an encoder or decoder with ten frames of every view, as a session would.

Each frame must come out before the next goes in: a codec that reorders frames or keeps some back
would add their time to what the operator sees.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from itertools import product
from typing import Any, TypeVar

import numpy as np

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.errors import SetupError, TamsError
from tams_app.runtime.process import HelperSide
from tams_app.units import NS_PER_S
from tams_app.video.core import pipelines
from tams_app.video.core.codecs import X264, Decoder, Encoder

FRAMES = 10
KEYFRAME_ASKED = 7  # the frame before which one is asked for
RATE_CHANGED = 4  # the frame before which the bitrate is
KBPS = 2000
_FRAME_NS = NS_PER_S // 30
_FIRST_FRAME_NS, _FRAME_WAIT_NS = 5 * NS_PER_S, NS_PER_S

_Codec = TypeVar("_Codec", Encoder, Decoder)


def main() -> None:
    """Answer with what the codec is like here, or with the reason why it is refused."""
    helper = HelperSide()
    asked = helper.specification
    try:
        config = VideoConfig.model_validate(asked["video"])
        if "encoder" in asked:
            encoder = fitted(Encoder(**asked["encoder"]))
            try_encoder(encoder, config)
            helper.ready(settings=encoder.settings, adjustable=encoder.adjustable)
        else:
            decoder = fitted(Decoder(**asked["decoder"]))
            try_decoder(decoder, config)
            helper.ready(settings=decoder.settings)
    except TamsError as error:
        helper.fail(str(error))


def fitted(codec: _Codec) -> _Codec:
    """The codec with those of its settings that the element has here."""
    Gst = gst.load().Gst
    element = Gst.ElementFactory.make(codec.element)
    if element is None:
        raise SetupError(f"{codec.element} cannot be made")
    known = {
        setting: element.find_property(setting.partition("=")[0]) for setting in codec.settings
    }
    codec = replace(codec, settings=tuple(setting for setting in known if known[setting]))
    if isinstance(codec, Decoder):
        return codec
    rate = element.find_property(codec.rate_property)
    if rate is None:
        raise SetupError(f"{codec.element} has no {codec.rate_property}")
    return replace(codec, adjustable=bool(rate.flags & Gst.PARAM_MUTABLE_PLAYING))


def try_encoder(encoder: Encoder, config: VideoConfig) -> None:
    """SetupError unless it makes of each frame at once what a sender needs."""
    chain = f"{encoder.launch(config, KBPS)} ! h264parse ! video/x-h264,alignment=au"
    with _trials(encoder.element, chain, config) as trials:
        for number, trial in product(range(FRAMES), trials):
            if number == RATE_CHANGED and encoder.adjustable:
                rate = encoder.rate_text(KBPS // 4)
                gst.set_from_text(trial.codec("encoder"), encoder.rate_property, rate)
            if number == KEYFRAME_ASKED:
                trial.ask_for_keyframe()
            is_keyframe = trial.frame(number)
            if number in (0, KEYFRAME_ASKED) and not is_keyframe:
                raise SetupError(f"{encoder.element} makes no keyframe when it must")
            unasked = number in (1, KEYFRAME_ASKED + 1) and config.keyframe_interval > FRAMES
            if unasked and is_keyframe:
                raise SetupError(f"{encoder.element} makes keyframes without being asked")


def try_decoder(decoder: Decoder, config: VideoConfig) -> None:
    """SetupError unless it gives back each frame at once."""
    chain = f"{X264.launch(config, KBPS)} ! h264parse ! {decoder.launch}"
    with _trials(decoder.element, chain, config) as trials:
        for number, trial in product(range(FRAMES), trials):
            trial.frame(number)


@contextmanager
def _trials(name: str, chain: str, config: VideoConfig) -> Iterator[list[_Trial]]:
    """One for each view: the hardware may not have as many."""
    with ExitStack() as stack:
        yield [stack.enter_context(closing(_Trial(name, chain, config))) for _ in config.views]


class _Trial:
    """One view's codec between an appsrc and an appsink."""

    def __init__(self, name: str, chain: str, config: VideoConfig) -> None:
        self._name = name
        size = config.width * config.height * 3 // 2
        self._texture = np.random.default_rng(0).integers(64, 192, size, np.uint8)
        self._pipeline = gst.parse_pipeline(
            f'appsrc name=in is-live=true format=time caps="{pipelines.raw_caps(config)}" '
            f"! {chain} ! appsink name=out sync=false async=false"
        )
        self._entry = self._pipeline.get_by_name("in")
        self._exit = self._pipeline.get_by_name("out")
        gst.set_playing(self._pipeline, name)

    def codec(self, name: str) -> Any:
        return self._pipeline.get_by_name(name)

    def ask_for_keyframe(self) -> None:
        modules = gst.load()
        event = modules.GstVideo.video_event_new_upstream_force_key_unit(
            modules.Gst.CLOCK_TIME_NONE, True, 0
        )
        self._exit.get_static_pad("sink").push_event(event)

    def frame(self, number: int) -> bool:
        """Put a frame; True if it comes out as a keyframe. SetupError if another or none does."""
        Gst = gst.load().Gst
        picture = np.roll(self._texture, 2 * number)  # moves: no cut to a new scene
        self._entry.emit("push-buffer", gst.raw_buffer(picture, number * _FRAME_NS, _FRAME_NS))
        wait_ns = _FIRST_FRAME_NS if number == 0 else _FRAME_WAIT_NS
        sample = self._exit.emit("try-pull-sample", wait_ns)
        if reason := gst.poll_bus(self._pipeline):
            raise SetupError(f"{self._name} fails: {reason}")
        if sample is None:
            raise SetupError(f"{self._name} keeps frames back: none came of frame {number}")
        buffer = sample.get_buffer()
        running_ns = sample.get_segment().to_running_time(Gst.Format.TIME, buffer.pts)
        if abs(running_ns - number * _FRAME_NS) > _FRAME_NS // 2:
            raise SetupError(f"{self._name} gives frames in another order")
        return not buffer.has_flags(Gst.BufferFlags.DELTA_UNIT)

    def close(self) -> None:
        gst.shut_down(self._pipeline)


if __name__ == "__main__":
    main()
