"""The process that plays the tones: whatever a sound system does, the application does not wait.

    python -m tams_app.faces.sounds.process '{"sink": …}'

It receives over its standard input which tone to play; a newer one ends the one that sounds.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from tams_app import gst
from tams_app.errors import SetupError
from tams_app.faces.sounds.tones import TONES, Tone
from tams_app.runtime.process import HelperSide
from tams_app.units import NS_PER_MS

_POLL_S = 0.02
_RATE_HZ, _PIECE_MS = 48_000, 10
_VOLUME = 0.4  # of the device's own
_ELEMENTS = ("audiotestsrc", "audioconvert", "audioresample", "autoaudiosink")


def main() -> None:
    """Play what is requested until standard input closes."""
    side = HelperSide()
    sink, played = str(side.specification["sink"]), 0
    try:
        gst.require_elements(_ELEMENTS)
        _check(sink)
    except SetupError as error:
        side.fail(f"no sound can be played here: {error}")
        return
    side.ready()
    while not side.stop_requested.wait(_POLL_S):
        reported = side.received
        if reported and reported["number"] != played:
            played = reported["number"]
            _play(TONES[reported["tone"]], sink, partial(_has_news, side, reported))


def _has_news(side: HelperSide, reported: dict[str, Any]) -> bool:
    return side.received is not reported or side.stop_requested.is_set()


def _check(sink: str) -> None:
    """SetupError if there is no device: `autoaudiosink` would take a silent one in its place."""
    pipeline = gst.parse_pipeline(f"audiotestsrc ! audioconvert ! audioresample ! {sink}")
    kinds = gst.load().Gst.MessageType
    try:
        pipeline.set_state(gst.load().Gst.State.READY)
        if message := pipeline.get_bus().pop_filtered(kinds.ERROR | kinds.WARNING):
            is_error = message.type == kinds.ERROR
            error, _ = message.parse_error() if is_error else message.parse_warning()
            raise SetupError(error.message.rstrip("."))
    finally:
        gst.shut_down(pipeline)


def _play(tone: Tone, sink: str, is_over: Callable[[], bool]) -> None:
    """Play it to its end, or until `is_over`."""
    pipeline = gst.parse_pipeline(
        f"audiotestsrc wave={tone.wave} freq={tone.hz} volume={_VOLUME} "
        f"samplesperbuffer={_RATE_HZ * _PIECE_MS // 1000} num-buffers={tone.ms // _PIECE_MS} "
        f"! audio/x-raw,rate={_RATE_HZ},channels=1 ! audioconvert ! audioresample ! {sink}"
    )
    kinds = gst.load().Gst.MessageType
    try:
        gst.set_playing(pipeline, "the sound")
        bus = pipeline.get_bus()
        while not is_over():
            if bus.timed_pop_filtered(_PIECE_MS * NS_PER_MS, kinds.EOS | kinds.ERROR):
                break
    finally:
        gst.shut_down(pipeline)


if __name__ == "__main__":
    main()
