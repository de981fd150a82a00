"""A trial in virtual time of unknown capacity: the budget finds it through the encoders."""

from __future__ import annotations

import numpy as np
import pytest

from tams_app.recording import LOG_NAME, SessionLog, read_log
from tams_app.records import PacketKind
from tams_app.summary import summarise
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.session.virtual.runs import run, short

pytestmark = [pytest.mark.untimed, pytest.mark.verify, pytest.mark.timeout(600)]

LINK_KBPS = 6000  # of s2
FOUND_NS = 2 * NS_PER_S


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> SessionLog:
    """Ten seconds on s2."""
    folder = tmp_path_factory.mktemp("feedback")
    settings = {
        "network": "s2",
        "seconds": 10.0,
        "video.fps": 30,
        "video.quality.enabled": False,
        "policy.budget.mode": "feedback",
    }
    run(short(**settings), folder)
    return read_log(folder / LOG_NAME)


def test_the_views_get_most_of_the_link_within_two_seconds_and_keep_it(log: SessionLog) -> None:
    start_ns = log.allocations[0].t_ns
    later = [one for one in log.allocations if one.t_ns >= start_ns + FOUND_NS]
    totals = np.array([sum(one.target_kbps.values()) for one in later])
    assert np.mean(totals >= 0.8 * LINK_KBPS) > 0.9
    assert np.mean(totals) <= LINK_KBPS  # a probe may exceed it


def test_no_queue_stands(log: SessionLog) -> None:
    start_ns = log.allocations[0].t_ns
    waits_ms = [
        (one.departed_ns - one.entered_ns) / NS_PER_MS
        for one in log.packets
        if one.departed_ns and one.entered_ns >= start_ns + FOUND_NS
    ]
    assert np.percentile(waits_ms, 50) < 15
    assert np.percentile(waits_ms, 99) < 60


def test_what_the_views_do_not_use_is_found_with_padding_and_the_summary_tells_it(
    log: SessionLog,
) -> None:
    padding = [one for one in log.packets if one.kind is PacketKind.PADDING]
    assert {one.view for one in padding} == {log.header.views[0]}
    fraction = summarise(log)["uplink"]["padding_fraction"]
    assert 0 < fraction < 0.1
