"""Ports and fixed stream numbers of the views."""

from __future__ import annotations

import pytest

from tams_app.config import VideoConfig
from tams_app.video.core.packets import media_ssrc, repair_ssrc
from tams_app.video.live.udp import ViewPorts, requested_ports

pytestmark = pytest.mark.waiting


def test_without_a_first_port_any_free_ports_are_asked_for() -> None:
    assert requested_ports(VideoConfig(), "gt") == ViewPorts("127.0.0.1", 0, 0, 0)


def test_each_view_has_three_ports_of_its_own_from_the_first_on() -> None:
    config = VideoConfig(first_port=5000, bind_host="127.0.0.2")
    ports = [requested_ports(config, view) for view in config.views]
    assert ports[0] == ViewPorts("127.0.0.2", 5000, 5001, 5002)
    numbers = [number for each in ports for number in (each.rtp, each.reports, each.feedback)]
    assert numbers == list(range(5000, 5009))


def test_no_two_streams_share_an_ssrc() -> None:
    config = VideoConfig()
    numbers = [
        number(config, view) for view in config.views for number in (media_ssrc, repair_ssrc)
    ]
    assert len(set(numbers)) == 2 * len(config.views)
