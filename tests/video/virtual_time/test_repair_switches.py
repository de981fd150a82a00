"""What `video.repair` switches off is not done, and what it forces is."""

from __future__ import annotations

import pytest

from tams_app.config import Network, RepairConfig
from tams_app.records import PacketKind
from tams_app.video.repair import repair_rule
from tests.video.virtual_time.runs import Run, run_whole

pytestmark = pytest.mark.untimed

LOSSY = Network(latency_ms=90, jitter_ms=4, loss=0.02)  # too far for RTX by the rule alone


def run(wanted: RepairConfig) -> Run:
    return run_whole(LOSSY, 90, rule=repair_rule(LOSSY, 300.0, wanted))


@pytest.mark.parametrize("pli", [True, False])
def test_without_pli_no_keyframe_is_asked_for(pli: bool) -> None:
    found = run(RepairConfig(rtx="off", pli=pli))
    assert found.stats["eih"].packets_lost > 0
    assert (found.counts["eih"].plis_sent > 0) == pli
    assert (sum(frame.keyframe for frame in found.encoded) > 1) == pli


@pytest.mark.parametrize("rtx", ["auto", "on"])
def test_rtx_resends_where_it_is_forced_though_the_network_is_slow(rtx: str) -> None:
    found = run(RepairConfig.model_validate({"rtx": rtx}))
    resent = [packet for packet in found.packets if packet.kind is PacketKind.REPAIR]
    assert bool(resent) == (rtx == "on")
