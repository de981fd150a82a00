"""One rater at the terminal: watches the clips of each phase, then rates the views."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from calibration.ui import WizardUI
from calibration.weights.clips import Clip
from calibration.weights.ratings import LEAST, MOST, SCALE_WORDS, Answer, RatingFolder
from tams_app.records import Phase

Show = Callable[[Path], None]

PHASES_IN_WORDS = {
    Phase.REACH: "the open gripper travels towards the object",
    Phase.ALIGN: "the open gripper comes down over the object",
    Phase.GRASP: "the gripper closes on the object",
    Phase.TRANSPORT: "the object is carried to where it belongs",
    Phase.PRE_RELEASE: "the object is lowered onto its place",
    Phase.RELEASE: "the gripper opens and lets the object go",
}
_NO_ANSWER = "-"


def viewing_order(clips: Sequence[Clip], rater: str, seed: int) -> list[tuple[Phase, list[Clip]]]:
    """The phases that have clips, and each one's clips, shuffled for this rater."""
    random = np.random.default_rng([seed, zlib.crc32(rater.encode())])
    phases = [phase for phase in Phase if any(clip.phase is phase for clip in clips)]
    order = []
    for number in random.permutation(len(phases)):
        of_phase = [clip for clip in clips if clip.phase is phases[number]]
        order.append((phases[number], [of_phase[i] for i in random.permutation(len(of_phase))]))
    return order


def rate(
    ui: WizardUI,
    folder: RatingFolder,
    rater: str,
    clips: Sequence[Clip],
    views: Sequence[str],
    show: Show,
    seed: int,
) -> None:
    """Let `rater` answer on the phases that are not answered yet; each is kept at once."""
    sheet = folder.open(rater)
    order = viewing_order(clips, rater, seed)
    left = [(phase, shown) for phase, shown in order if sheet.on(phase) is None]
    if not left:
        ui.say(f"{rater} has rated every phase. Thank you. What was said stays as it is.")
        return
    if sheet.answers:
        before = "1 phase" if len(sheet.answers) == 1 else f"{len(sheet.answers)} phases"
        ui.say(f"{rater} has rated {before} before and goes on from there.")
    ui.say(
        "\nYou will see the robot's work phase by phase, in no particular order, each time through "
        f"all {len(views)} cameras at once, each view's name above it. After each phase, say how "
        "necessary each view is to do that phase well, and which single one you would keep sharp "
        "if the connection could carry only one. There is no right answer. You may stop at any "
        "question with Ctrl-C and go on later under the same name."
    )
    for number, (phase, shown) in enumerate(left, 1):
        ui.say(f"\n{phase.value} ({number} of {len(left)}): {PHASES_IN_WORDS[phase]}.")
        _watch(ui, shown, show)
        folder.add(rater, _ask(ui, phase, views))
    ui.say(f"\nThat was all. Thank you, {rater}.")


def _watch(ui: WizardUI, clips: Sequence[Clip], show: Show) -> None:
    while True:
        for number, clip in enumerate(clips, 1):
            ui.say(f"Clip {number} of {len(clips)}, {clip.seconds:.1f} s.")
            show(clip.path)
        options = {"r": "rate it", "w": "watch again"}
        if ui.choice("Seen?", options) == "r":
            return


def _ask(ui: WizardUI, phase: Phase, views: Sequence[str]) -> Answer:
    """Ask until the rater stands by the answer."""
    scale = {str(point): SCALE_WORDS[point] for point in range(LEAST, MOST + 1)}
    scale[_NO_ANSWER] = "cannot say"
    names = {view.lower(): view for view in views}
    while True:
        necessity: dict[str, int | None] = {}
        for view in views:
            said = ui.choice(f"{phase.value}: how necessary is {view.upper()}?", scale)
            necessity[view] = None if said == _NO_ANSWER else int(said)
        options = {key: view.upper() for key, view in names.items()} | {_NO_ANSWER: "cannot say"}
        named = ui.choice("Only one view can stay sharp. Which one?", options)
        critical = names.get(named)
        points = ", ".join(f"{view.upper()} {necessity[view] or '-'}" for view in views)
        whole = f"{points}; most critical {critical.upper() if critical else '-'}"
        if ui.yes(f"{phase.value}: {whole}. Keep that? It cannot be changed later."):
            return Answer(phase, necessity, critical)
