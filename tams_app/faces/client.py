"""The application's side of a face: starts its process, hands over facts, receives events."""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from tams_app.config import Config
from tams_app.errors import HelperError, SetupError
from tams_app.faces.facts_memory import FactsWriter
from tams_app.faces.messages import (
    LONGEST,
    Beat,
    Event,
    FaceFacts,
    Keys,
    Opening,
    Outline,
    ShownWorkspace,
)
from tams_app.runtime.clock import Clock
from tams_app.runtime.process import HelperProcess
from tams_app.teleop.hands import hand_of
from tams_app.video.live.frame_ring import FrameBlock

if TYPE_CHECKING:  # few sessions predict
    from tams_app.station.mount_memory import MountMemory

_POLL_S = 0.2


@dataclass(frozen=True, slots=True)
class Face:
    """Something that shows a session: its name, its process, and how to do without it."""

    name: str
    module: str
    without: str


WINDOW = Face(
    "window", "tams_app.faces.window.process", "run with --headless to go without a window"
)
HEADSET = Face(
    "headset",
    "tams_app.faces.headset.process",
    "set headset.show to never to go without the views in the headset",
)


class FaceClient:
    """One face; once it is launched, nothing here waits for it, whatever its process does."""

    def __init__(self, clock: Clock, face: Face) -> None:
        self._clock = clock
        self.face = face
        self._stack = ExitStack()
        self._process: HelperProcess | None = None
        self._facts: FactsWriter | None = None
        self._socket: socket.socket | None = None
        self.keys: Keys | None = None  # as they were sent last
        self.heard_ns: int | None = None  # when anything was
        self.seen_ns: dict[str, int] = {}  # as in `Keys`

    def launch(self, log_directory: Path | None, **specification: Any) -> None:
        """Start its process and wait until it has what it needs; SetupError if that refuses.

        `specification`: for the process, besides its socket.
        """
        with ExitStack() as stack:
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            stack.callback(ours.close)
            with theirs:
                self._process = process = HelperProcess(
                    self.face.name,
                    self.face.module,
                    {"socket": theirs.fileno(), **specification},
                    log_directory,
                    (theirs.fileno(),),
                )
                stack.callback(process.stop)
                process.start()
            try:
                process.wait_ready()
            except HelperError as error:
                sentence = str(error).rstrip(".")
                raise SetupError(f"{sentence}; {self.face.without}") from error
            self._socket = ours
            self._stack = stack.pop_all()

    def open(
        self,
        config: Config,
        screen: FrameBlock,
        blind: bool,
        replay: Outline | None = None,
        mount: MountMemory | None = None,
    ) -> None:
        """Let it show the session.

        `screen`: where the frames shown are put. `blind`, `replay`: see `Opening`. `mount`: where
        the cameras on the arm are whose frames it corrects.
        """
        screen.create()
        self._facts = facts = FactsWriter()
        self._stack.callback(facts.close)
        opening = _opening(config, blind, replay)
        if mount is not None:
            opening = msgspec.structs.replace(opening, cameras=mount.specification()["cameras"])
        if self._socket is not None and screen.descriptor is not None:
            with suppress(ConnectionError):  # it has ended, which its owner notices
                descriptors = [screen.descriptor, facts.descriptor]
                descriptors += [] if mount is None else [mount.descriptor]
                content = msgspec.msgpack.encode(opening)
                socket.send_fds(self._socket, [content], descriptors)

    @property
    def pid(self) -> int | None:
        """Of its process."""
        return self._process.pid if self._process else None

    def show(self, facts: FaceFacts) -> None:
        """These facts from now on."""
        if self._facts is not None:
            self._facts.put(msgspec.structs.replace(facts, reported_ns=self._clock.now_ns()))

    def events(self, stop: threading.Event) -> Iterator[Event]:
        """Every event as it comes, until `stop` is set or none can come; for a worker's thread."""
        while not stop.is_set() and (content := self._read()) != b"":
            if content is None:
                continue
            event = msgspec.msgpack.decode(content, type=Event)
            self.heard_ns = self._clock.now_ns()
            if isinstance(event, Keys):
                self.keys = event
            if isinstance(event, Keys | Beat):
                self.seen_ns = event.seen_ns
            yield event

    @property
    def ended(self) -> bool:
        """True if its process has ended unasked."""
        return self._process is not None and self._process.exit_code is not None

    def close(self) -> None:
        """Let it end; may be called twice."""
        self._stack.close()

    def _read(self) -> bytes | None:
        """An event; None if there is none for a moment, nothing if there will be none any more."""
        if self._socket is None:
            return b""
        ready, _, _ = select.select([self._socket], [], [], _POLL_S)
        try:
            return self._socket.recv(LONGEST) if ready else None
        except ConnectionError:
            return b""


def _opening(config: Config, blind: bool, replay: Outline | None) -> Opening:
    video, limits = config.video, config.limits
    low_x, low_y, low_z = limits.box_min_mm
    return Opening(
        views=video.views,
        width=video.width,
        height=video.height,
        workspace=ShownWorkspace(
            (low_x, low_y, max(low_z, limits.floor_mm)),
            limits.box_max_mm,
            limits.radius_min_mm,
            limits.radius_max_mm,
        ),
        blind=blind,
        hand=hand_of(config),
        old_ms=config.freshness.video_slow_ms,
        replay=replay,
        has_episodes=config.recording.episodes,
        strategy="" if blind else config.strategy,
        network="" if blind else str(config.network),
    )
