"""The colours of the whole project: one table for views, on the screen and in every figure.

Okabe and Ito's palette, told apart also with deficient colour vision. Names or markers stand beside
colours wherever they mean something: colour alone tells nothing.
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


def view_colour(place: int) -> str:
    """The colour of the view at `place` of `video.views`."""
    return VIEW_COLOURS[place % len(VIEW_COLOURS)]


def rgb(colour: str) -> tuple[float, float, float]:
    """`#rrggbb` as three shares of one."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red / 255, green / 255, blue / 255
