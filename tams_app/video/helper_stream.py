"""What a helper process says to the session over a connection of its own, up to its end."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator

_READ_TIMEOUT_S = 0.2  # how late a stop may be noticed
_READ_BYTES = 1 << 16


def received(connection: socket.socket, stop: threading.Event) -> Iterator[bytes]:
    """The bytes as they come; sets the connection's time-out.

    Ends when the helper hung up or, after a stop, has no more to say.
    """
    connection.settimeout(_READ_TIMEOUT_S)
    while True:
        try:
            data = connection.recv(_READ_BYTES)
        except TimeoutError:
            if stop.is_set():
                return
            continue
        except ConnectionResetError:
            return
        if not data:
            return
        yield data
