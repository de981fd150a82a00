"""What is on the screen before the simulated operator: frames as received, or predicted.

Of an outline over a frame they make nothing: they look past it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

from hw.sim.operator.seeing import OnScreen
from tams_app.prediction.present import Correction, Shown
from tams_app.records import Image

Show: TypeAlias = Callable[[Image, int, int], Shown]  # an image, when it was captured, now [ns]


def on_screen(
    frames: Mapping[str, tuple[int, Image] | None], shows: Mapping[str, Show], now_ns: int
) -> OnScreen:
    """The screen at `now_ns`.

    Args:
        frames: the newest of each view, with when it was captured [ns]; None: nothing yet.
        shows: by view, how a frame is shown whose view is predicted.
        now_ns: on the clock of the screen.
    """
    images: dict[str, Image | None] = {}
    predicted = set()
    for view, found in frames.items():
        images[view] = None if found is None else found[1]
        if found is not None and view in shows:
            shown = shows[view](found[1], found[0], now_ns)
            if shown.correction is Correction.PREDICTED:
                images[view] = shown.image
                predicted.add(view)
    return OnScreen(images, frozenset(predicted))
