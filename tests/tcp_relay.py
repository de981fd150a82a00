"""A TCP relay between a client and a server, which can keep what the client sends to itself."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from functools import partial

_POLL_S = 0.05
_CONNECT_TIMEOUT_S = 5.0


class TcpRelay:
    """Passes every connection on to `port` of this machine.

    While it holds a connection, what comes from the client is swallowed, as by a cable that was
    cut: the connection stays open, and neither end is told.
    """

    def __init__(self, port: int) -> None:
        self._server_port = port
        self._holding = threading.Event()
        self._held: set[socket.socket] = set()  # connections of clients
        self._clients: set[socket.socket] = set()
        self._ended = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(_POLL_S)
        self.port: int = self._listener.getsockname()[1]
        self.resets = 0  # connections that the client reset
        self._threads: list[threading.Thread] = []
        self._start(self._accept)

    def hold(self) -> None:
        """Hold every connection, also those to come."""
        self._holding.set()

    def hold_present(self) -> None:
        """Hold the connections there are; those to come are passed on."""
        self._held |= self._clients

    def pass_on(self) -> None:
        """From now on pass on again; what was swallowed is lost."""
        self._holding.clear()
        self._held.clear()

    def close(self) -> None:
        """Hang up everywhere."""
        self._ended.set()
        for thread in self._threads:
            thread.join()
        self._listener.close()

    def _start(self, body: Callable[[], None]) -> None:
        thread = threading.Thread(target=body)
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        while not self._ended.is_set():
            try:
                client, _ = self._listener.accept()
            except TimeoutError:
                continue
            server = socket.create_connection(("127.0.0.1", self._server_port), _CONNECT_TIMEOUT_S)
            for one in (client, server):
                one.settimeout(_POLL_S)
                one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._clients.add(client)
            self._start(partial(self._pass, client, server))
            self._start(partial(self._pass, server, client))

    def _pass(self, source: socket.socket, sink: socket.socket) -> None:
        from_client = source in self._clients
        with source:
            while not self._ended.is_set():
                try:
                    data = source.recv(4096)
                    if not data:
                        return
                    if not (from_client and self._holds(source)):
                        sink.sendall(data)
                except TimeoutError:
                    continue
                except ConnectionResetError:
                    self.resets += from_client
                    return
                except OSError:  # the other direction has ended
                    return

    def _holds(self, client: socket.socket) -> bool:
        return self._holding.is_set() or client in self._held
