"""A face's side of its application: what it is opened with, and reporting what happens."""

from __future__ import annotations

import contextlib
import select
import socket
from dataclasses import dataclass

import msgspec

from tams_app.faces.commands import Command
from tams_app.faces.facts_memory import FactsReader
from tams_app.faces.messages import LONGEST, CommandRequest, Event, Opening
from tams_app.runtime.process import HelperSide
from tams_app.runtime.shared_ring import map_descriptor
from tams_app.station.mount_memory import PresentViews, described_cameras
from tams_app.video.live.frame_ring import SHOWN, FrameReader, RingLayout

_POLL_S = 0.05
_KEPT = frozenset({Command.EMERGENCY_STOP, Command.QUIT, Command.CLOSE})  # as good once and late


@dataclass(frozen=True, slots=True)
class Opened:
    """The contents of a face."""

    opening: Opening
    frames: dict[str, FrameReader]
    facts: FactsReader
    present: PresentViews | None = None


class Application:
    """The socket to the application, which never waits for a face, nor that for it."""

    def __init__(self, side: HelperSide) -> None:
        """`side`: its specification names the socket's descriptor."""
        self._side = side
        self._socket = socket.socket(fileno=int(side.specification["socket"]))
        self._unsent: dict[Command, CommandRequest] = {}

    def await_opening(self) -> Opened | None:
        """Wait for what is to be shown; None to end before."""
        while not self._side.stop_requested.is_set():
            if select.select([self._socket], [], [], _POLL_S)[0]:
                content, descriptors, _, _ = socket.recv_fds(self._socket, LONGEST, 3)
                if not content:
                    return None
                self._socket.setblocking(False)
                opening = msgspec.msgpack.decode(content, type=Opening)
                return _opened(opening, *descriptors)
        return None

    def report(self, event: Event) -> None:
        """Send it, if the application takes anything; what stops the arm is sent with a later one.

        Of all else the next event has what counts, but for a confirmation: that is not to be late.
        """
        # it takes nothing for a moment, or has ended
        with contextlib.suppress(BlockingIOError, ConnectionError):
            if is_kept := isinstance(event, CommandRequest) and event.command in _KEPT:
                self._unsent[event.command] = event
            for command, asked in tuple(self._unsent.items()):
                self._send(asked)
                del self._unsent[command]
            if not is_kept:
                self._send(event)

    def _send(self, event: Event) -> None:
        self._socket.send(msgspec.msgpack.encode(event))

    def close(self) -> None:
        """Nothing is reported any more."""
        self._socket.close()


def _opened(opening: Opening, frames: int, facts: int, mount: int | None = None) -> Opened:
    layout = RingLayout(SHOWN, opening.views, opening.width, opening.height)
    block = map_descriptor(frames)
    readers = {view: FrameReader(block, layout, view) for view in opening.views}
    present: PresentViews | None = None
    if mount is not None:
        present = PresentViews(described_cameras(opening.cameras), map_descriptor(mount))
    return Opened(opening, readers, FactsReader(facts), present)
