"""The whole conversation, with the simulated person."""

import re
from dataclasses import dataclass, replace
from functools import partial
from itertools import count, islice
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.frame import simulated_person as prompted
from calibration.frame import wizard
from calibration.frame.asking import ATTEMPTS, fit_moves, try_six_directions
from calibration.frame.buttons import ask_buttons
from calibration.frame.fit import BeginAgainError, FrameFit, RefusedError, turn_deg
from calibration.frame.simulated_person import SimulatedSetup
from calibration.frame.sources import SIX_DIRECTIONS
from calibration.frame.wizard import FrameWizard, rows
from calibration.options import FrameOptions
from hw.openvr.components import ROLES
from tams_app.config import load_config
from tams_app.errors import ConfigError, TamsError
from tams_app.records import ControllerStatus
from tams_app.session.virtual.videoless import VideolessTrial
from tams_app.units import NS_PER_S
from tests.calibration.lab import files, in_force, write_lab
from tests.scripted_ui import ScriptedUI

pytestmark = pytest.mark.untimed

TURNED = Rotation.random(random_state=4).as_matrix()
SWAPPED = {"a": "b/click", "b": "a/click"}


def write_rig(folder, rotation=TURNED, wiring=None, **more):
    """A configuration of a rig whose frame and buttons are as given; its path."""
    turned = [list(row) for row in rows(rotation)]
    return write_lab(folder, rig={"hand_rotation": turned, "wiring": wiring or {}}, **more)


@pytest.fixture
def rig(tmp_path):
    return partial(write_rig, tmp_path)


def calibrate(path, ui=None, **options):
    ui = ui or ScriptedUI()
    options = {"sim": True, "yes": True, "buttons": False} | options
    return FrameWizard(ui, FrameOptions(config=path, **options)).run(), ui


@dataclass(frozen=True)
class Calibrated:
    """A rig calibrated once."""

    path: Path
    ui: ScriptedUI
    fit: FrameFit


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    path, fits = write_rig(tmp_path_factory.mktemp("calibrated")), []

    def fit(*arguments):
        fits.append(fit_moves(*arguments))
        return fits[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wizard, "fit_moves", fit)
        code, ui = calibrate(path)
    assert code == 0
    return Calibrated(path, ui, fits[0])


@pytest.fixture
def fitted(calibrated, monkeypatch):
    """The person does not move again: for what comes after the fit."""
    monkeypatch.setattr(wizard, "fit_moves", lambda *_: calibrated.fit)
    monkeypatch.setattr(
        wizard, "try_six_directions", lambda *_: dict.fromkeys(SIX_DIRECTIONS, True)
    )


def test_a_turned_rig_is_found_right_and_its_directions_all_light_up(calibrated):
    assert turn_deg(np.array(load_config(calibrated.path).hand.rotation), TURNED) < 2.0
    assert any("6 of 6 directions lit up as asked for" in text for text in calibrated.ui.said)
    quality = in_force(calibrated.path)[1]["calibration"]["quality"]
    assert turn_deg(calibrated.fit.rotation, TURNED) <= quality["error_bound_95_deg"] <= 2.0
    assert quality["directions_lit"] == "6 of 6"


def test_the_figure_is_drawn_beside_the_file(calibrated):
    figure = in_force(calibrated.path)[0].with_suffix(".png").read_bytes()
    assert figure.startswith(b"\x89PNG")


@pytest.mark.usefixtures("fitted")
def test_swapped_buttons_are_put_right_and_stay_so_when_only_the_frame_is_made_anew(rig):
    path = rig(wiring=SWAPPED)
    code, ui = calibrate(path, buttons=True)
    assert code == 0
    table = next(text for text in ui.said if text.startswith("Buttons of vive_focus3"))
    assert re.search(r"a +b/click +a/click +put right", table)
    assert re.search(r"menu +joystick/click +joystick/click +as it was", table)
    put_right = load_config(path).controller.mapping
    mapping = put_right["vive_focus3_controller"]
    assert (mapping.a, mapping.b) == ("b/click", "a/click")
    assert calibrate(path, buttons=False, seed=1)[0] == 0
    assert len(files(path, "frame")) == 2
    assert load_config(path).controller.mapping == put_right


@pytest.mark.usefixtures("fitted")
def test_a_scale_that_an_earlier_version_measured_is_not_copied_on(rig):
    path = rig()
    assert calibrate(path)[0] == 0
    old = in_force(path)[0]
    old.write_text(old.read_text().replace("rotation:", "translation_scale: 0.5\n    rotation:", 1))
    assert load_config(path).hand.translation_scale == 0.5
    assert calibrate(path)[0] == 0
    assert in_force(path)[1]["config"]["hand"].keys() == {"rotation"}


def test_a_person_who_cannot_move_straight_gets_no_file_but_the_reason(rig, monkeypatch):
    monkeypatch.setattr(prompted, "DIRECTION_ERROR_DEG", 5.0)
    path = rig()
    with pytest.raises(RefusedError, match=r"may be off by \d.*°, and more than 3° is no use"):
        calibrate(path)
    assert files(path, "frame") == []


@pytest.mark.usefixtures("fitted")
def test_a_frame_in_between_is_written_only_if_a_person_says_so(rig, monkeypatch):
    monkeypatch.setattr("calibration.frame.wizard.GOOD_DEG", 0.1)
    path = rig()
    with pytest.raises(TamsError, match=r"more than 0.1°.*measure more, or start it without --yes"):
        calibrate(path)
    for answer, counting in (("n", 0), ("y", 1)):
        ui = ScriptedUI([answer])
        assert calibrate(path, ui, yes=False)[0] == 0
        assert any("Write it all the same?" in text for text in ui.said)
        assert len(load_config(path).calibrated_by) == counting


class Watched:
    """A source of which is noted what was asked for, and whose readings `change` has a say in."""

    def __init__(self, source, change=lambda _asked, _now_ns, reading: reading):
        self._source, self._change, self.asked = source, change, []

    def ask(self, prompt):
        self.asked.append(prompt if isinstance(prompt, str) else prompt.name)
        self._source.ask(prompt)

    def next(self):
        now_ns, reading = self._source.next()
        return now_ns, self._change(self.asked, now_ns, reading)


def test_a_recentred_headset_makes_the_wizard_begin_anew_once(rig):
    config, ui = load_config(rig()), ScriptedUI()

    def recentred(_asked, now_ns, sample):
        if not 0 <= now_ns - 7 * NS_PER_S < NS_PER_S:
            return sample
        status = ControllerStatus.TRACKING_FRAME_CHANGED
        return replace(sample, status=status, pose=None, trigger=0.0)

    with SimulatedSetup(config, 0).hand(config.controller) as hand:
        source = Watched(hand, recentred)
        fit = fit_moves(ui, source, config, rounds=2)
    assert sum("From the beginning" in text for text in ui.said) == 1
    begun = source.asked.index(source.asked[0], 1)
    assert 0 < begun < 6
    assert len(source.asked) == begun + 6  # what came before does not count
    assert turn_deg(fit.rotation, TURNED) < 2.0


def try_directions(path, turned_deg=0.0, presses=0, **change):
    """Which directions lit up with a frame turned so far, what was asked for, and what was said."""
    config, ui = load_config(path), ScriptedUI(presses=presses)
    aside = Rotation.from_euler("z", turned_deg, degrees=True).as_matrix()
    hand = config.hand.model_copy(update={"rotation": rows(aside @ TURNED)})
    with SimulatedSetup(config, 0).hand(config.controller) as source:
        watched = Watched(source, **change)
        lit = try_six_directions(ui, watched, config, hand)
    return {way.name: right for way, right in lit.items()}, watched.asked, ui.said


ALL_SIX = ["+x", "−x", "+y", "−y", "+z", "−z"]


def test_a_frame_that_is_wrong_lights_others_however_often_it_is_tried(rig):
    lit, asked, said = try_directions(rig(), turned_deg=90)
    assert [name for name, right in lit.items() if right] == ["+z", "−z"]
    assert asked.count("+x") == 3
    assert "+y lit up when +x was asked for. Once more." in said


def test_a_controller_lost_in_the_trial_costs_one_try_and_not_the_calibration(rig):
    def lost(asked, _now_ns, sample):
        if len(asked) != 2 or sample.trigger < 0.9:
            return sample
        return replace(sample, status=ControllerStatus.TRACKING_LOST, pose=None)

    lit, asked, said = try_directions(rig(), change=lost)
    assert lit == dict.fromkeys(ALL_SIX, True)
    assert asked.count("−x") == 2
    assert any("lost while the trigger was held" in text for text in said)


def test_a_squeeze_without_motion_is_no_stroke(rig):
    readings = count()

    def squeezed(_asked, _now_ns, sample):
        return replace(sample, trigger=1.0) if 3 <= next(readings) < 9 else sample

    lit, asked, said = try_directions(rig(), change=squeezed)
    assert lit == dict.fromkeys(ALL_SIX, True)
    assert asked == ALL_SIX
    assert not any("Once more" in text for text in said)


def test_enter_skips_a_direction(rig):
    assert try_directions(rig(), presses=1)[0] == dict.fromkeys(ALL_SIX[1:], True)


@pytest.mark.usefixtures("fitted")
def test_a_frame_whose_directions_light_up_wrongly_is_never_written(rig, monkeypatch):
    lit = dict.fromkeys(SIX_DIRECTIONS, True) | {SIX_DIRECTIONS[0]: False}
    monkeypatch.setattr(wizard, "try_six_directions", lambda *_: lit)
    path = rig()
    with pytest.raises(RefusedError, match=r"Another direction lit up for \+x"):
        calibrate(path)
    assert files(path, "frame") == []


@pytest.mark.usefixtures("fitted")
def test_a_headset_recentred_while_the_directions_are_tried_leaves_no_frame(rig, monkeypatch):
    def recentred(*_):
        raise BeginAgainError("The headset was recentred")

    monkeypatch.setattr(wizard, "try_six_directions", recentred)
    path = rig()
    with pytest.raises(BeginAgainError):
        calibrate(path)
    assert files(path, "frame") == []


@pytest.mark.usefixtures("fitted")
def test_ctrl_c_while_the_directions_are_tried_keeps_the_frame_out_of_force(rig, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(wizard, "try_six_directions", interrupted)
    path, ui = rig(), ScriptedUI()
    with pytest.raises(KeyboardInterrupt):
        calibrate(path, ui)
    assert "Kept, but not in force" in ui.said[-1]
    assert len(files(path, "frame")) == 1
    assert load_config(path).calibrated_by == ()


class Clumsy(Watched):
    """The buttons of a person who does something else the first time `a` is asked for."""

    def __init__(self, buttons, instead):
        super().__init__(buttons)
        self._instead = instead

    def ask(self, prompt):
        if prompt != "a" or "a" in self.asked:
            super().ask(prompt)
            return
        self.asked.append("a")
        if self._instead:
            self._source.ask(self._instead)


@pytest.mark.parametrize(
    ("instead", "asked", "words"),
    [
        ("", ["trigger", "grip", "a", "a", "b", "menu"], "Waiting for the a: nothing arrived"),
        ("grip", ["trigger", "grip", "a", *ROLES], "is the grip already.* All the buttons once"),
    ],
)
def test_a_press_that_goes_wrong_is_asked_for_again(rig, instead, asked, words):
    config, ui = load_config(rig()), ScriptedUI()
    with SimulatedSetup(config, 0).buttons() as buttons:
        source = Clumsy(buttons, instead)
        finding = ask_buttons(ui, source, config)
    assert finding.wrong == ()
    assert source.asked == asked
    assert any(re.search(words, text) for text in ui.said)


def test_a_button_that_never_arrives_ends_it_with_what_to_do(rig):
    config = load_config(rig())

    def dead(asked, _now_ns, reading):
        if reading is None or "a" not in asked:
            return reading
        return replace(reading, values=dict.fromkeys(reading.values, 0.0))

    with SimulatedSetup(config, 0).buttons() as buttons:
        source = Watched(buttons, dead)
        with pytest.raises(RefusedError, match=r"nothing arrived.*--no-buttons leaves"):
            ask_buttons(ScriptedUI(), source, config)
    assert source.asked == ["trigger", "grip", *["a"] * ATTEMPTS]


@pytest.fixture
def lab(tmp_path):
    """A configuration with real devices."""
    path = tmp_path / "lab.yaml"
    path.write_text("version: 1\ninclude: [lite6.yaml]\ncalibration: lab\n")
    return path


def test_a_simulated_person_does_not_turn_a_real_arms_frame(lab):
    ui = ScriptedUI()
    with pytest.raises(ConfigError, match="has real devices"):
        calibrate(lab, ui)
    assert ui.said == []  # told at once, not once everything is done
    assert files(lab, "frame") == []


def test_without_a_terminal_no_person_is_waited_for(lab):
    with pytest.raises(ConfigError, match="there is no terminal: start it from one, or give"):
        calibrate(lab, sim=False)


def test_the_same_seed_makes_the_same_frame(rig, calibrated):
    config = load_config(rig())
    with SimulatedSetup(config, 0).hand(config.controller) as hand:
        fit = fit_moves(ScriptedUI(), hand, config, rounds=2)
    assert np.array_equal(fit.rotation, calibrated.fit.rotation)


def test_a_rig_without_sim_is_refused_with_what_to_add(rig):
    with pytest.raises(ConfigError, match="has the simulated rig: add --sim"):
        calibrate(rig(), sim=False)


QUICK_TRIAL = 6  # its seed


@pytest.mark.verify
@pytest.mark.timeout(900)
def test_a_rig_turned_at_random_is_drivable_again_once_calibrated(tmp_path):
    """What the calibration is for: without a known frame a rig cannot be driven."""
    turned = Rotation.random(random_state=0).as_matrix()
    # a quarter of the usual rate, for the time that it takes
    path = write_rig(tmp_path, turned, SWAPPED, control={"rate_hz": 30})
    uncalibrated = load_config(path)
    assert calibrate(path, buttons=True)[0] == 0
    config = load_config(path)
    assert config.calibrated_by[0].startswith("frame-")

    after = VideolessTrial(config, QUICK_TRIAL)
    steps = len(list(after.perform()))
    assert after._trial.outcome("").success

    before = VideolessTrial(uncalibrated, QUICK_TRIAL)
    assert len(list(islice(before.perform(), steps + 1))) > steps  # it goes on
    assert not before._trial.outcome("").success
