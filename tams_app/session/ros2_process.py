"""The helper process of the bridge to ROS 2, in which DDS has its threads.

Specification: socket (its descriptor), domain, views. Over the socket come the session's records
(`tams_app.ros2.wire`), the header first; what goes back is the emergency stop. It ends when there
will be no more of them, and after SIGTERM or the end of the session when it has published the rest.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import threading

from tams_app.recording import Header
from tams_app.ros2.conversion import Conversion
from tams_app.ros2.participant import DdsParticipant
from tams_app.ros2.wire import LONGEST_BYTES, STOP, decode
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import ROS2_NICE
from tams_app.runtime.worker import Worker
from tams_app.session.viewing import scene_of_header
from tams_app.units import NS_PER_MS

_POLL_S = 0.05
_STOP_WAIT_NS = 100 * NS_PER_MS


def main() -> None:
    side = HelperSide()
    os.nice(ROS2_NICE)
    specification = side.specification
    with side.failing():
        participant = DdsParticipant(int(specification["domain"]), specification["views"])
    with socket.socket(fileno=int(specification["socket"])) as application:
        application.setblocking(False)
        stops = Worker(
            "emergency-stop",
            lambda stop: _receive_stops(participant, application, stop),
            lambda *_: side.stop_requested.set(),
        )
        stops.start()
        side.ready()
        _publish(participant, application, side.stop_requested)
        stops.stop()
    if participant.refused:
        sys.stderr.write(f"{participant.refused} messages found no room: a reader was too slow\n")
    if stops.failure is not None:
        raise stops.failure


def _receive_stops(
    participant: DdsParticipant, application: socket.socket, stop: threading.Event
) -> None:
    while not stop.is_set():
        if participant.stop_asked(_STOP_WAIT_NS):
            # an application that takes nothing has ended, or has this to read already
            with contextlib.suppress(BlockingIOError, ConnectionError):
                application.send(STOP)


def _publish(
    participant: DdsParticipant, application: socket.socket, stop_requested: threading.Event
) -> None:
    """Every record that comes, until none will come any more."""
    conversion: Conversion | None = None
    datagram = memoryview(bytearray(LONGEST_BYTES))
    while True:
        ending = stop_requested.is_set()  # with the records received by now
        if not select.select([application], [], [], 0 if ending else _POLL_S)[0]:
            if ending:
                return
            continue
        size = application.recv_into(datagram)
        if not size:
            return
        record = decode(datagram[:size])
        if isinstance(record, Header):
            conversion = Conversion(record, scene_of_header(record))
            sent = conversion.opening()
        elif conversion is not None:
            sent = conversion.of(record)
        else:
            continue
        for one in sent:
            participant.publish(one.topic, one.message, one.wall_ns)


if __name__ == "__main__":
    main()
