"""Parity across two frames (a streaming code) against parity of each frame, paired.

`python -m benchmarks.experiments.streaming_parity`: one view of a panning scene on s3 with bursts
(Gilbert–Elliott, 4 packets on average) in virtual time, where nothing is resent: the same scene,
target and state of the link, and as many parity packets a frame. Of a frame's packets, half of the
interleaved groups are protected by its own parity packets, the other half by those of the next
frame: a parity packet is the XOR of a group of its own frame and one of the frame before. So bursts
twice as long are restored, those in the second half a frame later, for which the jitter buffer must
wait.
"""

from __future__ import annotations

import argparse
import json
import struct
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from functools import reduce
from operator import xor
from pathlib import Path
from unittest.mock import patch

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.experiments import parity as of_each_frame
from benchmarks.experiments.parity import Figures
from tams_app.config import load_config
from tams_app.video.core import view_parity
from tams_app.video.core.packets import (
    MEDIA_PAYLOAD_TYPE,
    PARITY_PAYLOAD_TYPE,
    SEQUENCES,
    read_rtp,
    rtp_header,
)
from tams_app.video.core.parity import ParityDecoder, ParityEncoder
from tams_app.video.virtual import receiver

RESULTS = Path(__file__).parent / "results" / "streaming_parity.json"
SEEDS, BURST = 6, 4.0
FRAME_MS = 1000.0 / 30.0
# of both frames: timestamp, first sequence number, packets; distance, markers, lengths
_GROUP = struct.Struct("!IHBIHBBBH")
_LONGEST = 1500


class StreamingEncoder(ParityEncoder):
    """Each parity packet protects a group of its frame and one of the frame before."""

    _before: Sequence[bytes] = ()

    def protect(self, packets: Sequence[bytes], groups: int) -> list[bytes]:
        before, self._before = self._before, packets
        made = []
        for group in range(groups):
            ours = packets[group :: 2 * groups]
            theirs = before[groups + group :: 2 * groups]
            if ours or theirs:
                last = group == groups - 1
                made.append(self._of_two(ours, theirs, packets[0], 2 * groups, last=last))
        return made

    def _of_two(
        self,
        ours: Sequence[bytes],
        theirs: Sequence[bytes],
        first: bytes,
        distance: int,
        *,
        last: bool,
    ) -> bytes:
        header = read_rtp(first)
        assert header is not None
        heads, lengths, markers, payload = [], 0, 0, 0
        for packets in (ours, theirs):
            known = [read_rtp(packet) for packet in packets]
            timestamp = sequence = 0
            for packet, one in zip(packets, known, strict=True):
                assert one is not None
                body = packet[one.payload_offset :]
                lengths ^= len(body)
                markers ^= one.marker
                payload ^= int.from_bytes(body.ljust(_LONGEST, b"\0"), "big")
            if known and known[0] is not None:
                timestamp, sequence = known[0].timestamp, known[0].sequence
            heads += [timestamp, sequence, len(packets)]
        sizes = [len(packet) for packet in (*ours, *theirs)]
        group = _GROUP.pack(*heads, distance, markers, lengths)
        rtp = rtp_header(
            PARITY_PAYLOAD_TYPE, self._sequence, header.timestamp, self._ssrc, marker=last
        )
        self._sequence = (self._sequence + 1) % SEQUENCES
        return rtp + group + payload.to_bytes(_LONGEST, "big")[: max(sizes)]


class StreamingDecoder(ParityDecoder):
    """The other side of it."""

    def parity(self, packet: bytes) -> list[bytes]:
        rtp = read_rtp(packet)
        if rtp is None or rtp.payload_type != PARITY_PAYLOAD_TYPE:
            return []
        body = rtp.payload_offset + _GROUP.size
        *heads, distance, markers, length = _GROUP.unpack_from(packet, rtp.payload_offset)
        keys = [
            (timestamp, (sequence + n * distance) % SEQUENCES)
            for timestamp, sequence, count in (heads[:3], heads[3:])
            for n in range(count)
        ]
        missing = [key for key in keys if key not in self._media]
        if len(missing) > 1:
            for key in missing:
                self._waiting[key] = packet
        if len(missing) != 1:
            return []
        payloads = [packet[body:]]
        for key in keys:
            if key != missing[0]:
                known = read_rtp(self._media[key])
                assert known is not None
                payloads.append(self._media[key][known.payload_offset :])
                markers ^= known.marker
                length ^= len(payloads[-1])
        numbers = (int.from_bytes(one.ljust(_LONGEST, b"\0"), "big") for one in payloads)
        payload = reduce(xor, numbers).to_bytes(_LONGEST, "big")
        timestamp, sequence = missing[0]
        header = rtp_header(
            MEDIA_PAYLOAD_TYPE, sequence, timestamp, self._ssrc, marker=bool(markers & 1)
        )
        return [header + payload[:length], *self.media(header + payload[:length])]


@contextmanager
def _streaming() -> Iterator[None]:
    with (
        patch.object(view_parity, "ParityEncoder", StreamingEncoder),
        patch.object(receiver, "ParityDecoder", StreamingDecoder),
    ):
        yield


def collect(seeds: int) -> dict[str, list[Figures]]:
    """Each scheme's figures, seed by seed."""
    schemes = {
        f"{groups} a frame, {name}": (groups, streaming, longer_ms)
        for groups in (1, 2)
        for name, streaming, longer_ms in (
            ("of each frame", False, 0.0),
            ("of each frame, a frame later", False, FRAME_MS),
            ("across two frames", True, FRAME_MS),
        )
    }
    config = load_config()
    bursts = config.networks["s3"].model_copy(update={"loss_burst": BURST})
    networks = {**config.networks, "s3": bursts}
    found: dict[str, list[Figures]] = {name: [] for name in schemes}
    runs = [(seed, name) for seed in range(seeds) for name in schemes]
    with patch.object(
        of_each_frame, "load_config", lambda: config.model_copy(update={"networks": networks})
    ):
        for seed, name in track(runs, transient=True):
            groups, streaming, longer_ms = schemes[name]
            with ExitStack() as stack:
                if streaming:
                    stack.enter_context(_streaming())
                figures = of_each_frame.measure(name, groups, seeds=(seed,), longer_ms=longer_ms)
            found[name].append(figures)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.experiments.streaming_parity", description=__doc__
    )
    parser.add_argument("--seeds", type=int, default=SEEDS, help=f"default {SEEDS}")
    parser.add_argument("--json", type=Path, default=RESULTS)
    options = parser.parse_args()
    found = collect(options.seeds)
    names = ("requests", "received_ssim", "latency_p95_ms", "sent_kbps", "overhead")
    table = Table("scheme", *names, "SSIM more than of each frame", box=None)
    for name, several in found.items():
        ours = np.array([one.received_ssim for one in several])
        theirs = found[f"{name.split(',')[0]}, of each frame"]
        more = ours - np.array([one.received_ssim for one in theirs])
        half = 1.96 * more.std(ddof=1) / np.sqrt(len(more))
        means = [np.mean([getattr(one, key) for one in several]) for key in names]
        table.add_row(name, *(f"{mean:.3f}" for mean in means), f"{more.mean():+.4f} ± {half:.4f}")
    Console(width=160).print(table)
    told = {name: [asdict(one) for one in several] for name, several in found.items()}
    options.json.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
