"""The chains' pieces joined without UDP, as a run in virtual time joins them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.units import NS_PER_S
from tams_app.video.core import pipelines
from tams_app.video.core.colour import i420_of
from tams_app.video.core.frame_identity import RtpTimes
from tams_app.video.core.repair import RepairRule
from tests.video.scenes import frame

pytestmark = pytest.mark.waiting

FRAME_NS = 33_400_000  # 3006 ticks of 90 kHz
RULE = RepairRule(rtx=False, latency_ms=50, pli_interval_ms=300.0)
_WAIT_NS = 20 * NS_PER_S


def app_ended(chain: str, caps: str) -> Any:
    """`chain` between an appsrc `in` and an appsink `out`."""
    pipeline = gst.parse_pipeline(
        f'appsrc name=in is-live=true format=time caps="{caps}" ! {chain} '
        "! appsink name=out sync=false async=false"
    )
    gst.set_playing(pipeline, "the chain")
    return pipeline


def pulled(pipeline: Any, wait_ns: int) -> Iterator[Any]:
    """What comes out next: a buffer, or the buffers of a list."""
    sample = pipeline.get_by_name("out").emit("try-pull-sample", wait_ns)
    if sample is None:
        return
    buffers = sample.get_buffer_list()
    if buffers is None:
        yield sample.get_buffer()
    else:
        yield from (buffers.get(number) for number in range(buffers.length()))


def packets_of(encoder: Any, index: int) -> list[bytes]:
    """All RTP packets of one frame: up to the marker bit."""
    planes = i420_of(frame(index).image)
    buffer = gst.raw_buffer(planes, index * FRAME_NS, FRAME_NS)
    encoder.get_by_name("in").emit("push-buffer", buffer)
    packets: list[bytes] = []
    while not packets or not packets[-1][1] & 0x80:
        arrived = [each.extract_dup(0, each.get_size()) for each in pulled(encoder, _WAIT_NS)]
        assert arrived, "the encoder chain gave no whole frame"
        packets += arrived
    return packets


@pytest.fixture
def encoder() -> Iterator[Any]:
    config = VideoConfig()
    pipeline = app_ended(pipelines.encoder_chain(config, "eih", 1500), pipelines.raw_caps(config))
    yield pipeline
    gst.shut_down(pipeline)


def test_encoder_and_decoder_chains_join_without_udp(encoder: Any) -> None:
    decoder = app_ended(pipelines.decoder_chain(RULE), pipelines.rtp_caps())
    sent: list[int] = []
    shown: list[int] = []
    times: RtpTimes | None = None
    for index in range(3, 33):
        for packet in packets_of(encoder, index):
            sent.append(int.from_bytes(packet[4:8], "big"))
            rtp = gst.raw_buffer(packet, index * FRAME_NS, 0)
            rtp.dts = rtp.pts
            decoder.get_by_name("in").emit("push-buffer", rtp)
        for picture in pulled(decoder, _WAIT_NS):
            assert picture.get_size() == 640 * 480 * 3 // 2
            times = times or RtpTimes(picture.pts, sent[0])
            shown.append(times.timestamp(picture.pts))
    assert gst.poll_bus(decoder) == ""
    gst.shut_down(decoder)
    assert sorted(set(sent)) == shown == [index * 3006 for index in range(3, 33)]


def test_the_same_frames_give_the_same_packets(encoder: Any) -> None:
    config = VideoConfig()
    again = app_ended(pipelines.encoder_chain(config, "eih", 1500), pipelines.raw_caps(config))
    for index in range(20):
        assert packets_of(encoder, index) == packets_of(again, index)
    gst.shut_down(again)
