"""The UDP ends: bound where asked, refused in one sentence, counted exactly."""

from __future__ import annotations

import socket
import time

import pytest

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.video.core.packets import stream_ssrcs
from tams_app.video.live.udp import UdpSocket, udp_sink, udp_source

pytestmark = pytest.mark.waiting


def test_a_free_port_is_told_and_belongs_to_the_host_asked_for() -> None:
    bound = UdpSocket("receiver of view eih")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as elsewhere:
        elsewhere.bind(("127.0.0.2", bound.port))
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here,
        pytest.raises(OSError, match="in use"),
    ):
        here.bind(("127.0.0.1", bound.port))
    bound.close()
    bound.close()


def test_a_connected_socket_takes_what_its_peer_sends_and_nothing_from_before() -> None:
    """Also while its peer is gone, and once it is back: a helper may be started anew."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        peer.bind(("127.0.0.1", 0))
        address = peer.getsockname()
        bound = UdpSocket("receiver of view eih")
        for one in (peer, other):
            one.sendto(b"before", ("127.0.0.1", bound.port))
        bound.connect(*address)
        pipeline = gst.parse_pipeline(
            f"{udp_source('in', 'application/x-rtcp')} ! appsink name=got async=false sync=false "
            f"fakesrc is-live=true ! identity sleep-time=5000 ! {udp_sink('out', *address)}"
        )
        for end in ("in", "out"):
            bound.attach(pipeline.get_by_name(end))
        gst.set_playing(pipeline, "the ends")
        got = pipeline.get_by_name("got")
        other.sendto(b"not ours", ("127.0.0.1", bound.port))
        peer.sendto(b"first", ("127.0.0.1", bound.port))
        assert pulled(got) == b"first"
        peer.close()  # what is sent there is refused from now on
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as again:
            time.sleep(0.1)
            again.bind(address)
            again.sendto(b"again", ("127.0.0.1", bound.port))
            assert pulled(got) == b"again"
            assert gst.poll_bus(pipeline) == ""
        gst.shut_down(pipeline)
        bound.close()


def pulled(appsink: object) -> bytes:
    sample = appsink.emit("try-pull-sample", 10 * gst.load().Gst.SECOND)  # type: ignore[attr-defined]
    buffer = sample.get_buffer()
    return bytes(buffer.extract_dup(0, buffer.get_size()))


def test_no_two_streams_share_an_ssrc() -> None:
    config = VideoConfig()
    numbers = [number for view in config.views for number in stream_ssrcs(config, view)]
    assert len(set(numbers)) == 4 * len(config.views)
