"""UDP ports of the views, and the live ends of their GStreamer chains."""

from __future__ import annotations

import os
import socket
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from tams_app import gst
from tams_app.errors import SetupError

HOST = "127.0.0.1"  # between computers the gateway carries the flows
# A 33 ms frame at 20 Mbit/s is 80 kB; room for many while the decoder waits for the GIL.
RECEIVE_BUFFER_BYTES = 2_000_000


@dataclass(frozen=True, slots=True)
class ViewPorts:
    """UDP ports of one view's three flows, all on one host.

    The same record says where the flows enter the link and where they come out of it. Without a
    link the two are equal. A sender sends all from its feedback port and receives from the link's
    RTP port alone; a receiver sends from its RTP port and receives from the link's feedback port
    alone. So each end knows which port the other flows come from, and takes no others.
    """

    host: str
    rtp: int  # sender -> receiver: media and RTX
    reports: int  # sender -> receiver: RTCP (sender reports)
    feedback: int  # receiver -> sender: RTCP (receiver reports, NACK, PLI)


class UdpSocket:
    """A bound UDP socket for the ends of a chain, so that its port is known before the start.

    Once it is connected it receives from its peer alone: the kernel leaves out what any other
    program sends to this port.
    """

    def __init__(self, what: str) -> None:
        """Bind any free port of HOST; SetupError if there is none, with `what` it is for."""
        modules = gst.load()
        gio = modules.Gio
        address = gio.InetSocketAddress.new_from_string(HOST, 0)
        self._socket = gio.Socket.new(
            address.get_family(), gio.SocketType.DATAGRAM, gio.SocketProtocol.UDP
        )
        try:
            self._socket.bind(address, False)
        except modules.GLib.Error as error:
            self._socket.close()
            raise SetupError(f"the {what} gets no UDP port on {HOST}: {error.message}") from error
        self.port: int = self._socket.get_local_address().get_port()

    def connect(self, host: str, port: int) -> None:
        """Receive from there alone, and no packet received before."""
        self._socket.connect(gst.load().Gio.InetSocketAddress.new_from_string(host, port), None)
        with socket.socket(fileno=os.dup(self._socket.get_fd())) as same, suppress(OSError):
            while True:  # until there is nothing, or a destination that is not there yet
                same.recv(1, socket.MSG_DONTWAIT)

    def attach(self, end: Any) -> None:
        """Let a `udpsrc` or `udpsink` use this socket."""
        end.set_property("socket", self._socket)
        end.set_property("close-socket", False)

    def close(self) -> None:
        """Free the port; may be called twice."""
        self._socket.close()


def udp_source(name: str, caps: str) -> str:
    """Launch description of a receiving end; a `UdpSocket` is attached to `name`."""
    return f'udpsrc name={name} buffer-size={RECEIVE_BUFFER_BYTES} caps="{caps}"'


def udp_sink(name: str, host: str, port: int) -> str:
    """Launch description of a sending end that never waits; a `UdpSocket` is attached to `name`."""
    return f"udpsink name={name} host={host} port={port} sync=false async=false"
