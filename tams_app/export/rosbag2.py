"""A log as a bag of ROS 2: the messages that the bridge publishes, at the times of the log.

MCAP storage, what ROS 2 writes by default since Iron, with the definitions of its messages.
"""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer

from tams_app.errors import LogError
from tams_app.outputs import refuse_existing
from tams_app.recording import read_records
from tams_app.recording.rates import RatesMeter
from tams_app.ros2.conversion import Conversion, Sent
from tams_app.ros2.messages import RosTopic, cdr, published, ros_name, typestore
from tams_app.telemetry import Scene

_NEVER = QosTime(0, 0)  # as rosbag2 writes what is not set


def write_bag(log: Path, bag: Path, scene: Scene | None) -> Mapping[str, int]:
    """Write the folder `bag` from the log at `log`; how many messages each topic has.

    `scene`: what is known of the session's surroundings. UnreadableLogError if it is no log of
    ours; ConfigError if there is something in the place of `bag`; LogError if it cannot be
    written: then nothing is left of it.
    """
    refuse_existing(bag)
    try:
        with Writer(bag, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
            return _fill(writer, log, scene)
    except BaseException as error:
        shutil.rmtree(bag, ignore_errors=True)
        if isinstance(error, OSError):
            raise LogError(f"{bag}: cannot be written: {error}") from error
        raise


def _fill(writer: Writer, log: Path, scene: Scene | None) -> Counter[str]:
    records = read_records(log)
    _, header = next(records)
    connections = {topic: _connect(writer, topic) for topic in published(header.views)}
    conversion = Conversion(header, scene)
    meter = RatesMeter(header.views, header.started_ns)
    counts = Counter({topic.name: 0 for topic in connections})

    def write(sent: Sent) -> None:
        if sent.topic not in connections:  # of another dialect than ours
            connections[sent.topic] = _connect(writer, sent.topic)
        writer.write(connections[sent.topic], sent.wall_ns, cdr(sent.message))
        counts[sent.topic.name] += 1

    for sent in conversion.opening():
        write(sent)
    newest_ns = header.started_ns
    for t_ns, record in records:
        newest_ns = max(newest_ns, t_ns)
        for one in (record, meter.step(record, newest_ns)):
            for sent in conversion.of(one):
                write(sent)
    return counts


def _connect(writer: Writer, topic: RosTopic) -> Connection:
    return writer.add_connection(
        topic.name,
        ros_name(topic.type),
        typestore=typestore(),
        offered_qos_profiles=[_qos(topic)],
    )


def _qos(topic: RosTopic) -> Qos:
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=topic.depth,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if topic.latched else QosDurability.VOLATILE,
        deadline=_NEVER,
        lifespan=_NEVER,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=_NEVER,
        avoid_ros_namespace_conventions=False,
    )
