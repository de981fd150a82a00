"""The application as on hardware, a process of its own that a station starts and asks.

Faked is what lies beyond the wire: the arm's controller is another process, the cameras are played
below v4l2src by a preloaded library, and SteamVR is a function table whose controller stands where
the station's file says.
"""

from __future__ import annotations

import os
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from unittest.mock import patch

from hw.make_camera import SOURCES
from hw.v4l2.devices import list_cameras
from hw.v4l2.source import V4l2Source
from tams_app.config import Config
from tams_app.console.app import POLL_S
from tams_app.errors import TamsError
from tams_app.records import SessionState
from tams_app.robot.control import Signals
from tams_app.runtime.clock import MonotonicClock
from tams_app.session.folder import create_session_folder
from tams_app.session.run import run as run_session
from tams_app.session.session import Outset, Session
from tests.hw.openvr.fake_openvr import RIGHT, FakeRuntime
from tests.session.hardware_hand import pose_in


@dataclass(frozen=True, slots=True)
class Wiring:
    """What the application finds plugged in."""

    devices: Path  # in place of /dev
    system: Path  # in place of /sys
    hand: Path  # with the tracked controller's pose
    steamvr_runs: bool = True


@dataclass(frozen=True, slots=True)
class Look:
    """The session at one moment."""

    state: SessionState
    notes: list[str]  # since the last look
    ended: bool
    failure: str


def run(requests: Connection, config: Config, wiring: Wiring, dry_run: bool) -> None:
    """Answer with the session's folder, or why there is none; then serve until "close"."""
    os.environ.pop("LD_PRELOAD", None)  # the helper processes have no cameras
    runtime = FakeRuntime()
    runtime.devices[RIGHT].matrix = pose_in(wiring.hand)
    if not wiring.steamvr_runs:
        runtime.die()
    find = partial(list_cameras, wiring.devices, wiring.system)
    with ExitStack() as stack:
        stack.enter_context(runtime.in_place_of_the_library())
        stack.enter_context(patch.dict(SOURCES, v4l2=partial(V4l2Source, find=find)))
        folder = create_session_folder(config)
        outset = Outset(config, MonotonicClock(), folder, Signals())
        with ExitStack() as running:
            try:
                session = running.enter_context(run_session(outset, dry_run=dry_run))
            except TamsError as refusal:
                requests.send(refusal)
                return
            requests.send(session.folder)
            _serve(requests, outset, session, runtime)
    requests.send(outset.failure)


def _serve(requests: Connection, outset: Outset, session: Session, runtime: FakeRuntime) -> None:
    """Do what the console's loop does, and what the station asks for."""
    while True:
        session.poll()
        if not requests.poll(POLL_S):
            continue
        request, *arguments = requests.recv()
        match request:
            case "look":
                notes, ended = session.sentences.take(), session.ended.is_set()
                requests.send(Look(session.state(), list(notes), ended, outset.failure))
            case "confirm":
                session.signals.confirm(MonotonicClock().now_ns())
            case "press":
                runtime.press(*arguments)
            case "quit SteamVR":
                runtime.quit()
            case "close":
                session.end("ended by the operator")
                return
            case _:
                raise ValueError(request)
