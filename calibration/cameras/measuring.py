"""What is measured of cameras that are known: latency, and with the board lens and place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from typing import Any

import cv2
from matplotlib.figure import Figure
from rich.text import Text

from calibration.cameras.bench import Bench, Task, agreed, until_done
from calibration.cameras.board import Board
from calibration.cameras.fit import (
    FEWEST_VIEWS,
    LensFit,
    MountFit,
    NoFitError,
    fit_lens,
)
from calibration.cameras.flashes import Latency, camera_latency
from calibration.cameras.watching import EVERY, WANTED_VIEWS, ViewTaker, Watcher
from calibration.kit import WizardUI
from tams_app.config import LensConfig, MountConfig
from tams_app.errors import SetupError
from tams_app.records import ArmFigure, Image, Lens
from tams_app.report.plots import WIDE_IN, new_figure, styled
from tams_app.session.lenses import WRIST_VIEW

LENS, MOUNT = "lens", "mount"
_POINTING_S, _FLASHING_S, _SHOWING_S = 120.0, 20.0, 300.0


@dataclass(slots=True)
class Findings:
    """What was found out about one view's camera; None where a step was not done."""

    view: str
    camera: str
    image: Image | None = None
    latency: Latency | None = None
    lens: LensFit | None = None
    mount: MountFit | None = None

    def quality(self) -> dict[str, Any]:
        """For the calibration file; units in the keys."""
        kept: dict[str, Any] = {"camera": self.camera}
        if (latency := self.latency) is not None:
            kept |= {"latency_ms": latency.ms, "latency_error_ms": latency.error_ms}
        if (lens := self.lens) is not None:
            kept |= {"lens_error_px": lens.error_px, "lens_focal_error": lens.focal_error}
            kept["lens_views"] = lens.views
        if (mount := self.mount) is not None:
            kept |= {"mount_error_px": mount.error_px, "mount_position_sd_mm": mount.position_sd_mm}
            kept |= {"mount_rotation_sd_deg": mount.rotation_sd_deg, "mount_views": mount.views}
        # four digits are more than any of it is good for
        return {
            key: float(f"{value:.4g}") if isinstance(value, float) else value
            for key, value in kept.items()
        }

    def lines(self) -> list[str]:
        """What is known, a line each."""
        lines = []
        if self.latency is not None:
            lines.append(f"latency {self.latency.ms:.0f} ± {self.latency.error_ms:.0f} ms")
        if self.lens is not None:
            lines.append(f"lens {self.lens.lens.fx:.0f} px, within {self.lens.error_px:.2f} px")
        if self.mount is not None:
            lines.append(f"mount within {self.mount.error_px:.1f} px")
        return lines


@styled
def findings_figure(found: Sequence[Findings]) -> Figure:
    """The views with what is known of each."""
    lines = max(len(each.lines()) for each in found)
    figure = new_figure(WIDE_IN, 3.0 + 0.16 * lines)
    for axes, each in zip(figure.subplots(1, len(found), squeeze=False)[0], found, strict=True):
        axes.set_title(f"{each.view.upper()}: {each.camera}")
        if each.image is not None:
            axes.imshow(cv2.cvtColor(each.image, cv2.COLOR_BGR2RGB))
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_xlabel("\n".join(each.lines()), loc="left")
    return figure


def measure_latency(ui: WizardUI, bench: Bench, views: Sequence[Findings]) -> None:
    """Light to time stamp of each view; a view that does not see the flashes is left out."""
    with bench.screen() as flashes:
        ui.print("A window flashes black and white.")
        for found in views:
            view = found.view.upper()
            ui.print(f"{view}: point it at the window, so that it fills most of the image; Enter.")
            bench.prompt(Task.SHOW_SCREEN, found.view)
            for _ in until_done(ui, bench, [found.camera], _POINTING_S):
                pass  # not pointed at it yet
            ui.print(f"{view}: keep still for {_FLASHING_S:g} s.")
            shots = list(bench.shots([found.camera], _FLASHING_S))
            levels = [float(frame.image[::4, ::4].mean()) for frame in shots]
            try:
                found.latency = camera_latency(
                    levels, [frame.capture_ns for frame in shots], flashes
                )
            except ValueError as error:
                ui.print(f"{view}: no latency: {error}: nearer, and no other light on the screen.")
                continue
            ui.print(
                f"{view}: light to time stamp {found.latency.ms:.0f} ± {found.latency.error_ms:.0f}"
                f" ms, the display's own delay included ({found.latency.flashes} flashes)."
            )


def measure_lens(ui: WizardUI, bench: Bench, board: Board, found: Findings) -> None:
    """The lens of one camera, from views of the board; left out if they do not determine it."""
    view = found.view.upper()
    while True:
        ui.print(
            f"{view}: show it the board from {WANTED_VIEWS} sides: so near that it fills half of "
            "the picture, in all corners of the picture, tilted to all sides by some 30°. Hold it "
            "still each time; it is taken by itself. Enter ends it."
        )
        bench.prompt(Task.SHOW_BOARD, found.view)
        try:
            found.lens = _lens(ui, bench, board, found)
        except NoFitError as error:
            ui.print(f"{view}: no lens: {error}.")
            if not agreed(ui, bench, "Try again?"):
                return
        else:
            ui.print(f"{view}: {lens_words(found.lens)}.")
            return


def _lens(ui: WizardUI, bench: Bench, board: Board, found: Findings) -> LensFit:
    taker = ViewTaker(bench.width, bench.height)
    for frame in until_done(ui, bench, [found.camera], _SHOWING_S, EVERY):
        found.image = frame.image
        outcome = taker.offer(board.find(frame.image))
        left = ", ".join(taker.open_edges) or "none"
        ui.show(
            Text(
                f"{found.view.upper()} {len(taker.views)} of {WANTED_VIEWS} views; edges without "
                f"corners: {left}; {outcome}"
            )
        )
        if taker.is_complete:
            break
    if not taker.views:
        raise NoFitError("the board was not seen at rest: is it sharp, well lit, large enough?")
    if len(taker.views) >= FEWEST_VIEWS and taker.open_edges:
        raise NoFitError(
            "no corner of the board came near these parts of the picture's edge: "
            + ", ".join(taker.open_edges)
        )
    return fit_lens(taker.views, bench.width, bench.height)


def measure_mounts(
    ui: WizardUI,
    bench: Bench,
    board: Board,
    views: Sequence[Findings],
    lenses: Mapping[str, Lens],
    figure: ArmFigure | None,
) -> None:
    """Where the cameras are: first of the one on the arm, and by it of the others.

    `lenses`: by view; cameras without are left out. SetupError if the lens of the camera on the
    arm, or the arm's flange, is not known.
    """
    if figure is None:
        raise SetupError("of this kind of arm it is not known where its flange is")
    if WRIST_VIEW not in lenses:
        raise SetupError(
            "where the cameras are is told by the arm and the camera on it: measure the lens of "
            f"{WRIST_VIEW.upper()} as well, with --only lens,mount"
        )
    for each in views:
        if each.view not in lenses:
            ui.print(f"{each.view.upper()}: left out, for its lens was not measured.")
    known = {each.view: each for each in views if each.view in lenses}
    cameras = {view: each.camera for view, each in known.items()}
    with bench.listening():
        watcher = Watcher(ui, bench, board, cameras, lenses, figure)
        hand_eye = watcher.mount_on_arm()
        if hand_eye is not None:
            known[WRIST_VIEW].mount = hand_eye.mount
            for view, mount in watcher.mounts_beside(hand_eye).items():
                known[view].mount = mount


def lens_words(fit: LensFit) -> str:
    """What was found, with its error."""
    bent = "distorted" if fit.lens.is_distorted else "without distortion"
    return (
        f"focal length {fit.lens.fx:.1f} px (± {fit.focal_error:.2%}), {bent}; in views that it "
        f"was not fitted to the corners are within {fit.error_px:.2f} px (rms); {fit.views} views"
    )


def lens_section(fit: LensFit, today: date) -> LensConfig:
    """For the configuration; rounded to what means anything."""
    lens = fit.lens
    fx, fy, cx, cy = (round(number, 3) for number in (lens.fx, lens.fy, lens.cx, lens.cy))
    k1, k2, p1, p2, k3 = (float(f"{number:.6g}") for number in lens.distortion)
    return LensConfig(
        width=lens.width, height=lens.height, fx=fx, fy=fy, cx=cx, cy=cy,
        distortion=(k1, k2, p1, p2, k3), error_px=round(fit.error_px, 3), measured=today,
    )  # fmt: skip


def mount_section(fit: MountFit, view: str, today: date) -> MountConfig:
    """For the configuration, of the camera of `view`."""
    x, y, z = (round(one, 3) for one in (fit.pose.position * 1000.0).tolist())
    a, b, c = (round(one, 6) for one in fit.pose.rotation.as_rotvec())
    return MountConfig(
        frame="arm" if view == WRIST_VIEW else "base", position_mm=(x, y, z),
        rotation_vector_rad=(a, b, c), error_px=round(fit.error_px, 3), measured=today,
    )  # fmt: skip
