"""The helper process of the headset.

Specification: socket (its descriptor), headset (`HeadsetConfig`). SteamVR and OpenGL are asked for
while the session starts; over the socket comes the `Opening` then, with the descriptors of the
frames' and the facts' memory, and `Beat`s go back.
"""

from __future__ import annotations

from contextlib import ExitStack, closing

from hw.openvr.overlays import Overlays
from hw.openvr.runtime import OpenVrRuntime, binding_errors
from tams_app.config import HeadsetConfig
from tams_app.errors import TamsError
from tams_app.faces.application import Application, Opened
from tams_app.faces.headset.display import HeadsetDisplay, overlay_names
from tams_app.faces.headset.texture import AtlasTexture
from tams_app.faces.messages import BEAT_S, Beat, FaceClosed
from tams_app.runtime.clock import Clock, MonotonicClock
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import WINDOW_NICE, use_nice
from tams_app.units import NS_PER_S

_LOOK_S = 0.008  # between looks for new frames
_LINGER_S = 5.0  # for the session to end this process, once it was notified that nothing is shown


def main() -> None:
    side = HelperSide()
    use_nice(WINDOW_NICE, 0)
    clock = MonotonicClock()
    with ExitStack() as stack:
        with side.failing():
            runtime = OpenVrRuntime.join()
            stack.callback(runtime.close)
            texture = AtlasTexture()
            stack.callback(texture.close)
            stack.callback(runtime.close)  # before the context whose texture SteamVR has
        application = stack.enter_context(closing(Application(side)))
        side.ready()
        opened = application.await_opening()
        if opened is None:
            return
        try:
            why = _show(side, application, opened, runtime, texture, clock)
        except binding_errors(runtime.vr) as error:
            why = f"the connection to SteamVR broke ({type(error).__name__})"
        except TamsError as error:
            why = str(error)
        if why:
            application.report(FaceClosed(clock.now_ns(), why))
            side.stop_requested.wait(_LINGER_S)


def _show(
    side: HelperSide,
    application: Application,
    opened: Opened,
    runtime: OpenVrRuntime,
    texture: AtlasTexture,
    clock: Clock,
) -> str:
    """Show the session until it ends: "", or why nothing is shown any more."""
    config = HeadsetConfig.model_validate(side.specification["headset"])
    names = overlay_names(opened.opening.views)
    overlays = Overlays(runtime, names, config.placement == "head")
    display = HeadsetDisplay(opened, config, overlays, texture, clock)
    beat_ns, reported = round(BEAT_S * NS_PER_S), 0
    while not side.stop_requested.wait(_LOOK_S):
        now_ns = clock.now_ns()
        display.step(now_ns)
        if why := overlays.look():
            return why
        if now_ns - reported >= beat_ns:
            reported = now_ns
            application.report(Beat(now_ns, display.drawings, display.seen_ns))
    return ""


if __name__ == "__main__":
    main()
