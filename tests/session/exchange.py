"""Both applications' ends of a link in memory, under a virtual clock each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from tams_app.config import load_config
from tams_app.link.gateway_client import LinkEvent, Received, Routes
from tams_app.recording.journal import Journal
from tams_app.recording.topics import Facts
from tams_app.records import Note, PacketRecord, Record
from tams_app.runtime.clock import VirtualClock
from tams_app.station.robot_call import RobotCall
from tams_app.video.core.repair import RepairRule


class MemoryGateway:
    """What `Gateway` is to an application; `other` is the one at the other computer."""

    def __init__(self, clock: VirtualClock) -> None:
        self.event = LinkEvent(connected=True)
        self.entrance_port = 4242
        self.other: MemoryGateway | None = None
        self.session = 1
        self.delay_ns = 0  # of what is sent
        self.cut = False
        self.routes: Routes | None = None
        self.farewells = 0
        self.sent: list[bytes] = []
        self._clock = clock
        self._coming: list[tuple[int, int, bytes]] = []

    def launch(self) -> None: ...

    def wait_ready(self) -> None: ...

    def close(self) -> None: ...

    def follow(self, routes: Routes) -> None:
        self.routes = routes

    def send_goodbye(self) -> None:
        self.farewells += 1

    def send(self, message: bytes) -> None:
        self.sent.append(message)
        if not self.cut and self.other is not None:
            self.other.arrive(self.other._clock.now_ns() + self.delay_ns, self.session, message)

    def arrive(self, t_ns: int, session: int, message: bytes) -> None:
        self._coming.append((t_ns, session, message))

    def receive(self) -> list[Received]:
        now_ns = self._clock.now_ns()
        come = [one for one in self._coming if one[0] <= now_ns]
        self._coming = [one for one in self._coming if one[0] > now_ns]
        return [Received(*one) for one in come]


def called(gateway: Any, hand: str) -> RobotCall:
    """A call that was answered, by that gateway."""
    welcome: Any = None
    rule, config = RepairRule(True, 60, 300.0), load_config()
    return RobotCall(gateway, welcome, config, None, hand, rule, identity=4711)


class Unkept(Journal):
    """Keeps nothing."""

    def keep(self, item: Record) -> None:
        pass

    def packets(self, packets: Sequence[PacketRecord]) -> None:
        pass


class MemoryJournal(Unkept):
    """Keeps all but packets, in `records`."""

    def __init__(
        self, clock: VirtualClock, show: Callable[[str], None] = lambda _text: None
    ) -> None:
        super().__init__(clock, show)
        self.records: list[Record] = []

    def keep(self, item: Record) -> None:
        self.records.append(item)

    def of(self, kind: type) -> list[Any]:
        return [one for one in self.records if isinstance(one, kind)]

    @property
    def notes(self) -> list[str]:
        return [note.text for note in self.of(Note)]

    @property
    def facts(self) -> dict[str, str]:
        return {name: value for one in self.of(Facts) for name, value in one.values.items()}
