"""What a face tells its application: nothing that stops the arm is ever lost."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from tams_app.faces.application import Application
from tams_app.faces.commands import Command
from tams_app.faces.messages import LONGEST, CommandRequest, Event, Keys

pytestmark = pytest.mark.untimed


@dataclass
class Ends:
    """The face's end of the socket, and the application's, which reads when it is asked to."""

    face: Application
    descriptor: int
    ours: socket.socket

    def fill(self) -> None:
        """Send what an application that reads nothing takes at most."""
        with socket.fromfd(self.descriptor, socket.AF_UNIX, socket.SOCK_SEQPACKET) as face:
            face.setblocking(False)
            with suppress(BlockingIOError):
                while True:
                    face.send(msgspec.msgpack.encode(keys(0)))

    def read(self) -> list[Event]:
        """All that has been told and not read."""
        events = []
        while True:
            try:
                content = self.ours.recv(LONGEST)
            except BlockingIOError:
                return events
            if not content:
                return events
            events.append(msgspec.msgpack.decode(content, type=Event))


def keys(t_ns: int) -> Keys:
    return Keys(t_ns, True, ("Shift_L",))


@pytest.fixture
def ends() -> Iterator[Ends]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in (ours, theirs):
        end.setblocking(False)
    descriptor = theirs.detach()
    side: Any = SimpleNamespace(specification={"socket": descriptor})
    with ours, closing(Application(side)) as face:
        yield Ends(face, descriptor, ours)


@pytest.mark.parametrize("command", [Command.EMERGENCY_STOP, Command.QUIT, Command.CLOSE])
def test_what_stops_the_arm_reaches_an_application_that_took_nothing_for_a_while(
    ends: Ends, command: Command
) -> None:
    ends.fill()
    ends.face.report(CommandRequest(1, command))
    ends.face.report(keys(2))
    assert not [event for event in ends.read() if isinstance(event, CommandRequest)]
    ends.face.report(keys(3))
    assert ends.read() == [CommandRequest(1, command), keys(3)]
    ends.face.report(keys(4))
    assert ends.read() == [keys(4)]


def test_a_confirmation_that_could_not_be_told_at_once_is_never_told(ends: Ends) -> None:
    ends.fill()
    ends.face.report(CommandRequest(1, Command.CONFIRM))
    ends.read()
    ends.face.report(keys(2))
    assert ends.read() == [keys(2)]


def test_an_application_that_has_ended_is_told_nothing(ends: Ends) -> None:
    ends.ours.close()
    ends.face.report(CommandRequest(1, Command.EMERGENCY_STOP))
    ends.face.report(keys(2))
