"""A small UDP relay for tests: a delay, and losses chosen by the test."""

from __future__ import annotations

import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable

from tams_app.video.live.udp import ViewPorts

Keep = Callable[[int, bytes], bool]  # ordinal and datagram -> whether it gets through
ALL: Keep = lambda _ordinal, _datagram: True  # noqa: E731


class LossyLink:
    """Carries one view's three flows; `keep` decides about each RTP datagram, `keep_feedback`
    about the receiver's RTCP."""

    def __init__(self, keep: Keep = ALL, delay_s: float = 0.01, keep_feedback: Keep = ALL) -> None:
        self.rtp: list[bytes] = []
        self.feedback: list[bytes] = []
        self._keep = keep
        self._delay_s = delay_s
        self._keep_feedback = keep_feedback
        self._sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
        for each in self._sockets:
            each.bind(("127.0.0.1", 0))
            each.setblocking(False)
        ports = [each.getsockname()[1] for each in self._sockets]
        self.entrances = ViewPorts("127.0.0.1", *ports)
        self._underway: deque[tuple[float, int, bytes]] = deque()  # when due, flow
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="lossy-link")

    def start(self, exits: ViewPorts) -> None:
        self._exits = (exits.rtp, exits.reports, exits.feedback)
        self._thread.start()

    def bring(self, packet: bytes) -> None:
        """Hand the receiver's RTP port a packet that no sender has sent."""
        self._sockets[2].sendto(packet, ("127.0.0.1", self._exits[0]))

    def close(self) -> None:
        self._stop.set()
        self._thread.join(5)
        for each in self._sockets:
            each.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            wait = 0.02
            if self._underway:
                wait = min(wait, max(0.0, self._underway[0][0] - time.monotonic()))
            for ready in select.select(self._sockets, [], [], wait)[0]:
                self._take_in(self._sockets.index(ready), ready)
            while self._underway and self._underway[0][0] <= time.monotonic():
                _, flow, data = self._underway.popleft()
                way_out = self._sockets[0 if flow == 2 else 2]  # where its receiver sends to
                way_out.sendto(data, ("127.0.0.1", self._exits[flow]))

    def _take_in(self, flow: int, ready: socket.socket) -> None:
        while True:
            try:
                data = ready.recv(2048)
            except BlockingIOError:
                return
            if flow == 0:
                self.rtp.append(data)
                if not self._keep(len(self.rtp) - 1, data):
                    continue
            if flow == 2:
                self.feedback.append(data)
                if not self._keep_feedback(len(self.feedback) - 1, data):
                    continue
            self._underway.append((time.monotonic() + self._delay_s, flow, data))
