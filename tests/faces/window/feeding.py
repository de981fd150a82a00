"""Facts that stay the same, told again and again as by a session that lives."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from tams_app.faces.client import FaceClient
from tams_app.faces.messages import Facts

EVERY_S = 0.05


class Feeding:
    """Tells a face the facts that were given last; before any, nothing."""

    def __init__(self, client: FaceClient) -> None:
        self._client = client
        self._facts: Facts | None = None
        self._lock = threading.Lock()
        self.stop = threading.Event()

    def show(self, facts: Facts) -> None:
        """These at once, and from now on."""
        with self._lock:
            self._facts = facts
            self._client.show(facts)

    def pause(self) -> None:
        """Nothing, until others are shown."""
        with self._lock:
            self._facts = None

    def run(self) -> None:
        while not self.stop.wait(EVERY_S):
            with self._lock:
                if self._facts is not None:
                    self._client.show(self._facts)


@contextmanager
def feeding(client: FaceClient) -> Iterator[Feeding]:
    """Feeds `client` for as long as the context lasts."""
    feeder = Feeding(client)
    thread = threading.Thread(target=feeder.run)
    thread.start()
    try:
        yield feeder
    finally:
        feeder.stop.set()
        thread.join()
