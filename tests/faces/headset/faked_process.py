"""The headset's real process on a SteamVR that is scripted from outside, through a socket.

It runs the real binding over the faked function table; what the overlays get is read back through
the process's own OpenGL context.
"""

from __future__ import annotations

import os
import threading
from dataclasses import replace
from multiprocessing.connection import Client, Connection

from tams_app.faces.headset import process
from tests.hw.openvr.fake_openvr import HEADSET, FakeRuntime

ADDRESS, BLIND = "TAMS_FAKED_STEAMVR", "TAMS_FAKED_STEAMVR_LOOKS_AWAY"


def main() -> None:
    runtime = FakeRuntime()
    runtime.overlays.reads_back = BLIND not in os.environ
    runtime.devices[HEADSET].put((0.0, 1.6, 0.0))
    with runtime.in_place_of_the_library():
        if ADDRESS in os.environ:
            connection = Client(os.environ[ADDRESS], "AF_UNIX")
            threading.Thread(target=_serve, args=(connection, runtime), daemon=True).start()
        else:
            runtime.installed = False
        process.main()


def _serve(connection: Connection, runtime: FakeRuntime) -> None:
    """Answer until the other side has ended."""
    overlays = runtime.overlays
    while True:
        try:
            request, *arguments = connection.recv()
        except EOFError:
            return
        answer: object = None
        if request == "overlays":
            with overlays.lock:
                found = overlays.by_handle.values()
                answer = {one.key: replace(one, texture=None) for one in found}
        elif request == "seen":
            answer = overlays.seen(*arguments)
        elif request == "take done":
            with overlays.lock:
                answer, overlays.done = overlays.done, []
        elif request == "event":
            runtime.events.append(*arguments)
        elif request == "quits acknowledged":
            answer = runtime.quits_acknowledged
        elif request == "refuse":
            overlays.error = arguments[0]
        elif request == "head":
            for name, value in arguments[0].items():
                setattr(runtime.devices[HEADSET], name, value)
        connection.send(answer)


if __name__ == "__main__":
    main()
