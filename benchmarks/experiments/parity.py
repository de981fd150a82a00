"""Parity for each frame: GStreamer's ULPFEC elements or our own packets before the jitter buffer?

`python -m benchmarks.experiments.parity`: one view of a panning scene on s3 in virtual time, where
nothing is resent, with the same target and losses: what arrives whole, how late, at what cost.
ULPFEC is decoded behind the jitter buffer, which must first give a packet up. rtpst2022-1-fecenc
is left out: its rows and columns count packets, not frames, so that a short frame's parity waits
for the next one's packets.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.experiments.moving_frames import image
from tams_app.config import load_config
from tams_app.records import EncodedFrame, Frame, PacketKind, PacketRecord, ShownFrame
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core import pipelines
from tams_app.video.core.packets import media_ssrc, parity_ssrc
from tams_app.video.core.repair import RepairRule, repair_rule
from tams_app.video.core.ssim import FrameMoments, luma_of, ssim
from tams_app.video.core.view_parity import ViewParity
from tams_app.video.live.view_decoder import ViewDecoder
from tams_app.video.virtual import chains, receiver
from tams_app.video.virtual.shared import VideoRecords
from tams_app.video.virtual.stepped_clock import SteppedClock
from tams_app.video.virtual.video import VirtualVideo

RESULTS = Path(__file__).parent / "results" / "parity.json"
VIEW, NETWORK, KBPS, SEEDS, FRAMES = "eih", "s3", 1200.0, 2, 450
_ULPFEC_PAYLOAD_TYPE = 100  # no parity of ours: it is to enter the jitter buffer
_START_NS = NS_PER_S


@dataclass(frozen=True, slots=True)
class Figures:
    """What one scheme gave in all runs together."""

    scheme: str
    requests: float  # keyframes asked for, of 1000 frames: losses that were not repaired
    received_ssim: float
    latency_p50_ms: float
    latency_hit_ms: float | None  # mean, of the frames that lost a packet and were shown
    latency_p95_ms: float
    sent_kbps: float
    overhead: float  # parity bytes / media bytes
    cpu_ms_per_frame: float  # encoder, link, decoder: of the whole process


class _UlpfecDecoderChain(chains.DecoderChain):
    """The decoder's chain with ULPFEC's two elements around the jitter buffer."""

    def __init__(
        self, view: str, rule: RepairRule, frames: ViewDecoder, clock: SteppedClock
    ) -> None:
        inner = pipelines.decoder_chain(rule)
        jitterbuffer, rest = inner.split(" ! ", 1)
        rest = rest.replace('"<97>"', f'"<97, {_ULPFEC_PAYLOAD_TYPE}>"')
        fec = f"rtpulpfecdec name=fec pt={_ULPFEC_PAYLOAD_TYPE}"
        storage = f"rtpstorage name=storage size-time={NS_PER_S}"
        description = f"{storage} ! {jitterbuffer} ! {fec} ! {rest}"
        # without the SSRC in its caps rtpulpfecdec ends the process at the first loss
        caps = f"{pipelines.rtp_caps()},ssrc=(uint){media_ssrc(load_config().video, view)}"
        with (
            patch.object(pipelines, "decoder_chain", lambda *_: description),
            patch.object(pipelines, "rtp_caps", lambda: caps),
        ):
            super().__init__(view, rule, frames, clock)
        storage_element = self.pipeline.get_by_name("storage")
        fec_element = self.pipeline.get_by_name("fec")
        fec_element.set_property("storage", storage_element.get_property("internal-storage"))
        self.entrance = storage_element.get_static_pad("sink")


@contextmanager
def _ulpfec(percentage: int) -> Iterator[None]:
    encoder_chain = pipelines.encoder_chain
    element = (
        f"! rtpulpfecenc pt={_ULPFEC_PAYLOAD_TYPE} percentage={percentage} "
        f"percentage-important={percentage}"
    )
    with (
        patch.object(pipelines, "encoder_chain", lambda *a: f"{encoder_chain(*a)} {element}"),
        patch.object(receiver, "DecoderChain", _UlpfecDecoderChain),
    ):
        yield


def measure(
    scheme: str,
    groups: int = 0,
    lossless: bool = False,
    seeds: Sequence[int] = tuple(range(SEEDS)),
    longer_ms: float = 0.0,
) -> Figures:
    """Several runs of one scheme; `groups` parity packets of our own for each frame.

    The jitter buffer waits for `longer_ms` more than the rule says.
    """
    config = load_config()
    network = config.networks[NETWORK].model_copy(update={"loss": 0.0} if lossless else {})
    rule = repair_rule(network, config.video.pli_min_interval_ms)
    latency_ms = rule.latency_ms + round(longer_ms)
    rule = RepairRule(False, latency_ms, rule.pli_interval_ms, True, parity=groups > 0)
    video = config.video.model_copy(update={"views": (VIEW,)})
    ages_ms: list[float] = []
    hit_ms: list[float] = []
    scores: list[float] = []
    requests, cpu_s, sizes = 0, 0.0, Counter[PacketKind]()
    for seed in seeds:
        packets: list[PacketRecord] = []
        encoded: list[EncodedFrame] = []
        shown: list[ShownFrame] = []
        feedback: list[bool] = []
        records = VideoRecords(
            encoded.append,
            lambda _: None,
            shown.append,
            packets.extend,
            lambda _view, told, _ns, plis=feedback: plis.append(told.pli),
        )
        parity = ViewParity(parity_ssrc(video, VIEW))
        parity.groups = groups
        began_s = time.process_time()
        with closing(
            VirtualVideo(
                video, network, rule, seed, _START_NS, {VIEW: KBPS}, 0.0, records,
                parity={VIEW: parity} if groups else {},
            )
        ) as chain:  # fmt: skip
            for index in range(FRAMES):
                chain.advance_to(_START_NS + index * NS_PER_S // config.video.fps)
                chain.push(Frame(VIEW, index, chain.now_ns, image(index)))
            chain.advance_to(chain.now_ns + NS_PER_S)
        cpu_s += time.process_time() - began_s
        requests += sum(feedback)
        index_of = {one.rtp_timestamp: one.index for one in encoded}
        hit = {
            index_of[one.rtp_timestamp]
            for one in packets
            if one.kind is PacketKind.MEDIA and not one.delivered_ns
        }
        for one in packets:
            is_parity = one.kind is PacketKind.PARITY
            sizes[one.kind] += one.size_bytes * (one.kind is PacketKind.MEDIA or is_parity)
        for one in shown:
            age_ms = (one.shown_ns - one.capture_ns) / NS_PER_MS
            ages_ms.append(age_ms)
            hit_ms += [age_ms] if one.index in hit else []
            if one.index % 5 == 0:
                moments = [FrameMoments.of(luma_of(each)) for each in (one.image, image(one.index))]
                scores.append(ssim(*moments))
    frames, total = len(seeds) * FRAMES, sum(sizes.values())
    return Figures(
        scheme,
        1000 * requests / frames,
        float(np.mean(scores)),
        float(np.median(ages_ms)),
        float(np.mean(hit_ms)) if hit_ms else None,
        float(np.percentile(ages_ms, 95)),
        total * 8 / 1000 / (frames / config.video.fps),
        sizes[PacketKind.PARITY] / total,
        1000 * cpu_s / frames,
    )


def collect() -> list[Figures]:
    """All schemes, one after the other."""
    found = [measure("no loss", lossless=True), measure("no parity")]
    for percentage in (20, 40):
        with _ulpfec(percentage):
            found.append(measure(f"ULPFEC, {percentage} %"))
    return [*found, measure("our own, 1 a frame", 1), measure("our own, 2 a frame", 2)]


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.experiments.parity", description=__doc__
    )
    parser.add_argument("--json", type=Path, default=RESULTS)
    options = parser.parse_args()
    found = collect()
    table = Table(box=None)
    for name in Figures.__slots__:
        table.add_column(name, justify="left" if name == "scheme" else "right")
    for one in found:
        values = asdict(one)
        table.add_row(
            values.pop("scheme"),
            *("–" if each is None else f"{each:.3f}" for each in values.values()),
        )
    Console(width=160).print(table)
    options.json.write_text(json.dumps([asdict(one) for one in found], indent=1) + "\n")


if __name__ == "__main__":
    main()
