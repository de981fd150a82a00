"""The live ends of the chains: UDP sockets bound before anything starts, and what they sent."""

from __future__ import annotations

import ipaddress
from typing import Any

from tams_app import gst
from tams_app.errors import ConfigError
from tams_app.records import IP_UDP_HEADER_BYTES
from tams_app.video.ports import ViewPorts

# A 33 ms frame at 20 Mbit/s is 80 kB; room for many while the decoder waits for the GIL.
RECEIVE_BUFFER_BYTES = 2_000_000


class UdpSocket:
    """A bound UDP socket that a `udpsrc` takes over, so that its port is known before the start."""

    def __init__(self, host: str, port: int, what: str) -> None:
        """Bind `host`:`port` (0: any free port); ConfigError if that is impossible."""
        modules = gst.load()
        gio = modules.Gio
        try:
            ipaddress.ip_address(host)
        except ValueError as error:
            raise ConfigError(f"video.bind_host: {host!r} is not an IP address") from error
        address = gio.InetSocketAddress.new_from_string(host, port)
        self._socket = gio.Socket.new(
            address.get_family(), gio.SocketType.DATAGRAM, gio.SocketProtocol.UDP
        )
        try:
            self._socket.bind(address, False)
        except modules.GLib.Error as error:
            self._socket.close()
            raise ConfigError(
                f"the {what} cannot use UDP port {port} on {host} ({error.message}); "
                "change video.first_port or video.bind_host"
            ) from error
        self.port: int = self._socket.get_local_address().get_port()

    def attach(self, udpsrc: Any) -> None:
        """Let `udpsrc` receive from this socket."""
        udpsrc.set_property("socket", self._socket)

    def close(self) -> None:
        """Free the port; may be called twice."""
        self._socket.close()


def udp_source(name: str, caps: str) -> str:
    """Launch description of a receiving end; a `UdpSocket` is attached to `name`."""
    return f'udpsrc name={name} buffer-size={RECEIVE_BUFFER_BYTES} caps="{caps}"'


def udp_sink(name: str, bind_host: str, host: str, port: int) -> str:
    """Launch description of a sending end that never waits for a clock."""
    return (
        f"udpsink name={name} bind-address={bind_host} host={host} port={port} "
        "sync=false async=false"
    )


def wire_bytes_sent(udpsink: Any, ports: ViewPorts) -> int:
    """IP datagram bytes that left through the RTP `udpsink`: exact, 3 µs, no packet callback."""
    sent = udpsink.emit("get-stats", ports.host, ports.rtp)
    payload: int = sent.get_value("bytes-sent")
    packets: int = sent.get_value("packets-sent")
    return payload + packets * IP_UDP_HEADER_BYTES
