"""The operator guide's drawings: `python -m benchmarks.drawings` writes docs/drawings/*.svg.

The place is that of config/lite6.yaml with the rig's cameras, the buttons are as the bindings say.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle, Wedge

from hw.sim.layout import draw_layout
from hw.sim.viewpoints import FIXED_VIEWPOINTS
from tams_app.config import CONFIG_DIRECTORY, Config, load_config
from tams_app.palette import BLUE, view_colour
from tams_app.report.plots import (
    BANDS,
    FAINT,
    INK,
    SMALL_PT,
    STOP,
    WIDE_IN,
    new_figure,
    save_figure,
    styled,
)

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "drawings"
GREY, ZONE = BANDS[1], f"{BLUE}22"
KEEP_OUT_MM = 700  # OPERATOR.md, section 2
VIEWS = ("eih", "gt", "gs")
NAMES = {"gt": "GT, above the table", "gs": "GS, beside it"}


@styled
def place(config: Config) -> Figure:
    """The table from above and from the side, to scale [mm]."""
    figure = new_figure(WIDE_IN, 6.2)
    top, side = figure.subplots(1, 2, width_ratios=(1.15, 1))
    _from_above(top, config)
    _from_the_side(side, config)
    return figure


def _from_above(axes: Axes, config: Config) -> None:
    limits = config.limits
    axes.set_title("from above")
    axes.add_patch(Circle((0, 0), KEEP_OUT_MM, color=STOP, fill=False, linestyle="--"))
    _note(axes, "no person, nothing that\nmust not be hit: 700 mm", (-330, -560), STOP)
    ring = Wedge(
        (0, 0), limits.radius_max_mm, 0, 180, width=limits.radius_max_mm - limits.radius_min_mm
    )
    ring.set(facecolor="none", edgecolor=FAINT, linestyle=":")
    axes.add_patch(ring)
    (low_x, low_y, _), (high_x, high_y, _) = limits.box_min_mm, limits.box_max_mm
    box = Rectangle((-high_y, low_x), high_y - low_y, high_x - low_x)
    box.set(facecolor=ZONE, edgecolor=BLUE)
    axes.add_patch(box)
    _note(axes, "workspace:\nbox and ring", (-235, 430), BLUE)
    axes.add_patch(Circle((0, 0), 60, color=INK))
    _note(axes, "base", (75, -25))
    layout = draw_layout(0)
    for thing, size, name in ((layout.block, 12, "block"), (layout.container, 96, "container")):
        x, y = -thing.y * 1000, thing.x * 1000
        square = Rectangle((x - size / 2, y - size / 2), size, size, color=INK, fill=size < 50)
        axes.add_patch(square)
        _note(axes, name, (x + size / 2 + 10, y - 12))
    for view, viewpoint in FIXED_VIEWPOINTS.items():
        x, y, _ = viewpoint.place
        _camera(
            axes,
            view,
            (-y * 1000, x * 1000),
            (-viewpoint.target[1] * 1000, viewpoint.target[0] * 1000),
        )
    axes.annotate("", (0, 200), (0, 60), arrowprops={"arrowstyle": "->", "color": INK})
    axes.annotate("", (-140, 0), (0, 0), arrowprops={"arrowstyle": "->", "color": INK})
    _note(axes, "x", (10, 165))
    _note(axes, "y", (-150, 15))
    _note(axes, "emergency stop button:\nat the operator's free hand", (-560, 820), STOP)
    axes.add_patch(Circle((-610, 850), 28, color=STOP))
    axes.set(xlim=(-760, 860), ylim=(-740, 960), xlabel="−y [mm]", ylabel="x, forward [mm]")
    axes.set_aspect("equal")


def _from_the_side(axes: Axes, config: Config) -> None:
    limits, tool_mm = config.limits, config.arm.tcp_offset_mm_deg[2]
    axes.set_title("from the right-hand side")
    axes.axhline(0, color=INK)
    _note(axes, "table", (-190, 8))
    (low_x, _, _), (high_x, _, high_z) = limits.box_min_mm, limits.box_max_mm
    box = Rectangle((low_x, limits.floor_mm), high_x - low_x, high_z - limits.floor_mm)
    box.set(facecolor=ZONE, edgecolor=BLUE)
    axes.add_patch(box)
    _note(axes, f"lowest: {limits.floor_mm:g} mm\nabove the table", (430, 12), BLUE)
    ready_x, ready_z = 350.0, 180.0
    links = ((0, 0), (0, 243), (60, 430), (262, 380), (ready_x, ready_z + tool_mm + 60))
    axes.plot(*zip(*links, strict=True), color=FAINT, linewidth=9, solid_capstyle="round")
    tool = ((ready_x, ready_z + tool_mm + 60), (ready_x, ready_z))
    axes.plot(*zip(*tool, strict=True), color=INK, linewidth=4)
    axes.plot([ready_x], [ready_z], "o", color=STOP)
    _note(
        axes, f"fingertips in the ready pose:\n{ready_x:g}, 0, {ready_z:g} mm", (ready_x + 75, 150)
    )
    _camera(axes, "eih", (ready_x - 70, ready_z + tool_mm + 20), (ready_x, ready_z - 60))
    _note(axes, "EIH,\nat the gripper", (75, 285), view_colour(0))
    for view, viewpoint in FIXED_VIEWPOINTS.items():
        x, _, z = viewpoint.place
        aim = (viewpoint.target[0] * 1000, viewpoint.target[2] * 1000)
        _camera(axes, view, (x * 1000, z * 1000), aim)
    axes.set(xlim=(-220, 1100), ylim=(-60, 960), xlabel="x, forward [mm]", ylabel="z, up [mm]")
    axes.set_aspect("equal")


def _camera(axes: Axes, view: str, at: tuple[float, float], target: tuple[float, float]) -> None:
    colour = view_colour(VIEWS.index(view))
    axes.annotate("", target, at, arrowprops={"arrowstyle": "->", "color": colour})
    axes.plot([at[0]], [at[1]], "s", color=colour, markersize=9)
    if view in NAMES:
        _note(axes, NAMES[view], (at[0] - 60, at[1] + 35), colour)


@styled
def wiring(_config: Config) -> Figure:
    """What is plugged into what, on one computer and on two."""
    figure = new_figure(WIDE_IN, 4.6)
    one, two = figure.subplots(1, 2)
    boxes = {
        "cameras": ((0, 2), "three USB cameras"),
        "arm": ((0, 1), "Lite 6\ncontrol box"),
        "stop": ((0, 0), "emergency stop\nbutton"),
    }
    one.set_title("one computer: run")
    _boxes(
        one,
        {**boxes, "pc": ((3, 1), "TAMS\nand SteamVR"), "hand": ((6, 1), "headset and\ncontroller")},
    )
    _lines(one, boxes, (3, 1))
    _wire(one, (3, 1), (6, 1), "SteamVR")
    two.set_title("two computers: robot and operate")
    _boxes(
        two,
        {
            **boxes,
            "robot": ((3, 1), "robot's side:\ntams robot"),
            "operator": ((6, 2), "operator's side:\ntams operate"),
            "hand": ((6, 0), "headset and\ncontroller"),
        },
    )
    _lines(two, boxes, (3, 1))
    _wire(two, (3, 1), (6, 2), "one UDP port,\nencrypted")
    _wire(two, (6, 2), (6, 0), "SteamVR")
    for axes in (one, two):
        axes.set(xlim=(-1.2, 7.3), ylim=(-0.6, 2.6))
        axes.axis("off")
    return figure


def _boxes(axes: Axes, boxes: dict[str, tuple[tuple[float, float], str]]) -> None:
    for (x, y), text in boxes.values():
        box = FancyBboxPatch((x - 0.95, y - 0.3), 1.9, 0.6, boxstyle="round,pad=0.04")
        box.set(facecolor=GREY, edgecolor=INK, zorder=2)
        axes.add_patch(box)
        axes.text(x, y, text, ha="center", va="center", zorder=3)


def _lines(
    axes: Axes, boxes: dict[str, tuple[tuple[float, float], str]], to: tuple[float, float]
) -> None:
    _wire(axes, boxes["arm"][0], to, "network\ncable of\nits own")
    _wire(axes, boxes["cameras"][0], to, "USB")
    _wire(axes, boxes["stop"][0], boxes["arm"][0], "", STOP)


def _wire(
    axes: Axes,
    start: tuple[float, float],
    end: tuple[float, float],
    text: str,
    colour: str = INK,
) -> None:
    axes.plot(*zip(start, end, strict=True), color=colour, zorder=1)
    middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
    axes.text(*middle, text, fontsize=SMALL_PT, ha="center", va="bottom", zorder=4)


BUTTONS: Sequence[tuple[str, tuple[float, float], tuple[float, float]]] = (
    ("trigger: deadman and clutch;\nthe arm moves only while it is held", (0.9, 3.3), (2.2, 3.7)),
    ("grip: translation or orientation", (-0.75, 1.6), (-3.6, 1.2)),
    ("A: close the gripper", (0.32, 3.0), (2.2, 2.7)),
    ("B: open the gripper", (0.05, 3.35), (-3.6, 3.6)),
    (
        "joystick, pressed: menu\nheld 1 s: confirm; clicked while armed: stop",
        (-0.4, 2.95),
        (-4.6, 2.4),
    ),
)


@styled
def controller(_config: Config) -> Figure:
    """The right controller of a VIVE Focus 3, as config/steamvr/README.md binds it; no likeness."""
    figure = new_figure(8.6, 4.2)
    axes = figure.subplots()
    axes.add_patch(Circle((0.1, 3.6), 1.0, fill=False, linewidth=7, edgecolor=GREY))
    body = FancyBboxPatch((-0.55, 0.2), 1.1, 2.6, boxstyle="round,pad=0.25")
    body.set(facecolor=GREY, edgecolor=INK)
    axes.add_patch(body)
    axes.add_patch(Circle((0, 3.0), 0.8, facecolor=GREY, edgecolor=INK))
    axes.add_patch(Circle((-0.4, 2.95), 0.22, facecolor=FAINT))
    for label, centre in (("A", (0.32, 3.0)), ("B", (0.05, 3.35))):
        axes.add_patch(Circle(centre, 0.15, facecolor="white", edgecolor=INK))
        axes.text(*centre, label, ha="center", va="center", fontsize=SMALL_PT)
    axes.add_patch(Wedge((0.72, 3.2), 0.35, -60, 80, facecolor=FAINT))
    axes.add_patch(Rectangle((-0.95, 1.2), 0.28, 0.9, facecolor=FAINT))
    for text, at, written in BUTTONS:
        axes.annotate(
            text, at, written, va="center",
            arrowprops={"arrowstyle": "-", "color": INK},
        )  # fmt: skip
    axes.set(xlim=(-4.8, 5.6), ylim=(-0.2, 4.8))
    axes.set_aspect("equal")
    axes.axis("off")
    return figure


def _note(axes: Axes, text: str, at: tuple[float, float], colour: str = INK) -> None:
    axes.text(*at, text, color=colour, fontsize=SMALL_PT)


DRAWINGS: dict[str, Callable[[Config], Figure]] = {
    "place": place,
    "wiring": wiring,
    "controller": controller,
}


def main() -> None:
    config = load_config(CONFIG_DIRECTORY / "lite6.yaml", {})
    for name, draw in DRAWINGS.items():
        save_figure(draw(config), FOLDER / f"{name}.svg")


if __name__ == "__main__":
    main()
