"""The helper process of the operator's window.

Specification: socket (its descriptor). GTK is loaded while the session starts; over the socket
comes the `Opening` then, with the descriptors of the frames' and the facts' memory, and keys and
buttons go back. It never waits for the application, nor that for it.
"""

from __future__ import annotations

import contextlib
import select
import socket
import sys

import msgspec

from tams_app.console.window.facts_memory import FactsReader
from tams_app.console.window.messages import LONGEST, Event, Opening
from tams_app.console.window.size_memory import keep_size, read_size, size_file
from tams_app.console.window.toolkit import load
from tams_app.console.window.window import OperatorWindow
from tams_app.errors import SetupError, TamsError
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import WINDOW_NICE, use_nice
from tams_app.runtime.shared_ring import map_descriptor
from tams_app.video.frame_ring import SHOWN, FrameReader, RingLayout

_POLL_S = 0.05
_ENDING_MS = 20  # between looks whether to end


def main() -> None:
    side = HelperSide()
    use_nice(WINDOW_NICE, 0)
    try:
        load()
    except SetupError as error:
        side.fail(str(error))
        raise SystemExit(error.exit_code) from error
    with socket.socket(fileno=int(side.specification["socket"])) as application:
        side.ready()
        opened = _await_opening(side, application)
        if opened is not None:
            _show(side, application, *opened)


def _await_opening(side: HelperSide, application: socket.socket) -> tuple[Opening, int, int] | None:
    """What to open with, and the descriptors of frames and facts; None to end before."""
    while not side.stop_requested.is_set():
        if select.select([application], [], [], _POLL_S)[0]:
            content, descriptors, _, _ = socket.recv_fds(application, LONGEST, 2)
            if not content:
                return None
            frames, facts = descriptors
            return msgspec.msgpack.decode(content, type=Opening), frames, facts
    return None


def _show(
    side: HelperSide, application: socket.socket, opening: Opening, frames: int, facts: int
) -> None:
    """The window, until the session ends."""
    GLib = load().GLib
    application.setblocking(False)

    def tell(event: Event) -> None:
        # an application that takes nothing has ended, or reads the next one with all keys in it
        with contextlib.suppress(BlockingIOError, ConnectionError):
            application.send(msgspec.msgpack.encode(event))

    layout = RingLayout(SHOWN, opening.views, opening.width, opening.height)
    block = map_descriptor(frames)
    readers = {view: FrameReader(block, layout, view) for view in opening.views}
    path = size_file()
    window = OperatorWindow(
        opening, readers, FactsReader(facts), tell, MonotonicClock(), read_size(path)
    )
    window.present()
    loop = GLib.MainLoop()

    def end_if_asked() -> bool:
        if side.stop_requested.is_set():
            loop.quit()
        return True

    GLib.timeout_add(_ENDING_MS, end_if_asked)
    loop.run()
    try:
        keep_size(path, window.size)
    except TamsError as error:
        sys.stderr.write(f"{error}\n")


if __name__ == "__main__":
    main()
