"""The helper process of the operator's window.

Specification: socket (its descriptor). GTK is loaded while the session starts; over the socket
comes the `Opening` then, with the descriptors of the frames' and the facts' memory, and keys and
buttons go back.
"""

from __future__ import annotations

import sys
from contextlib import closing

from tams_app.errors import TamsError
from tams_app.faces.application import Application, Opened
from tams_app.faces.window.sight import x_server
from tams_app.faces.window.toolkit import (
    first_size,
    keep_size,
    load,
    read_size,
    screen_size,
    size_file,
)
from tams_app.faces.window.window import OperatorWindow
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import WINDOW_NICE, use_nice
from tams_app.runtime.worker import Worker

_ENDING_MS = 20  # between looks whether to end


def main() -> None:
    side = HelperSide()
    use_nice(WINDOW_NICE, 0)
    with side.failing():
        x_server()
    with closing(Application(side)) as application:
        side.ready()
        opened = application.await_opening()
        if opened is not None:
            _show(side, application, opened)


def _show(side: HelperSide, application: Application, opened: Opened) -> None:
    """The window, until the session ends."""
    GLib = load().GLib
    path = size_file()
    window = OperatorWindow(
        opened,
        application,
        MonotonicClock(),
        read_size(path, first_size(*screen_size())),
    )
    window.present()
    arrivals = Worker("arrivals", window.await_frames)
    arrivals.start()
    loop = GLib.MainLoop()

    def end_if_asked() -> bool:
        if side.stop_requested.is_set():
            loop.quit()
        return True

    GLib.timeout_add(_ENDING_MS, end_if_asked)
    loop.run()
    arrivals.stop()
    try:
        keep_size(path, window.size)
    except TamsError as error:
        sys.stderr.write(f"{error}\n")


if __name__ == "__main__":
    main()
