"""The colours of views and of the uplink: the same on the screen and in every figure.

Okabe and Ito's palette, distinguished also with deficient colour vision. Names or markers stand
beside
colours wherever they mean something: colour alone carries nothing.
"""

from __future__ import annotations

BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
ORANGE = "#E69F00"
SKY = "#56B4E9"
YELLOW = "#F0E442"

VIEW_COLOURS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)

# Of the uplink as a whole: greys, as no view has one, seen on white and on the window's ground.
# They are close together: strokes distinguish the curves.
UPLINK_SENT = "#8C949B"
UPLINK_BUDGET = "#6A7178"
CAPACITY_ESTIMATE = "#7B838A"
EMULATED_CAPACITY = "#727A81"


def view_colour(place: int) -> str:
    """The colour of the view at `place` of `video.views`."""
    return VIEW_COLOURS[place % len(VIEW_COLOURS)]


def rgb(colour: str) -> tuple[float, float, float]:
    """`#rrggbb` as three shares of one."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red / 255, green / 255, blue / 255
