"""Tells people what becomes of the controller, each change once."""

from __future__ import annotations

from collections.abc import Callable

from tams_app.records import ControllerStatus
from tams_app.units import NS_PER_MS, NS_PER_S

QUIET_NS = 200 * NS_PER_MS  # what flickers faster than this is told as it ends up
UNREAD_AFTER_NS = 2 * NS_PER_S


class Announcer:
    """Turns states into notes of level and text, without repeating itself."""

    def __init__(self, note: Callable[[str, str], None]) -> None:
        self._note = note
        self._told: tuple[ControllerStatus, str] | None = None
        self._told_ns = 0
        self._failure = ""
        self._unread: tuple[str, ...] = ()
        self._unread_since_ns: int | None = None
        self._unknown: set[str] = set()

    def tell(self, status: ControllerStatus, why: str, now_ns: int) -> None:
        """Note the status if it is new."""
        if (status, why) == self._told:
            return
        if self._told is not None and now_ns - self._told_ns < QUIET_NS:
            return
        self._told, self._told_ns = (status, why), now_ns
        level = "info" if status is ControllerStatus.OK else "warning"
        self._note(level, f"controller: {status.value}" + (f", {why}" if why else ""))

    def tell_failure(self, sentence: str) -> None:
        """Note why the runtime cannot be reached, if that is new."""
        if sentence != self._failure:
            self._failure = sentence
            self._note("warning", sentence)

    def forget_failure(self) -> None:
        """The runtime was reached."""
        self._failure = ""

    def tell_unread(self, unread: tuple[str, ...], now_ns: int) -> None:
        """Note what a tracked controller has not delivered for UNREAD_AFTER_NS: not bound."""
        if not unread:
            self._unread, self._unread_since_ns = (), None
        elif self._unread_since_ns is None:
            self._unread_since_ns = now_ns
        elif unread != self._unread and now_ns - self._unread_since_ns >= UNREAD_AFTER_NS:
            self._unread = unread
            self._note(
                "warning",
                f"SteamVR delivers no {', '.join(unread)} of the controller: look whether they "
                "are bound under SteamVR's Settings, Controllers, Manage Controller Bindings",
            )

    def tell_unknown_type(self, controller_type: str) -> None:
        """Note a type of controller whose buttons TAMS can only guess."""
        if controller_type not in self._unknown:
            self._unknown.add(controller_type)
            self._note(
                "warning",
                f"the controller's type {controller_type!r} is not one TAMS knows: "
                "try each button in a dry run before the arm moves",
            )
