"""Short runs in virtual time; as a program it prints the hash of one, for a fresh process.

`python -m tests.video.virtual_time.runs NETWORK SEED SECONDS`
"""

from __future__ import annotations

import sys
from contextlib import closing
from dataclasses import dataclass, field
from functools import cache, cached_property
from hashlib import sha256
from typing import Any

from tams_app.config import Network, VideoConfig
from tams_app.records import DroppedFrame, EncodedFrame, Frame, PacketRecord, ShownFrame
from tams_app.units import NS_PER_S
from tams_app.video.core.concealment import concealed_frames
from tams_app.video.core.packets import media_ssrc, parity_ssrc
from tams_app.video.core.parity import ViewParity
from tams_app.video.core.repair import RepairRule, repair_rule
from tams_app.video.core.rtcp import ReceivedFeedback
from tams_app.video.core.sender import StreamSettings, Uplink
from tams_app.video.virtual.rtcp_sessions import Feedback
from tams_app.video.virtual.shared import VideoRecord
from tams_app.video.virtual.video import VirtualVideo
from tests.video.scenes import frame
from tests.video.streams import checksum, decoded_checksums, jitter_counts

START_NS = NS_PER_S
CLEAN = Network(latency_ms=20)
NETWORKS = {
    "clean": CLEAN,
    "s2": Network(latency_ms=40, jitter_ms=8, loss=0.003, rate_kbps=6000),
    "s3": Network(latency_ms=80, jitter_ms=15, loss=0.01, rate_kbps=3000),
    "lossy": Network(latency_ms=20, jitter_ms=4, loss=0.02),
    # a queue that fills, whose delay a jitter buffer that follows the clock would follow
    "queueing": Network(latency_ms=20, jitter_ms=8, loss=0.05, rate_kbps=850, queue_ms=600),
    "far": Network(latency_ms=90, jitter_ms=4, loss=0.04),  # too far for RTX by the rule alone
}


@dataclass
class Run:
    """All that one run left behind, in the order in which it was told."""

    encoded: list[EncodedFrame] = field(default_factory=list)
    dropped: list[DroppedFrame] = field(default_factory=list)
    shown: list[ShownFrame] = field(default_factory=list)
    packets: list[PacketRecord] = field(default_factory=list)
    feedback: list[tuple[str, Feedback, int]] = field(default_factory=list)
    jitter: dict[str, dict[str, int]] = field(default_factory=dict)
    wire_bytes: int = 0

    def keep(self, records: list[VideoRecord]) -> None:
        lists: dict[type, list[Any]] = {
            EncodedFrame: self.encoded,
            DroppedFrame: self.dropped,
            ShownFrame: self.shown,
            PacketRecord: self.packets,
        }
        for record in records:
            lists[type(record)].append(record)

    @property
    def nacks(self) -> int:
        """How many packets were asked for again."""
        return sum(len(feedback.nacks) for _, feedback, _ in self.feedback)

    @property
    def plis(self) -> int:
        """How often a keyframe was asked for."""
        return sum(feedback.pli for _, feedback, _ in self.feedback)

    @cached_property
    def references(self) -> dict[int, int]:
        """Checksum of each frame where nothing is lost, by index."""
        return decoded_checksums(self.encoded)

    @property
    def exact(self) -> set[int]:
        """The frames that were shown as they look where nothing is lost, by index."""
        return {one.index for one in self.shown if checksum(one) == self.references[one.index]}

    @property
    def concealed(self) -> set[int]:
        """Those that were shown and, by the fates of the packets, concealed."""
        shown_ns = {one.index: one.shown_ns for one in self.shown}
        keyframe_of = {one.index: one.keyframe for one in self.encoded}
        index_of = {one.rtp_timestamp: one.index for one in self.encoded}
        return concealed_frames(keyframe_of, self.packets, shown_ns, index_of) & shown_ns.keys()

    def digest(self) -> str:
        """One number for every packet, time and pixel."""
        sha = sha256(repr((self.packets, self.dropped, self.feedback, self.jitter)).encode())
        for sent in self.encoded:
            sha.update(repr(sent).encode())
        for seen in self.shown:
            sha.update(repr((seen.view, seen.index, seen.shown_ns)).encode())
            sha.update(seen.image.tobytes())
        return sha.hexdigest()


class KeptVideo(VirtualVideo):
    """Video whose records the run keeps, and what receivers ask for, with when it arrives."""

    run: Run

    def push(self, frame: Frame, left_out: bool = False) -> list[VideoRecord]:
        return self._kept(super().push(frame, left_out))

    def pad(self, size_bytes: int) -> list[VideoRecord]:
        return self._kept(super().pad(size_bytes))

    def advance_to(self, now_ns: int) -> list[VideoRecord]:
        return self._kept(super().advance_to(now_ns))

    def _send_feedback(self, view: str, feedback: Feedback, arrives_ns: int) -> None:
        super()._send_feedback(view, feedback, arrives_ns)
        self.run.feedback.append((view, feedback, arrives_ns))

    def _kept(self, records: list[VideoRecord]) -> list[VideoRecord]:
        self.run.keep(records)
        return records


def make(
    run: Run,
    network: Network,
    views: tuple[str, ...] = ("eih",),
    kbps: float = 900.0,
    rule: RepairRule | None = None,
    seed: int = 1,
    groups: int = 0,
    feedback: bool = False,
    **more: Any,
) -> VirtualVideo:
    """`more`: as for `Uplink`."""
    config = VideoConfig(views=views)
    parity = {view: ViewParity(parity_ssrc(config, view), feedback) for view in views if groups}
    for each in parity.values():
        each.groups = groups
    rule = rule or repair_rule(network, config.pli_min_interval_ms)
    video = KeptVideo(
        {view: StreamSettings(view, config, rule.rtx, kbps, 80.0) for view in views},
        network,
        rule,
        seed,
        START_NS,
        Uplink(feedback=feedback, parity=parity, **more),
    )
    video.run = run
    return video


def receivers_of(views: tuple[str, ...]) -> dict[str, ReceivedFeedback]:
    """What the senders of these views hear, by view."""
    config = VideoConfig(views=views)
    return {view: ReceivedFeedback(view, media_ssrc(config, view)) for view in views}


def drive(
    video: VirtualVideo,
    views: tuple[str, ...],
    indices: range,
    begin_ns: int = START_NS,
    after_ns: int = NS_PER_S,
) -> None:
    """Push frames at their times, 30 a second, then let some time pass."""
    for index in indices:
        video.advance_to(begin_ns + index * NS_PER_S // 30)
        for place, view in enumerate(views):
            image = frame(index + 40 * place).image
            video.push(Frame(view, index, video.now_ns, image))
    video.advance_to(video.now_ns + after_ns)


def run_whole(
    network: Network,
    frames: int,
    views: tuple[str, ...] = ("eih",),
    kbps: float = 900.0,
    rule: RepairRule | None = None,
    seed: int = 1,
    groups: int = 0,
) -> Run:
    """`frames` of each view from first to last."""
    run = Run()
    with closing(make(run, network, views, kbps, rule, seed=seed, groups=groups)) as video:
        drive(video, views, range(frames))
        run.wire_bytes = video.wire_bytes()
        run.jitter = {view: jitter_counts(video.receivers[view].decoder) for view in views}
    return run


@cache
def shared_run(network: str, frames: int, rule: RepairRule | None = None) -> Run:
    """A run that several tests look at, and none changes."""
    return run_whole(NETWORKS[network], frames, rule=rule)


if __name__ == "__main__":
    name, number, seconds = sys.argv[1:]
    whole = run_whole(NETWORKS[name], int(seconds) * 30, ("eih", "gt", "gs"), seed=int(number))
    sys.stdout.write(f"{whole.digest()} {len(whole.shown)} {len(whole.packets)}\n")
