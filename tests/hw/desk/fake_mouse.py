"""A 3D mouse from the other side of hidapi's binding: what it reports, and how it is unplugged."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import hid

LEFT, RIGHT = 1, 2  # buttons
PATH = b"/dev/hidraw7"
_KEYBOARD = {"vendor_id": 0x046D, "product_id": 0xC31C, "product_string": "Keyboard", "path": b"x"}


def axes_report(kind: int, *axes: int) -> bytes:
    return bytes((kind,)) + struct.pack(f"<{len(axes)}h", *axes)


def buttons_report(buttons: int) -> bytes:
    return bytes((3, buttons, 0, 0))


class FakeMouse:
    """What `hid.device()` makes. Like the real one it tells of a button only when it changes."""

    def __init__(self) -> None:
        self.waiting: list[bytes] = []
        self.gone = self.refuses = False
        self.vendor, self.product = 0x256F, 0xC635  # on a cable
        self.name: str | None = "SpaceMouse Compact"
        self.is_open = False
        self.openings = 0

    @contextmanager
    def in_place_of_hidapi(self) -> Iterator[None]:
        """This one and a keyboard are all that hidapi finds."""

        def enumerated() -> list[dict[str, Any]]:
            mouse = {
                "vendor_id": self.vendor,
                "product_id": self.product,
                "product_string": self.name,
                "path": PATH,
            }
            return [] if self.gone else [_KEYBOARD, mouse]

        with patch.object(hid, "enumerate", enumerated), patch.object(hid, "device", lambda: self):
            yield

    def open_path(self, path: bytes) -> None:
        if self.refuses or self.gone:
            raise OSError("open failed")
        assert path == PATH
        self.waiting = []  # what it told before reached no one
        self.is_open = True
        self.openings += 1

    def set_nonblocking(self, on: bool) -> None:
        assert on

    def read(self, length: int) -> list[int]:
        if self.gone or not self.is_open:
            raise OSError("read error")
        return list(self.waiting.pop(0))[: range(length)[-1] + 1] if self.waiting else []

    def close(self) -> None:
        self.is_open = False
