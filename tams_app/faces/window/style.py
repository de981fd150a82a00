"""The style sheet of the window; pure."""

from __future__ import annotations

from tams_app import palette
from tams_app.faces.banner import LOOKS, look_of
from tams_app.faces.canvas import FAINT, GROUND, INK, PANEL

DESIGN_HEIGHT = 720  # sizes below are for it; a higher window has all of it larger
_BORDER_PX = 6
EDGES = ("top", "left", "right", "bottom")  # each a widget of the classes `edge` and `edge-<side>`
LIVE_CLASS, SILENT_CLASS = "live", "silent"  # what is live only, and in a window that is not


def state_class(arming: str) -> str:
    """The class of the window in a state of the arming table."""
    return "state-" + (arming.replace(" ", "-") if arming in LOOKS else "starting")


def view_class(place: int) -> str:
    """The class of the view at `place` of `video.views`."""
    return f"view-{place % len(palette.VIEW_COLOURS)}"


def style_sheet(scale: float) -> str:
    """For a window whose height is `scale` times DESIGN_HEIGHT."""

    def px(size: float) -> str:
        return f"{round(size * scale)}px"

    rules = [
        f"window {{ background: {GROUND}; color: {INK}; font-family: sans-serif; }}",
        *(f".edge-{side} {{ border-{side}-width: {_BORDER_PX}px; }}" for side in EDGES),
        f".banner {{ padding: {px(4)} {px(10)}; min-height: {px(66)}; }}",
        f".banner label {{ font-size: {px(17)}; }}",
        f".banner .sign {{ font-size: {px(30)}; min-width: {px(48)}; }}",
        f".banner .word {{ font-size: {px(30)}; font-weight: bold; min-width: {px(172)}; "
        f"padding-right: {px(18)}; }}",
        f".banner .key {{ font-size: {px(17)}; font-weight: bold; }}",
        f".view-name {{ background: rgba(0,0,0,0.62); color: {INK}; font-size: {px(15)}; "
        f"font-weight: bold; padding: {px(1)} {px(8)}; }}",
        f".view {{ background: black; border: 2px solid {PANEL}; border-top-width: {px(5)}; }}",
        f".said label {{ font-size: {px(13)}; color: {FAINT}; }}",
        f".episodes {{ background: {PANEL}; padding: {px(2)} {px(8)}; }}",
        f".episodes label {{ font-size: {px(14)}; }}",
        ".episodes .running { font-weight: bold; }",
        f".episodes .means {{ color: {FAINT}; }}",
        f".episodes .asked {{ color: {palette.YELLOW}; }}",
        f".replay {{ min-width: {px(160)}; padding: 0 {px(8)}; }}",
        f".replay label {{ font-size: {px(14)}; color: {FAINT}; }}",
        f".replay .position {{ font-size: {px(18)}; font-weight: bold; color: {INK}; }}",
        f".trial {{ background: {PANEL}; padding: {px(16)}; }}",
        f".trial label {{ font-size: {px(20)}; }}",
        f".trial .who {{ font-size: {px(40)}; font-weight: bold; }}",
        f".keys {{ background: {PANEL}; border: 2px solid {INK}; padding: {px(24)}; }}",
        f".keys label {{ font-size: {px(18)}; padding: {px(4)} {px(14)}; }}",
        ".keys .name { font-weight: bold; }",
        f".said {{ padding: 0 {px(6)}; }}",
        f".said .status {{ color: {INK}; }}",
        f".notice {{ background: #1B8A3A; color: white; font-size: {px(19)}; "
        f"font-weight: bold; padding: {px(5)} {px(16)}; margin-top: {px(36)}; }}",
        f".end {{ background: {PANEL}; border: 2px solid {INK}; padding: {px(24)}; }}",
        f".end label {{ font-size: {px(16)}; }}",
        f".end .who {{ font-size: {px(34)}; font-weight: bold; }}",
        f".end .key {{ font-size: {px(19)}; font-weight: bold; margin-top: {px(12)}; }}",
        f"button.act {{ background: #2F3A43; color: white; border: 3px solid white; "
        f"font-size: {px(22)}; font-weight: bold; "
        f"padding: {px(2)} {px(26)}; min-width: {px(64)}; }}",
        "button.act:active { background: #10161B; }",
        "button.stop { background: #B00020; }",
        "button.stop:active { background: #600010; }",
        f".{SILENT_CLASS} .{LIVE_CLASS} {{ filter: grayscale(100%); opacity: 0.45; }}",
    ]
    for place, colour in enumerate(palette.VIEW_COLOURS):
        rules.append(f".{view_class(place)} {{ border-color: {colour}; }}")
    for arming in (*LOOKS, ""):
        look, name = look_of(arming), state_class(arming)
        rules.append(
            f".{name} .edge {{ border-style: {look.border}; border-color: {look.colour}; }}"
        )
        rules.append(f".{name} .banner {{ background: {look.colour}; }}")
        rules.append(f".{name} .banner label {{ color: {look.ink}; }}")
        rules.append(f".{name} .banner button.act label {{ color: white; }}")
    return "\n".join(rules)
