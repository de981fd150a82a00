"""What `video.repair` switches off is not done, and what it forces is."""

from __future__ import annotations

import pytest

from tams_app.config import RepairConfig
from tams_app.records import PacketKind
from tams_app.video.core.repair import repair_rule
from tests.video.virtual_time.runs import NETWORKS, Run, shared_run

pytestmark = pytest.mark.untimed

RTX_OFF = RepairConfig(mode="paper", rtx="off")
NO_REPAIR = RepairConfig(mode="paper", rtx="off", pli=False)
RTX_ON = RepairConfig(mode="paper", rtx="on")


def run(wanted: RepairConfig) -> Run:
    return shared_run("far", 50, repair_rule(NETWORKS["far"], 300.0, wanted))


@pytest.mark.parametrize("wanted", [RTX_OFF, NO_REPAIR])
def test_without_pli_no_keyframe_is_asked_for(wanted: RepairConfig) -> None:
    found = run(wanted)
    assert found.jitter["eih"]["num-lost"] > 0
    assert (found.plis > 0) == wanted.pli
    assert (sum(frame.keyframe for frame in found.encoded) > 1) == wanted.pli


@pytest.mark.parametrize("wanted", [RepairConfig(mode="paper"), RTX_ON])
def test_rtx_resends_where_it_is_forced_though_the_network_is_slow(wanted: RepairConfig) -> None:
    resent = [packet for packet in run(wanted).packets if packet.kind is PacketKind.REPAIR]
    assert bool(resent) == (wanted.rtx == "on")
