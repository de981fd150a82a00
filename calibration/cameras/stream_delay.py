"""From capture to shown: the product's own encoder, RTP, jitter buffer and decoder, no network."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

from tams_app.config import Config
from tams_app.errors import TamsError
from tams_app.records import DroppedFrame, EncodedFrame, Frame, Image, ShownFrame
from tams_app.runtime.clock import NS_PER_MS, NS_PER_S, Clock
from tams_app.video.networks import resolve_network
from tams_app.video.receiver import VideoReceiver
from tams_app.video.repair import repair_rule
from tams_app.video.sender import VideoSender
from tams_app.video.udp import ViewPorts

_KBPS = 2000.0  # a third of what network s2 carries
_WARM_UP = 10  # frames: the first keyframe, the decoder's start
_LAST_WAIT_NS = 500 * NS_PER_MS


def stream_delays_ms(
    view: str, config: Config, images: Iterator[tuple[Image, int]], clock: Clock
) -> list[float]:
    """From each image's capture time to when it could be shown [ms], without the first ones.

    `images` gives BGR images with capture times [ns] on `clock` at the pace of a camera. Shown is
    in the receiver's mailbox: the window's and the display's own time come on top. TamsError if
    the chain fails.
    """
    network, wanted = resolve_network(config, "none"), config.video.repair
    rule = repair_rule(network, config.video.pli_min_interval_ms, wanted)
    captured: dict[int, int] = {}
    shown: list[ShownFrame] = []
    video = config.video.model_copy(update={"first_port": 0, "bind_host": "127.0.0.1"})
    with ExitStack() as stack:
        receiver = VideoReceiver(view, video, rule, clock, shown.append)
        stack.callback(receiver.close)
        sender = VideoSender(view, video, rule.rtx, clock, _KBPS, 0.0, _ignore, _ignore)
        stack.callback(sender.close)
        ports = ViewPorts(
            video.bind_host, receiver.rtp_port, receiver.reports_port, sender.feedback_port
        )
        receiver.start(ports)
        sender.start(ports)
        for index, (image, capture_ns) in enumerate(images):
            captured[index] = capture_ns
            sender.push(Frame(view, index, capture_ns, image))
            if failure := sender.poll() or receiver.poll():
                raise TamsError(failure)
        deadline_ns = clock.now_ns() + _LAST_WAIT_NS
        while len(shown) < len(captured) and clock.now_ns() < deadline_ns:
            clock.sleep_until_ns(clock.now_ns() + NS_PER_S // config.video.fps)
    return [
        (each.shown_ns - captured[each.index]) / NS_PER_MS
        for each in shown
        if each.index >= _WARM_UP and each.index in captured
    ]


def _ignore(_: EncodedFrame | DroppedFrame) -> None:
    """Only what is shown counts here."""
