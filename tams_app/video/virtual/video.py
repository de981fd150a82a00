"""The video of a run in virtual time: push frames, advance time, take what is shown."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from functools import partial

from tams_app import gst
from tams_app.config import Network
from tams_app.records import Frame
from tams_app.video.core.link import Link
from tams_app.video.core.repair import RepairRule
from tams_app.video.core.sender import Sender, StreamSettings, Uplink
from tams_app.video.live.networks import network_capacity
from tams_app.video.virtual.receiver import VirtualReceiver
from tams_app.video.virtual.rtcp_sessions import Feedback
from tams_app.video.virtual.sender import VirtualSender
from tams_app.video.virtual.shared import Shared, VideoRecord
from tams_app.video.virtual.stepped_clock import EventQueue, SteppedClock
from tams_app.video.virtual.wait_idle import IdleGate, IdleWaiter

_NEVER_NS = 1 << 63


class VirtualVideo:
    """The real encoders, jitter buffers and decoders of all views, over one link, in virtual time.

    For one thread of a process that runs nothing else. The same inputs give the same bytes,
    frames and times on the same machine. Time begins at `start_ns` > 0, where a capacity trace
    begins too; `advance_to` moves it. What has happened is returned, in order of time, by what let
    it happen.
    """

    def __init__(
        self,
        streams: Mapping[str, StreamSettings],
        network: Network,
        rule: RepairRule,
        seed: int,
        start_ns: int,
        uplink: Uplink,
    ) -> None:
        """Start the chains; SetupError if GStreamer lacks something. `streams` by view."""
        gst.require_elements()
        self._clock = SteppedClock(start_ns)
        self._events = EventQueue()
        waiter = IdleWaiter()
        self._idle_gate = IdleGate(waiter, self._clock)
        link = Link(network, network_capacity(network, start_ns), tuple(streams), seed)
        self._shared = shared = Shared(link, self._events, self._clock, self._idle_gate)
        self._senders: dict[str, VirtualSender] = {}
        self.receivers: dict[str, VirtualReceiver] = {}
        with ExitStack() as stack:
            stack.callback(waiter.close)
            for view, stream in streams.items():
                sender = Sender(stream, uplink)
                self.receivers[view] = receiver = VirtualReceiver(
                    view, stream.config, rule, seed, shared, sender.sent.find, uplink.feedback
                )
                stack.callback(receiver.close)
                self._senders[view] = VirtualSender(sender, seed, shared, receiver)
                stack.callback(self._senders[view].close)
            self._idle_gate.wait()
            self._stack = stack.pop_all()
        self._timings = [receiver.timing for receiver in self.receivers.values()]
        self._timings += [sender.timing for sender in self._senders.values()]

    @property
    def now_ns(self) -> int:
        return self._clock.now_ns()

    def push(self, frame: Frame, left_out: bool = False) -> list[VideoRecord]:
        """Encode a frame at this moment; nothing of it is sent before time advances.

        `left_out`: it is not to be sent. TamsError if the encoder fails.
        """
        self._senders[frame.view].push(frame, left_out)
        return self._take_records()

    def set_targets(self, target_kbps: Mapping[str, float]) -> None:
        """The wire rate each view is to meet from its next frame on."""
        for view, kbps in target_kbps.items():
            self._senders[view].set_target_kbps(kbps)

    def pad(self, size_bytes: int) -> list[VideoRecord]:
        """Send so much padding now, in the first view's session."""
        next(iter(self._senders.values())).pad(size_bytes)
        return self._take_records()

    def advance_to(self, now_ns: int) -> list[VideoRecord]:
        """Let everything happen that is due up to `now_ns`, one event after the other.

        Of what is due at once, GStreamer's waits end first, then the queue's actions, then RTCP.

        ValueError if that is in the past; TamsError if a chain fails or does not become idle.
        """
        while True:
            wait_ns = _or_never(self._clock.next_ns())
            action_ns = _or_never(self._events.next_ns)
            reports_ns = min([_or_never(timing.next_ns) for timing in self._timings])
            due_ns = min(wait_ns, action_ns, reports_ns)
            if due_ns > now_ns:
                break
            due_ns = max(due_ns, self._clock.now_ns())
            self._clock.move_to(due_ns)
            if wait_ns <= due_ns:
                self._clock.end_next_wait()
                self._idle_gate.wait()
                self._collect()
            elif action_ns <= due_ns:
                self._events.do_next()
                if self._idle_gate.wait_if_due():
                    self._collect()
            else:
                self._send_reports(due_ns)
        self._clock.move_to(now_ns)
        return self._take_records()

    def wire_bytes(self) -> int:
        """IP datagram bytes sent so far by all views together, padding included."""
        return sum(sender.wire_bytes for sender in self._senders.values())

    def close(self) -> None:
        """End all chains; may be called twice."""
        self._stack.close()

    def _take_records(self) -> list[VideoRecord]:
        records = self._shared.records.copy()
        self._shared.records.clear()
        return records

    def _send_reports(self, now_ns: int) -> None:
        for view, receiver in self.receivers.items():
            if _or_never(receiver.timing.next_ns) <= now_ns and (feedback := receiver.step()):
                arrives_ns = self._shared.link.feedback(feedback.sent_ns, view)
                self._send_feedback(view, feedback, arrives_ns)
        for sender in self._senders.values():
            if _or_never(sender.timing.next_ns) <= now_ns:
                sender.step()

    def _send_feedback(self, view: str, feedback: Feedback, arrives_ns: int) -> None:
        self._events.post(arrives_ns, partial(self._senders[view].obey, feedback))

    def _collect(self) -> None:
        for receiver in self.receivers.values():
            receiver.collect()


def _or_never(due_ns: int | None) -> int:
    return _NEVER_NS if due_ns is None else due_ns
