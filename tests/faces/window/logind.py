"""A bus of the system with a logind that knows two sessions of the user, which can be locked."""

from __future__ import annotations

import os
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

NAME = "org.freedesktop.login1"
_PATH = "/org/freedesktop/login1"
_CONSOLE, _OWN = f"{_PATH}/session/_31", f"{_PATH}/session/_32"
_USER = f"{_PATH}/user/_0"
_INTERFACES = f"""<node>
<interface name="{NAME}.Manager">
  <method name="GetUser"><arg type="u" direction="in"/><arg type="o" direction="out"/></method>
  <method name="GetSession"><arg type="s" direction="in"/><arg type="o" direction="out"/></method>
</interface>
<interface name="{NAME}.User"><property name="Display" type="(so)" access="read"/></interface>
<interface name="{NAME}.Session">
  <property name="LockedHint" type="b" access="read"/>
  <property name="Active" type="b" access="read"/>
  <property name="Type" type="s" access="read"/>
</interface>
</node>"""
_BUS = """<busconfig><listen>unix:path={}</listen><policy context="default">
<allow send_destination="*" eavesdrop="true"/><allow eavesdrop="true"/><allow own="*"/></policy>
</busconfig>"""


@contextmanager
def logind(
    folder: Path, monkeypatch: pytest.MonkeyPatch, own: str = "tty"
) -> Iterator[Callable[[str, bool], None]]:
    """As long as the context lasts; sets a property of the user's session at the console.

    `own`: the type of the session that this process is of, "" for none; it is not locked.
    """
    if shutil.which("dbus-daemon") is None:
        pytest.skip("needs dbus-daemon")
    from gi.repository import Gio, GLib

    path = folder / "bus"
    (folder / "bus.conf").write_text(_BUS.format(path))
    command = ["dbus-daemon", f"--config-file={folder / 'bus.conf'}", "--nofork", "--print-address"]
    daemon = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert daemon.stdout is not None
    address = daemon.stdout.readline().strip()
    monkeypatch.setenv("DBUS_SYSTEM_BUS_ADDRESS", address)
    properties = {"LockedHint": False, "Active": True}
    context = GLib.MainContext()
    loop = GLib.MainLoop(context)
    flags = Gio.DBusConnectionFlags
    connection: Any = None
    ready = threading.Event()

    def answer(_c: Any, _sender: str, _p: str, _i: str, method: str, _v: Any, call: Any) -> None:
        if method == "GetSession" and not own:
            call.return_dbus_error(f"{NAME}.NoSessionForPID", "of no session")
        else:
            call.return_value(GLib.Variant("(o)", (_USER if method == "GetUser" else _OWN,)))

    def value(_c: Any, _sender: str, path: str, _i: str, name: str) -> Any:
        if name == "Display":
            return GLib.Variant("(so)", ("1", _CONSOLE))
        if name == "Type":
            return GLib.Variant("s", "x11" if path == _CONSOLE else own)
        return GLib.Variant("b", properties[name] if path == _CONSOLE else name == "Active")

    def serve() -> None:
        nonlocal connection
        context.push_thread_default()
        connection = Gio.DBusConnection.new_for_address_sync(
            address, flags.AUTHENTICATION_CLIENT | flags.MESSAGE_BUS_CONNECTION, None, None
        )
        found = Gio.DBusNodeInfo.new_for_xml(_INTERFACES).interfaces
        for place, interface in zip(
            (_PATH, _USER, _CONSOLE, _OWN), (*found, found[-1]), strict=True
        ):
            connection.register_object(place, interface, answer, value, None)
        connection.call_sync(
            *("org.freedesktop.DBus", "/org/freedesktop/DBus", "org.freedesktop.DBus"),
            *("RequestName", GLib.Variant("(su)", (NAME, 0)), None, 0, -1, None),
        )
        ready.set()
        loop.run()
        context.pop_thread_default()

    def change(name: str, now: bool) -> None:
        properties[name] = now
        changed = (f"{NAME}.Session", {name: GLib.Variant("b", now)}, [])
        signal = ("org.freedesktop.DBus.Properties", "PropertiesChanged")
        connection.emit_signal(None, _CONSOLE, *signal, GLib.Variant("(sa{sv}as)", changed))

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        assert ready.wait(30), os.listdir(folder)
        yield change
    finally:
        loop.quit()
        thread.join()
        daemon.terminate()
        daemon.wait(10)
        daemon.stdout.close()
