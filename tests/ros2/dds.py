"""A node of ROS 2, as far as DDS knows: in this process, on loopback, in a domain of its own."""

from __future__ import annotations

import random
import socket
import time
from collections.abc import Callable, Iterable
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic as DdsTopic

from tams_app.ros2.messages import STOP, Empty, RosTopic
from tams_app.units import NS_PER_S

DEADLINE_S = 60.0
LOOPBACK = """<CycloneDDS><Domain>
<General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""
_FIRST_PORT, _PORTS_OF_A_DOMAIN = 7400, 250  # DDS-RTPS, 9.6.1
RELIABLE = Policy.Reliability.Reliable(NS_PER_S)
BEST_EFFORT = Policy.Reliability.BestEffort


def free_domain() -> int:
    """A domain that no other program of this computer uses."""
    while True:
        domain = random.randrange(10, 100)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                # of the first participant's discovery
                probe.bind(("127.0.0.1", _FIRST_PORT + domain * _PORTS_OF_A_DOMAIN + 10))
            except OSError:
                continue
            return domain


class Node:
    """Reads topics as a node with ROS's default quality of service does, and may ask for a stop."""

    def __init__(self, domain: int) -> None:
        self._participant = DomainParticipant(domain)
        self._publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)

    def reader(self, topic: RosTopic) -> DataReader[Any]:
        qos = Qos(
            RELIABLE,
            Policy.Durability.TransientLocal if topic.latched else Policy.Durability.Volatile,
            Policy.History.KeepLast(1000),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        dds_topic = DdsTopic(self._participant, topic.dds_name, topic.type)
        return DataReader(self._participant, dds_topic, qos=qos)

    def stop_writer(self, reliability: Any) -> DataWriter[Any]:
        qos = Qos(reliability, Policy.DataRepresentation(use_cdrv0_representation=True))
        topic = DdsTopic(self._participant, STOP.dds_name, Empty)
        return DataWriter(self._participant, topic, qos=qos)

    def offered(self, names: set[str]) -> dict[str, Any]:
        """The writers of these topics, as they tell of themselves."""
        found: dict[str, Any] = {}

        def all_found() -> bool:
            for one in self._publications.take(100):
                if getattr(one, "topic_name", None) in names:
                    found[one.topic_name] = one
            return set(found) == names

        until(all_found)
        return found


def heard_until(readers: Iterable[DataReader[Any]], enough: Callable[[list[Any]], bool]) -> Any:
    """All that these readers took until it was enough."""
    heard: list[Any] = []

    def is_enough() -> bool:
        for reader in readers:
            heard.extend(reader.take(100))
        return enough(heard)

    until(is_enough)
    return heard


def until(condition: Callable[[], bool], meanwhile: Callable[[], None] = lambda: None) -> None:
    """Wait for it, at most for a minute."""
    deadline_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline_s, condition
        meanwhile()
        time.sleep(0.02)
