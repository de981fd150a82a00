"""A 3D mouse (3Dconnexion SpaceMouse) as a controller, through hidapi.

Its cap moves and turns the hand, the left button is the deadman; the right one, pressed briefly
meanwhile, closes and opens the gripper in turn, pressed for longer changes the mode.

Reports, all numbers little-endian: 1: x (right), y (towards the person), z (down) as int16, in
wireless models followed by the three turns; 2: the turns about the same axes; 3: a bit for each
button. Full deflection is about 350. A deflected mouse reports at least 60 times a second, one at
rest not at all. Source: https://github.com/FreeSpacenav/spacenavd and
https://github.com/JakubAndrysek/PySpaceMouse (device tables).
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import hid

from hw.desk.polled import PolledDevice, beyond
from hw.desk.virtual_hand import Deflection
from tams_app.config import DeskConfig
from tams_app.errors import DeviceError
from tams_app.records import Haptic, Presses
from tams_app.units import NS_PER_MS
from tams_app.vectors import ZERO, Floats3

_VENDORS = (0x256F, 0x046D)  # 3Dconnexion, and Logitech, whose older ones bear its number
_LOGITECHS = range(0xC603, 0xC640)  # of whose products these are 3D mice
# Those that are known to be on a cable, by vendor; those of other numbers may come by radio
_ON_CABLE = {
    0x046D: {
        0xC603,
        0xC605,
        0xC606,
        0xC621,
        0xC623,
        0xC625,
        0xC626,
        0xC627,
        0xC628,
        0xC629,
        0xC62B,
    },
    0x256F: {0xC633, 0xC635, 0xC636},
}
_FULL = 350.0
_LONG_NS = 600 * NS_PER_MS
_REPORT_BYTES = 64
_AXES = struct.Struct("<3h")
_TRANSLATION, _ROTATION, _BUTTONS = 1, 2, 3


class Reports:
    """What the reports add up to; pure."""

    def __init__(self, dead_zone: float, by_radio: bool = False) -> None:
        """`by_radio`: it may go without the computer's noticing."""
        self._dead_zone, self._by_radio = dead_zone, by_radio
        self._heard_ns = 0
        self._linear = self._angular = ZERO
        self._left = False
        self._right_since_ns: int | None = None
        self._closes = False  # what the next brief press of the right button does, inverted
        self._presses = Presses()  # of the hand's buttons

    def take(self, report: bytes, now_ns: int) -> None:
        """Take in one report; of a kind that is not known it is left out."""
        kind, content = (report[0], report[1:]) if report else (0, b"")
        if kind in (_TRANSLATION, _ROTATION, _BUTTONS):
            self._heard_ns = now_ns
        if kind == _TRANSLATION and len(content) >= _AXES.size:
            self._linear = _axes(content)
            if len(content) >= 2 * _AXES.size:
                self._angular = _axes(content[_AXES.size :])
        elif kind == _ROTATION and len(content) >= _AXES.size:
            self._angular = _axes(content)
        elif kind == _BUTTONS and content:
            self._left = bool(content[0] & 1)
            self._press_right(bool(content[0] & 2), now_ns)

    def deflection(self) -> Deflection:
        """All axes and buttons."""
        forward, left, up = beyond(self._dead_zone, *self._linear)
        roll, pitch, yaw = beyond(self._dead_zone, *self._angular)
        return Deflection(
            linear=(forward, left, up),
            angular=(roll, pitch, yaw),
            trigger=float(self._left),
            presses=self._presses,
        )

    def known_ns(self, now_ns: int) -> int:
        """Until when it is known to be in this state: the last report's time while it must report.

        It must while it is deflected. With only the deadman held it says nothing: on a cable that
        is as good as a report, by radio it may have gone.
        """
        asked = self.deflection()
        is_deflected = any(asked.linear) or any(asked.angular)
        return self._heard_ns if is_deflected or (self._left and self._by_radio) else now_ns

    def _press_right(self, down: bool, now_ns: int) -> None:
        since_ns = self._right_since_ns
        if down:
            self._right_since_ns = now_ns if since_ns is None else since_ns
            return
        self._right_since_ns = None
        if since_ns is None:
            return
        done = self._presses
        if now_ns - since_ns >= _LONG_NS:
            self._presses = replace(done, grip=done.grip + 1)
        elif self._left:  # else the gripper stays as it is
            self._closes = not self._closes
            close, opens = done.a + self._closes, done.b + (not self._closes)
            self._presses = replace(done, a=close, b=opens)


class SpaceMouse(PolledDevice):
    """The first 3D mouse, or the first one with `DeskConfig.name` in its name."""

    title = "3D mouse"

    def __init__(self, config: DeskConfig, now_ns: Callable[[], int]) -> None:
        self._config, self._now_ns = config, now_ns
        self._device: Any = None
        self._reports = Reports(config.dead_zone)

    def open(self) -> None:
        found = [one for one in hid.enumerate() if self._is_one(one)]
        if not found:
            which = f" whose name has {self._config.name!r} in it" if self._config.name else ""
            raise DeviceError(
                f"There is no 3D mouse{which}: plug one in, or choose another --hand."
            )
        device = hid.device()
        try:
            device.open_path(found[0]["path"])
            device.set_nonblocking(True)
        except OSError as error:
            raise DeviceError(
                "The 3D mouse cannot be opened: give your user the right to read it "
                "(docs/OPERATOR.md has the udev rule), then plug it in again."
            ) from error
        self._device = device
        declared = self._config.wireless
        on_cable = found[0]["product_id"] in _ON_CABLE[found[0]["vendor_id"]]
        by_radio = not on_cable if declared is None else declared
        self._reports = Reports(self._config.dead_zone, by_radio)

    def read(self) -> tuple[Deflection, int]:
        now_ns = self._now_ns()
        if self._device is None:
            raise DeviceError("The 3D mouse is not open.")
        try:
            while report := self._device.read(_REPORT_BYTES):
                self._reports.take(bytes(report), now_ns)
        except OSError as error:
            raise DeviceError("The 3D mouse was unplugged: plug it in again.") from error
        return self._reports.deflection(), self._reports.known_ns(now_ns)

    def pulse(self, haptic: Haptic) -> None:
        """It cannot be felt."""

    def close(self) -> None:
        device, self._device = self._device, None
        if device is not None:
            device.close()

    def _is_one(self, described: dict[str, Any]) -> bool:
        vendor, product = described["vendor_id"], described["product_id"]
        known = vendor == _VENDORS[0] or (vendor == _VENDORS[1] and product in _LOGITECHS)
        name = described.get("product_string") or ""
        return known and self._config.name.lower() in name.lower()


def _axes(content: bytes) -> Floats3:
    """x, y, z of a report as forward, left, up, -1 to 1."""
    x, y, z = _AXES.unpack_from(content)
    return _scaled(-y), _scaled(-x), _scaled(-z)


def _scaled(counts: int) -> float:
    return max(-1.0, min(1.0, counts / _FULL))
