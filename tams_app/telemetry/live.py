"""The log's channels live, over a WebSocket that Foxglove connects to."""

from __future__ import annotations

from collections.abc import Collection

from foxglove import Context, start_server

from tams_app.telemetry.address import Address, bound, refusal
from tams_app.telemetry.gate import Gate, hidden_host


class LiveServer:
    """Serves what a context has, in threads of its own; of a slow viewer messages are dropped."""

    def __init__(
        self, context: Context, address: Address, name: str, origins: Collection[str]
    ) -> None:
        """To programs, and to web pages of `origins`; SetupError if `address` is not to be had."""
        listening = bound(address)
        try:
            listening.listen()
            inner = hidden_host()
            self._server = start_server(
                name=name, host=inner, port=0, capabilities=[], context=context
            )
        except (OSError, RuntimeError, ValueError) as error:
            listening.close()
            raise refusal(address, str(error)) from error
        self._gate = Gate(listening, (inner, self._server.port), origins)

    def stop(self) -> None:
        """Let the viewers go."""
        self._server.stop()
        self._gate.close()
