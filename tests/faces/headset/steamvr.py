"""The faked SteamVR of a headset's process, from outside that process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection, Listener
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tams_app.faces.client import Face
from tests.faces.headset.faked_process import ADDRESS
from tests.hw.openvr.fake_overlays import FakeOverlay

FAKED = Face("headset", "tests.faces.headset.faked_process", "set headset.show to never")
ANSWER_S = 60.0


class SteamVr:
    """What lies below the function table of the process that connects first."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self._connection: Connection | None = None

    def ask(self, request: str, *arguments: Any) -> Any:
        """See `faked_process`."""
        if self._connection is None:
            self._connection = self._listener.accept()
        self._connection.send((request, *arguments))
        if not self._connection.poll(ANSWER_S):
            raise TimeoutError(request)
        return self._connection.recv()

    def overlays(self) -> dict[str, FakeOverlay]:
        """All overlays by their keys, without what they show."""
        return dict(self.ask("overlays"))

    def seen(self, key: str) -> np.ndarray:
        """What is seen of an overlay: BGR, shape (height, width, 3)."""
        return np.asarray(self.ask("seen", key))

    def close(self) -> None:
        if self._connection is not None:
            self._connection.close()


@contextmanager
def steamvr(folder: Path, patch: pytest.MonkeyPatch) -> Iterator[SteamVr]:
    """For the next headset process that is started; on a display (`virtual_screen`)."""
    address = str(folder / "steamvr")
    with Listener(address, "AF_UNIX") as listener:
        patch.setenv(ADDRESS, address)
        found = SteamVr(listener)
        try:
            yield found
        finally:
            found.close()
