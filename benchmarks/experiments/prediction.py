"""How much of the present a late eye-in-hand frame shows, corrected in different ways.

`python -m benchmarks.experiments.prediction` lets a participant with perfect eyes carry the block
in virtual time, one trial for each seed, and looks at the moving parts as an operator would for
whom frame, state and samples are late: by the one-way latency, the frame by 45 ms more and the
state by 5 ms more. First, how far from the truth the arm's TCP is believed to be now: by the newest
state, by that state extrapolated at its own speed, by the forward model. Then the similarity (SSIM)
of the frame to the one that the camera takes now: as it is, and warped to each of those poses, and
to the true one. Frames are free of coding and loss. `--picture FILE` draws one instant,
`--animation FILE` some seconds of motion.

`--sessions` runs whole trials in virtual time instead, each with `view.predict` off and on: live
SSIM as in a log, of the frames captured while the arm moves, and of the primary view.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.experiments.virtual_runs import read_summary, run_side_by_side
from hw.arms import arm_kind
from hw.sim.layout import draw_layout
from hw.sim.world.scene_renderer import SceneRenderer
from tams_app.config import Config, Network, load_config
from tams_app.prediction.forward_model import ArmHeard, ForwardModel
from tams_app.prediction.plane_warp import WristWarp
from tams_app.prediction.trail import Trail
from tams_app.recording import LOG_NAME, read_log
from tams_app.records import Image, Pose, Tick, Vector
from tams_app.robot.build import ready_pose
from tams_app.session.viewing import scene_of
from tams_app.session.virtual.videoless import VideolessTrial
from tams_app.study.unattended import TrialsProgress
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS
from tams_app.video.core.ssim import FrameMoments, luma_of, ssim

ONE_WAY_MS = (40.0, 100.0, 200.0, 400.0)
FRAME_MS, STATE_MS = 45.0, 5.0  # older than the one-way latency
VIEW = "eih"
_EACH_TICKS = 40
_SPEED_OVER = 5  # states, 60 a second: what they are extrapolated by
_WHOLE = 1 << 62
_FRAME_MS, _ANIMATED, _QUALITY = 100, 90, 50  # of an animation
BELIEFS = ("as received", "newest state", "extrapolated", "forward model", "true pose")


class Recorded(VideolessTrial):
    """A trial of which the renderer's state at each tick is kept."""

    def __init__(self, config: Config, seed: int) -> None:
        super().__init__(config, seed)
        self.world = Trail(_WHOLE)

    def on_tick(self, tick: Tick) -> None:
        super().on_tick(tick)
        self.world.add(self._robot.arm.simulated_ns, self._robot.qpos)


@dataclass(frozen=True, slots=True)
class Instant:
    """What is believed of the joints [rad] at a time, by the name of the belief."""

    now_ns: int
    frame_ns: int
    frame_joints: Vector
    believed: dict[str, Vector]
    closed: bool  # the gripper, by the newest state


def instants(
    config: Config, trial: Recorded, one_way_ms: float, each_ticks: int = _EACH_TICKS
) -> Iterator[Instant]:
    """Some while the operator is engaged; by default each third of a second."""
    kind = arm_kind(config.arm.model)
    model = ForwardModel(config, kind.kinematics(config.arm), ready_pose(config).rotation)
    state_ns = round((one_way_ms + STATE_MS) * NS_PER_MS)
    frame_ns = round((one_way_ms + FRAME_MS) * NS_PER_MS)
    states, heard = trial.ticks[::2], 0  # of 120 ticks a second
    for number, tick in enumerate(trial.ticks):
        now_ns = tick.started_ns
        model.sent(tick.controller, now_ns)
        while states[heard].started_ns + state_ns <= now_ns:
            model.heard(_heard(states[heard]), 0)
            heard += 1
        forecast = model.at(now_ns)
        moves = tick.arming == ArmingState.ENGAGED and heard > _SPEED_OVER
        if forecast is None or not moves or number % each_ticks:
            continue
        newest, before = states[heard - 1], states[heard - 1 - _SPEED_OVER]
        joints, then = _joints(newest), _joints(before)
        share = (now_ns - _time(newest)) / (_time(newest) - _time(before))
        late = model.at(now_ns - frame_ns)
        assert late is not None
        yield Instant(
            now_ns,
            now_ns - frame_ns,
            late.joints,
            {
                "newest state": joints,
                "extrapolated": joints + (joints - then) * share,
                "forward model": forecast.joints,
                "true pose": trial.world.at(now_ns)[:6],
            },
            _closed(newest),
        )


def _heard(tick: Tick) -> ArmHeard:
    return ArmHeard(
        t_ns=_time(tick),
        joints=_joints(tick),
        until_ns=tick.started_ns,
        arming=ArmingState(tick.arming),
        orientation_mode=tick.orientation_mode,
        speed_scale=tick.speed_scale,
    )


def _closed(tick: Tick) -> bool:
    assert tick.arm is not None
    return bool(tick.arm.gripper_closed)


def _time(tick: Tick) -> int:
    assert tick.arm is not None
    return tick.arm.received_ns


def _joints(tick: Tick) -> Vector:
    assert tick.arm is not None
    return np.array(tick.arm.joints)


@dataclass(frozen=True, slots=True)
class Measured:
    """Of all instants at one latency, by belief: errors [mm, degrees] and similarities."""

    away_mm: dict[str, list[float]]
    turned_deg: dict[str, list[float]]
    similar: dict[str, list[float]]
    unseen: list[float]


def measure(config: Config, trial: Recorded, seed: int, found: dict[float, Measured]) -> None:
    """Add a trial's instants."""
    kind, scene = arm_kind(config.arm.model), scene_of(config)
    kinematics, figure = kind.kinematics(config.arm), scene.figure
    assert figure is not None
    warp = WristWarp(scene.lenses[VIEW], figure.solids[figure.flange], figure.grip)

    def flange(joints: Vector) -> Pose:
        return figure.place(joints)[figure.flange]

    renderer = SceneRenderer(draw_layout(seed))
    for one_way_ms, measured in found.items():
        for instant in instants(config, trial, one_way_ms):
            true = kinematics.tcp_pose(instant.believed["true pose"])
            for name, joints in instant.believed.items():
                pose = kinematics.tcp_pose(joints)
                away_m = float(np.linalg.norm(pose.position - true.position))
                measured.away_mm[name].append(away_m * 1000)
                turn = (pose.rotation * true.rotation.inv()).magnitude()
                measured.turned_deg[name].append(float(np.degrees(turn)))
            late = renderer.render(VIEW, trial.world.at(instant.frame_ns))
            present = FrameMoments.of(
                luma_of(renderer.render(VIEW, trial.world.at(instant.now_ns)))
            )
            measured.similar["as received"].append(_similar(late, present))
            then = flange(instant.frame_joints)
            for name, joints in instant.believed.items():
                warped = warp.to_now(late, then, flange(joints), instant.closed)
                shown = late if warped is None else warped.image
                measured.similar[name].append(_similar(shown, present))
                if name == "forward model" and warped is not None:
                    measured.unseen.append(warped.unseen)
    renderer.close()


def _similar(image: Image, present: FrameMoments) -> float:
    return ssim(present, FrameMoments.of(luma_of(image)))


class Artist:
    """Draws an instant of a trial: late, corrected and true, beside each other."""

    def __init__(self, config: Config, trial: Recorded, seed: int) -> None:
        scene = scene_of(config)
        assert scene.figure is not None
        self._trial, self._figure = trial, scene.figure
        self._warp = WristWarp(
            scene.lenses[VIEW], self._figure.solids[self._figure.flange], self._figure.grip
        )
        self._kinematics = arm_kind(config.arm.model).kinematics(config.arm)
        self._renderer = SceneRenderer(draw_layout(seed))

    def moved_m(self, instant: Instant) -> float:
        """How far the TCP has moved since the frame."""
        places = instant.frame_joints, instant.believed["true pose"]
        then, now = (self._kinematics.tcp_pose(joints).position for joints in places)
        return float(np.linalg.norm(now - then))

    def draw(self, instant: Instant) -> Image:
        late = self._renderer.render(VIEW, self._trial.world.at(instant.frame_ns))
        true = self._renderer.render(VIEW, self._trial.world.at(instant.now_ns))
        poses = instant.frame_joints, instant.believed["forward model"]
        flange = self._figure.flange
        then, now = (self._figure.place(joints)[flange] for joints in poses)
        warped = self._warp.to_now(late, then, now, instant.closed)
        assert warped is not None
        return np.asarray(np.hstack((late, warped.image, true)), np.uint8)

    def close(self) -> None:
        self._renderer.close()


def animate(artist: Artist, shown: Sequence[Instant], path: Path, one_way_ms: float) -> None:
    """The instants as a looped WebP, in real time, each picture with its name."""
    names = (f"as received, {one_way_ms:g} ms one way", "predicted from it", "the camera now")
    frames = []
    for instant in shown:
        image = cv2.resize(artist.draw(instant), (3 * 320, 240), interpolation=cv2.INTER_AREA)
        for place, name in enumerate(names):
            at = (320 * place + 8, 230)
            for colour, thickness in (((0, 0, 0), 3), ((255, 255, 255), 1)):
                cv2.putText(image, name, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, thickness,
                            cv2.LINE_AA)  # fmt: skip
        frames.append(image)
    animation = cv2.Animation()
    animation.frames = frames
    animation.durations = np.full(len(frames), _FRAME_MS)
    cv2.imwriteanimation(str(path), animation, [cv2.IMWRITE_WEBP_QUALITY, _QUALITY])


def errors_table(found: dict[float, Measured]) -> Table:
    shown = Table("one way", "TCP from the truth, by", "mm p50", "p95", "degrees p50", "p95",
                  box=None)  # fmt: skip
    for one_way_ms, measured in found.items():
        for name, away in measured.away_mm.items():
            figures = (*_quantiles(away), *_quantiles(measured.turned_deg[name]))
            shown.add_row(f"{one_way_ms:g} ms", name, *(f"{value:.2f}" for value in figures))
    return shown


def similarity_table(found: dict[float, Measured]) -> Table:
    shown = Table("one way", "frame old", *BELIEFS, "not seen", "instants", box=None)
    for one_way_ms, measured in found.items():
        cells = [f"{np.mean(measured.similar[name]):.3f}" for name in BELIEFS]
        shown.add_row(f"{one_way_ms:g} ms", f"{one_way_ms + FRAME_MS:g} ms", *cells,
                      f"{np.mean(measured.unseen):.1%}", str(len(measured.similar["as received"]))
                      )  # fmt: skip
    return shown


def _quantiles(values: Sequence[float]) -> NDArray[np.float64]:
    return np.asarray(np.percentile(values, (50, 95)))


PREDICT = ("off", "eih")
_MOVING_M_S = 0.02
_SESSION_S = 25.0
NETWORKS = {
    **{
        f"{one_way_ms:g} ms": Network(latency_ms=one_way_ms, rate_kbps=12_000.0)
        for one_way_ms in ONE_WAY_MS[:3]
    },
    "s2": None,
}


def run_sessions(seeds: int, processes: int, console: Console) -> dict[str, dict[str, list[float]]]:
    """By network and measure, its value in each trial."""
    configs = {}
    for (name, network), predict in product(NETWORKS.items(), PREDICT):
        word = name if network is None else "case"
        given = {} if network is None else {"networks.case": network.model_dump()}
        for seed in range(1, seeds + 1):
            configs[f"{name.split()[0]}-{predict}-{seed}"] = load_config(
                None,
                {
                    **given,
                    "network": word,
                    "seed": seed,
                    "view.predict": predict,
                    "seconds": _SESSION_S,
                    "recording.bitstream": False,
                },
            )
    found: dict[str, dict[str, list[float]]] = {}
    with (
        tempfile.TemporaryDirectory() as folder,
        TrialsProgress(console, len(configs)) as bar,
    ):
        run_side_by_side(configs, Path(folder), processes, bar.trial_ended)
        for name, predict, seed in product(NETWORKS, PREDICT, range(1, seeds + 1)):
            trial = Path(folder) / f"{name.split()[0]}-{predict}-{seed}"
            row = found.setdefault(name, {})
            row.setdefault(f"moving, {predict}", []).append(_moving_live(trial))
            primary = read_summary(trial)["primary_view"]
            row.setdefault(f"primary, {predict}", []).append(primary["live_ssim"])
            row.setdefault(f"primary received, {predict}", []).append(primary["received_ssim"])
    return found


def _moving_live(folder: Path) -> float:
    """Mean live SSIM of the wrist view's frames captured while the arm moves."""
    log = read_log(folder / LOG_NAME)
    times_ns = np.array([tick.started_ns for tick in log.ticks])
    moves = np.array([tick.speed > _MOVING_M_S for tick in log.ticks])
    scores = [
        one.live
        for one in log.quality
        if one.view == VIEW
        and one.live is not None
        and moves[min(np.searchsorted(times_ns, one.capture_ns), len(moves) - 1)]
    ]
    return float(np.mean(scores))


def sessions_table(found: dict[str, dict[str, list[float]]]) -> Table:
    shown = Table("network", "live SSIM", "off", "predicted", "difference, each trial", box=None)
    for name, row in found.items():
        for measure, of in (("moving", "eih, arm moving"), ("primary", "primary view")):
            before, after = row[f"{measure}, off"], row[f"{measure}, eih"]
            gains = " ".join(f"{b - a:+.3f}" for a, b in zip(before, after, strict=True))
            shown.add_row(name, of, f"{np.mean(before):.3f}", f"{np.mean(after):.3f}", gains)
    return shown


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", action="store_true", help="whole trials, off and on")
    parser.add_argument("--processes", type=int, default=2, help="of --sessions")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--picture", type=Path, help="of the last seed, at 100 ms one way")
    parser.add_argument("--animation", type=Path, help="of the last seed, at 200 ms one way")
    options = parser.parse_args()
    config = load_config(overrides={"rig.enabled": True})
    console = Console()
    console.width = max(console.width, 130)
    if options.sessions:
        rows = run_sessions(options.seeds, options.processes, console)
        console.print(sessions_table(rows))
        if options.json:
            options.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
        return
    beliefs = BELIEFS[1:]
    found = {
        one_way_ms: Measured(
            {name: [] for name in beliefs},
            {name: [] for name in beliefs},
            {name: [] for name in BELIEFS},
            [],
        )
        for one_way_ms in ONE_WAY_MS
    }
    for seed in track(range(1, options.seeds + 1), "trials", console=console, transient=True):
        trial = Recorded(config, seed)
        for _seconds in trial.perform():
            pass
        measure(config, trial, seed, found)
    console.print(errors_table(found))
    console.print(similarity_table(found))
    if options.picture or options.animation:
        artist = Artist(config, trial, seed)
        if options.picture:
            most = max(instants(config, trial, 100.0), key=artist.moved_m)
            cv2.imwrite(str(options.picture), artist.draw(most))
        if options.animation:
            each = list(instants(config, trial, 200.0, each_ticks=12))
            animate(artist, each[:_ANIMATED], options.animation, 200.0)
        artist.close()
    if options.json:
        told = {
            f"{one_way_ms:g}": {
                "similarity": {name: float(np.mean(one.similar[name])) for name in BELIEFS},
                "away_mm": {name: list(_quantiles(one.away_mm[name])) for name in beliefs},
                "turned_deg": {name: list(_quantiles(one.turned_deg[name])) for name in beliefs},
                "unseen": float(np.mean(one.unseen)),
                "instants": len(one.unseen),
            }
            for one_way_ms, one in found.items()
        }
        options.json.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
