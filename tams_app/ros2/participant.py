"""DDS: what we publish, and the emergency stop that we receive. For a process of its own.

Quality of service, names and types are as rmw_cyclonedds and rmw_fastrtps have them, so that nodes
of ROS 2 match. The type's hash goes where they look for it: without it they match too, and warn.
"""

from __future__ import annotations

from collections.abc import Iterable

from cyclonedds.core import (
    DDSException,
    InstanceState,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.qos import BasePolicy, Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic as DdsTopic

from tams_app.errors import SetupError
from tams_app.ros2.messages import STOP, Empty, RosTopic, published, ros_name, type_hash
from tams_app.units import NS_PER_MS

BLOCKED_NS = 10 * NS_PER_MS  # at most, by a reader that takes nothing
_ANY = SampleState.Any | ViewState.Any | InstanceState.Any
_TAKEN_AT_ONCE = 16


class DdsParticipant:
    """One participant of a DDS domain, with a writer for each topic."""

    def __init__(self, domain: int, views: Iterable[str]) -> None:
        """SetupError in one sentence if DDS cannot be used here."""
        self.refused = 0  # messages that a slow reader left no room for
        try:
            self._participant = DomainParticipant(domain)
            self._writers = {topic: self._writer(topic) for topic in published(views)}
            stop = DdsTopic(self._participant, STOP.dds_name, STOP.type)
            # one asks for reliability and one takes what is offered: no publisher is missed
            self._stops = [
                DataReader(self._participant, stop, qos=_qos(STOP, one))
                for one in (_RELIABLE, Policy.Reliability.BestEffort)
            ]
            self._stop_set = WaitSet(self._participant)
            for reader in self._stops:
                self._stop_set.attach(ReadCondition(reader, _ANY))
        except DDSException as error:
            raise SetupError(
                f"ROS 2 cannot be reached in domain {domain} ({error.msg}): check the network and "
                "the environment variable CYCLONEDDS_URI"
            ) from error

    def publish(self, topic: RosTopic, message: IdlStruct, wall_ns: int) -> None:
        """Send a message with its time; waits for a slow reader, but not for long."""
        try:
            if topic not in self._writers:  # of another dialect than ours
                self._writers[topic] = self._writer(topic)
            self._writers[topic].write(message, wall_ns)
        except DDSException as error:
            if error.code != DDSException.DDS_RETCODE_TIMEOUT:
                raise
            self.refused += 1

    def stop_asked(self, timeout_ns: int) -> bool:
        """Wait so long for an emergency stop; whether one came."""
        self._stop_set.wait(timeout_ns)
        taken = [one for reader in self._stops for one in reader.take(_TAKEN_AT_ONCE)]
        return any(isinstance(one, Empty) for one in taken)  # others report a writer that left

    def _writer(self, topic: RosTopic) -> DataWriter[IdlStruct]:
        dds_topic = DdsTopic(self._participant, topic.dds_name, topic.type)
        return DataWriter(self._participant, dds_topic, qos=_qos(topic, _RELIABLE))


_RELIABLE = Policy.Reliability.Reliable(BLOCKED_NS)


def _qos(topic: RosTopic, reliability: BasePolicy) -> Qos:
    durability = Policy.Durability.TransientLocal if topic.latched else Policy.Durability.Volatile
    return Qos(
        reliability,
        durability,
        Policy.History.KeepLast(topic.depth),
        Policy.DataRepresentation(use_cdrv0_representation=True),  # XCDR1, as ROS 2
        Policy.Userdata(f"typehash={type_hash(ros_name(topic.type))};".encode()),
    )
