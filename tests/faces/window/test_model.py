"""What the window says, before anything is drawn: banner, numbers, places, keys, last minute."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
from msgspec.structs import replace

from hw.make_controller import DEVICES
from tams_app import palette
from tams_app.faces.banner import LOOKS, banner_of, look_of
from tams_app.faces.canvas import apart
from tams_app.faces.commands import PHASE_KEYS, Command
from tams_app.faces.episodes import BUTTONS, KEYS, keys_text, last_text, strip_texts
from tams_app.faces.messages import (
    SPAN_S,
    Ended,
    FaceFacts,
    Notice,
    Opening,
    Outline,
    ReplayFacts,
    Stretch,
    TrialFacts,
)
from tams_app.faces.session_face import facts_of
from tams_app.faces.shown import (
    NOTABLE_MS,
    hand_rows,
    marking_texts,
    replay_texts,
    shown_of,
    slowest_text,
    trial_texts,
    uplink_texts,
    view_row,
    view_title,
)
from tams_app.faces.terminal.keys import REPEAT_NS
from tams_app.faces.views import STAYS_NS, Places
from tams_app.faces.window.keyboard import Keyboard, Symbol, command_of, key_help, key_name
from tams_app.faces.window.strips import History, stretches
from tams_app.faces.window.style import state_class, style_sheet
from tams_app.records import EpisodesState, EpisodeState, LatencyState, SessionState, ViewState
from tams_app.teleop.hands import HANDS, SIMULATED
from tams_app.teleop.safety import ArmingState
from tests.faces.played_session import STATE
from tests.faces.window.facts import FACTS, OPENING, changed
from tests.prediction.wrist import camera_of

pytestmark = pytest.mark.untimed


# --- banner ---------------------------------------------------------------------------------------


STATES = ("disarmed", "ready", "engaged", "holding", "fault")
REPLAYED = Outline(9.0, (), ())


def listed(hand: str = "openvr", **opening: Any) -> dict[str, str]:
    """The keys, and what they do, where the window is opened so."""
    return dict(key_help(replace(OPENING, hand=hand, **opening)))


@pytest.mark.parametrize("arming", STATES)
@pytest.mark.parametrize("hand", sorted(set(HANDS) - {SIMULATED}))
def test_the_banner_calls_the_deadman_what_it_is_in_that_hand(arming: str, hand: str) -> None:
    state = replace(
        STATE, arming=arming, reason="arm reply late", lasting="arm reply late", hand=hand
    )
    told = banner_of(facts_of(state, ()), hand=hand)
    words = f"{told.sentence} {told.key}".lower()
    assert HANDS[hand].deadman.lower() in words
    others = {one.deadman.lower() for one in HANDS.values()} - {HANDS[hand].deadman.lower()}
    assert not any(other in words for other in others)


@pytest.mark.parametrize("arming", STATES)
@pytest.mark.parametrize("stops", ["before the first stop", "after one"])
def test_who_watches_a_simulated_operator_is_not_told_to_drive(arming: str, stops: str) -> None:
    is_stopped = arming in ("holding", "fault")
    reason = "" if stops == "before the first stop" and not is_stopped else "emergency stop"
    shown = changed(FACTS, arming=arming, reason=reason if is_stopped else "", last_stop=reason)
    banner = banner_of(shown, hand=SIMULATED)
    assert "your hand" not in banner.sentence
    if arming == "fault" or (arming == "disarmed" and reason):  # confirmed by a person only
        assert banner.key.startswith("Enter")
    else:
        assert "simulated operator" in f"{banner.sentence} {banner.key}"
        assert not banner.key.startswith(("Release", "Press"))


def test_every_hand_has_its_words_and_every_state_of_the_arming_table_a_look() -> None:
    assert set(HANDS) == {*DEVICES, SIMULATED, "gamepad"}  # which a browser reads
    assert {state.value for state in ArmingState} <= set(LOOKS)


@pytest.mark.parametrize("aspect", ["word", "sign", "border", "colour"])
def test_no_two_states_share_word_sign_border_or_colour(aspect: str) -> None:
    looks = [*LOOKS.values(), look_of("anything else")]
    values = [dataclasses.asdict(look)[aspect] for look in looks]
    assert len(set(values)) == len(values)


@pytest.mark.parametrize("arming", [*LOOKS, "starting"])
def test_what_is_written_on_a_banner_can_be_read(arming: str) -> None:
    look = look_of(arming)
    assert contrast(look.colour, look.ink) >= 3.0  # WCAG 2.1 for large text


def test_a_fault_or_hold_names_its_reason_what_to_do_and_the_key_that_helps() -> None:
    facts = changed(
        FACTS, arming="fault", reason="arm silent", advice="Check its power, then confirm."
    )
    banner = banner_of(facts)
    assert banner.look.word == "FAULT"
    assert banner.sentence == "Arm silent. Check its power, then confirm."
    assert banner.key.startswith("Enter")
    held = banner_of(changed(FACTS, arming="holding", reason="stale video"))
    assert held.sentence == "Stale video."
    assert held.key.startswith("Release the trigger")


@pytest.mark.parametrize("arming", ["ready", "engaged", "disarmed"])
def test_once_the_cause_is_gone_the_last_stop_can_still_be_read(arming: str) -> None:
    banner = banner_of(changed(FACTS, arming=arming, last_stop="stale video"))
    assert banner.look.word == arming.upper()
    assert "Last stop: stale video." in banner.sentence
    assert "trigger" in banner.key
    assert "Last stop" not in banner_of(changed(FACTS, arming=arming)).sentence


@pytest.mark.parametrize("arming", ["ready", "disarmed"])
def test_what_is_in_the_way_is_told_and_not_called_a_stop(arming: str) -> None:
    state = replace(STATE, arming=arming, reason="pose frozen", lasting="pose frozen", last_stop="")
    banner = banner_of(facts_of(state, ()))
    assert "Pose frozen. The hand's pose does not change: check SteamVR" in banner.sentence
    assert "Last stop" not in banner.sentence


def test_a_deadman_that_is_up_need_not_be_released_to_arm() -> None:
    held = banner_of(changed(FACTS, arming="disarmed", deadman=True), "keyboard")
    assert held.key == "Release Shift, then press Enter to arm"
    up = banner_of(changed(FACTS, arming="disarmed", deadman=False), "keyboard")
    assert up.key == "Press Enter to arm"


@pytest.mark.parametrize("arming", LOOKS)
def test_a_replay_is_told_apart_from_a_session_in_every_state(arming: str) -> None:
    facts = changed(FACTS, arming=arming, reason="stale video")
    banner = banner_of(replace(facts, replay=ReplayFacts(1.0, False)))
    assert banner.look.word == f"REPLAY: {LOOKS[arming].word}"
    assert banner.key == "Nothing moves · F1: keys"
    assert "follows" not in banner.sentence
    assert "release" not in banner.sentence.lower()
    assert "emergency" not in str(listed(replay=REPLAYED))


def test_who_marks_phases_finds_each_key_in_the_list_and_beside_the_views() -> None:
    keys, beside = listed(replay=REPLAYED, blind=True), " ".join(marking_texts("ALIGN"))
    for key, phase in PHASE_KEYS.items():
        assert keys[key] == f"{phase or 'no phase'} from here on"
        assert f"{key} {phase or 'no phase'}" in beside
    assert "Backspace" in keys
    assert "1" not in listed(replay=REPLAYED)


def test_the_key_for_frames_as_received_is_listed_where_any_are_predicted() -> None:
    assert "F2" in listed("keyboard", cameras={"eih": camera_of(64, 48)})
    assert "F2" not in listed("keyboard")


def test_keys_of_episodes_are_listed_where_there_are_any_and_buttons_that_can_be_held() -> None:
    keys = {key for key, _ in KEYS}
    for hand in ("openvr", "keyboard"):
        with_episodes = listed(hand, has_episodes=True)
        assert keys <= set(with_episodes)
        assert (BUTTONS[0] in with_episodes) is (hand == "openvr")
        assert keys.isdisjoint(listed(hand))


@pytest.mark.parametrize(
    ("state", "told"),
    [
        (EpisodesState(1, "idle"), "E begin"),
        (EpisodesState(2, "idle", last=(EpisodeState(1, 3.0, False),)), "E begin"),
        (
            EpisodesState(2, "idle", last=(EpisodeState(1, 3.0),)),
            "E begin · Y / N label · Z discard · U redo",
        ),
        (EpisodesState(1, "countdown", 2.0), "Z calls it off"),
        (
            EpisodesState(1, "recording", 2.0),
            "E keep · Y success · N failure · Z discard · U redo",
        ),
    ],
)
def test_each_state_of_an_episode_names_the_keys_that_mean_something(
    state: EpisodesState, told: str
) -> None:
    assert keys_text(state) == told


def test_the_last_episodes_are_told_by_sign_word_and_length_and_the_newest_is_never_cut_off() -> (
    None
):
    last = (
        EpisodeState(1, 9.4),
        EpisodeState(2, 8.0, True, True),
        EpisodeState(3, 7.0, True, False),
        EpisodeState(4, 6.0, False, True),
    )
    assert last_text(EpisodesState(5, "idle", last=last)) == (
        "– 4 discarded 6 s   ✖ 3 failure 7 s   ✔ 2 success 8 s   ● 1 kept 9 s"
    )


def test_a_session_that_is_over_has_its_episodes_but_no_next_one_and_no_keys() -> None:
    state = EpisodesState(2, "recording", 3.0, "discard", 1, 0, (EpisodeState(1, 9.0),))
    texts = strip_texts(state, is_replay=False, is_over=False)
    assert [bool(text) for text in texts] == [True, True, False, True, True]
    quiet = replace(state, armed="")
    now, _, keys, *_ = strip_texts(quiet, is_replay=False, is_over=False)
    assert (now, keys) == ("episode 2: RECORDING 3 s", keys_text(quiet))
    assert strip_texts(quiet, is_replay=True, is_over=False)[:3] == (now, "", "")
    assert strip_texts(state, is_replay=False, is_over=True) == (
        *("", "", ""),
        "● 1 kept 9 s",
        "1 kept, 0 discarded",
    )


def test_names_beside_curves_that_are_close_stand_in_the_order_of_their_curves() -> None:
    assert apart([90.0, 60.0, 30.0], 13.0) == [90.0, 60.0, 30.0]
    assert apart([90.0, 88.0, 76.0, 10.0], 13.0) == [90.0, 77.0, 64.0, 10.0]


def test_the_button_says_what_a_click_does() -> None:
    def button(replay: ReplayFacts | None) -> str:
        return banner_of(changed(FACTS, replay=replay)).button

    assert button(None) == "STOP"
    assert button(ReplayFacts(1.0, paused=False)) == "PAUSE"
    assert button(ReplayFacts(1.0, paused=True)) == "PLAY"


def test_every_state_has_its_rule_in_the_style_sheet() -> None:
    sheet = style_sheet(1.0)
    for arming in (*LOOKS, "starting"):
        look = look_of(arming)
        rule = f".{state_class(arming)} .edge {{ border-style: {look.border}; "
        assert rule + f"border-color: {look.colour}; }}" in sheet


def contrast(one: str, other: str) -> float:
    """Of two colours, by WCAG 2.1."""

    def luminance(colour: str) -> float:
        shares = [
            share / 12.92 if share <= 0.03928 else ((share + 0.055) / 1.055) ** 2.4
            for share in palette.rgb(colour)
        ]
        return 0.2126 * shares[0] + 0.7152 * shares[1] + 0.0722 * shares[2]

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_the_first_six_views_have_colours_of_their_own_that_are_seen_on_the_window_s_ground() -> (
    None
):
    assert len({palette.view_colour(place) for place in range(6)}) == 6
    assert palette.view_colour(6) == palette.view_colour(0)
    for one in palette.VIEW_COLOURS:
        assert contrast(one, "#1B2127") >= 3.0  # WCAG 2.1 for graphics


def test_the_colours_of_the_uplink_are_greys_seen_on_white_and_on_the_window_s_ground() -> None:
    greys = (
        *(palette.UPLINK_SENT, palette.UPLINK_BUDGET),
        *(palette.CAPACITY_ESTIMATE, palette.EMULATED_CAPACITY),
    )
    for grey in greys:
        assert max(palette.rgb(grey)) - min(palette.rgb(grey)) < 0.1
        assert min(contrast(grey, "#FFFFFF"), contrast(grey, "#1B2127")) >= 3.0


# --- numbers --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("view", "asked_fps", "row"),
    [
        (ViewState(3000, 2950.4, 14.9, 74.2, 95.0), 30, "2950 / 3000|15 / 30|74 ms|95 ms|"),
        (
            ViewState(live_ssim=0.874, task_live_ssim=0.702),
            30,
            "– / –|– / 30|– ms|– ms|0.87 / 0.70",
        ),
        (ViewState(live_ssim=0.874), None, "– / –|– / –|– ms|– ms|0.87 / –"),
        (ViewState(), None, "– / –|– / –|– ms|– ms|"),  # what is not known is a dash
    ],
)
def test_a_row_tells_sent_and_target_given_and_asked_latency_age_and_similarity(
    view: ViewState, asked_fps: float | None, row: str
) -> None:
    assert view_row("eih", view, asked_fps) == ("EIH", *row.split("|"))


def test_what_shares_the_budget_is_apart_from_what_the_uplink_carries_beside_it() -> None:
    """Padding fills the uplink up to the budget and beyond: that is not the views' doing."""
    views = {name: ViewState(sent_kbps=1000.0) for name in ("eih", "gt", "gs")}
    padded = changed(FACTS, views=views, budget_kbps=3100.0, link_kbps=3300.0).state
    assert uplink_texts(padded) == (
        "views 3000 of budget 3100 kbit/s; with padding, RTCP 3300",
        "capacity 6100, estimated 6000; queue 12 ms, loss 0.3 %",
    )
    nothing = {name: ViewState() for name in views}
    assert uplink_texts(replace(padded, views=nothing))[0].startswith("views – of")


def seen(own: LatencyState | None, **changes: Any) -> SessionState:
    """The primary view is shown, and its own latency known or not."""
    views = {"eih": replace(FACTS.state.views["eih"], shown_fps=29.0, own=own, **changes)}
    return changed(FACTS, views=views, primary_view="eih").state


def test_what_makes_the_primary_view_late_is_named_once_it_is_notable_and_known() -> None:
    told = "EIH 31 ms besides the network (display 9): use fewer frames or a GPU"
    assert slowest_text(seen(LatencyState(31, "display", 9))) == told
    assert slowest_text(seen(LatencyState(NOTABLE_MS - 1, "encoder", 9))) == ""
    assert slowest_text(seen(None)) == ""
    assert slowest_text(changed(FACTS, views={}).state) == ""
    there = seen(LatencyState(31, "camera", 20))  # the robot's side says how far it knows the way
    there = replace(there, views={"eih": replace(there.views["eih"], shown_fps=None)})
    assert slowest_text(there) == (
        "EIH 31 ms besides the network to the uplink (camera 20): use less exposure or fewer frames"
    )


def test_the_last_line_has_time_strategy_network_and_what_is_recorded() -> None:
    opening = replace(OPENING, strategy="tams", network="config/traces/outage.csv")
    facts = changed(FACTS, t_s=90.0, recorded_mb=30.0)
    assert shown_of(facts, opening).status == (
        "1:30 elapsed · strategy tams, network outage.csv · recording: 30 MB, 20 MB a minute"
    )
    over = replace(facts, end=Ended("Over"))
    assert shown_of(over, opening).status == "strategy tams, network outage.csv"
    blind = replace(OPENING, blind=True)  # `FaceClient` leaves out what is compared
    assert shown_of(replace(facts, recorded_mb=None), blind).status == "1:30 elapsed · recording"


def test_the_newest_sentence_is_shown_until_the_session_is_over() -> None:
    assert shown_of(FACTS, OPENING).notice == ""
    running = replace(FACTS, notices=(Notice(1.0, "ready"), Notice(2.0, "engaged")))
    assert shown_of(running, OPENING).notice == "engaged"
    assert shown_of(replace(running, end=Ended("Over")), OPENING).notice == ""


def title(name: str, here: bool | None = None, opening: Opening = OPENING, **changes: Any) -> str:
    return view_title(name, changed(FACTS, **changes).state, opening, here)


def test_a_view_s_title_in_the_window_says_what_its_letters_mean() -> None:
    assert title("eih", False) == "EIH, eye-in-hand · primary"
    assert title("gt", True) == "GT, global top · pinned"
    assert title("gs", False) == "GS, global side"
    left = {"left": FACTS.state.views["eih"]}
    assert title("left", False, views=left) == "LEFT"
    for here in (True, False):  # or by a key of another window
        assert title("eih", here, is_pinned=True) == "EIH, eye-in-hand · pinned by the operator"
    assert title("gs", is_pinned=True) == "GS"
    assert title("eih") == "EIH · primary"  # no room in the headset


def test_a_picture_that_is_old_or_not_there_says_so_and_in_a_trial_tells_its_name_alone() -> None:
    old = {"eih": ViewState(age_ms=1240.0)}
    assert title("eih", True, primary_view="gt", views=old) == "EIH · pinned · OLD: 1.2 s"
    assert title("eih", primary_view="", views=old) == "EIH · OLD: 1.2 s"
    assert title("eih", opening=replace(OPENING, old_ms=1500.0), views=old) == "EIH · primary"
    assert title("gt", views=old) == view_title("gt", None, OPENING) == "GT · no frame yet"
    assert title("gt", opening=replace(OPENING, blind=True), views={"gt": ViewState()}) == "GT"


def test_the_notice_that_the_block_is_placed_names_the_key_where_it_ends_the_session() -> None:
    placed = changed(FACTS, placed=True)
    assert "Q ends the session" in shown_of(placed, OPENING).placed
    assert shown_of(FACTS, OPENING).placed == ""
    for changes in ({"blind": True}, {"replay": REPLAYED}, {"has_episodes": True}):
        assert shown_of(placed, replace(OPENING, **changes)).placed == "✔ The block is placed"


def test_of_a_session_that_is_over_the_banner_has_the_result_and_no_stop() -> None:
    banner = banner_of(changed(FACTS, end=Ended("Completed in 34.5 s", (), "Q: close")))
    assert (banner.look.word, banner.button) == ("ENDED", "CLOSE")
    assert (banner.sentence, banner.key) == ("Completed in 34.5 s", "Q: close")
    assert banner.look.sign not in {look.sign for look in LOOKS.values()}


def test_the_key_list_says_which_of_r_and_f_turns_which_way() -> None:
    """Which they do: tests/hw/desk/test_keyboard.py, test_virtual_hand.py."""
    assert "seen from above, R anticlockwise, F clockwise" in str(listed("keyboard"))


def test_the_hand_s_rows_have_words_for_what_is_held() -> None:
    names = ("deadman", "mode", "gripper", "buttons", "TCP", "motors")
    words = ("HELD", "translation", "closed", "A", "350, -80, 180 mm", "not known")
    assert hand_rows(FACTS.state) == tuple(zip(names, words, strict=True))
    nothing = {"gripper_closed": None, "pressed": (), "tcp_mm": None, "hottest_motor_c": 41}
    other = changed(FACTS, deadman=False, orientation_mode=True, **nothing)
    words = ("released", "orientation", "not known", "none", "not known", "to 41 °C")
    assert hand_rows(other.state) == tuple(zip(names, words, strict=True))


def test_a_trial_s_card_counts_its_time() -> None:
    trial = TrialFacts("P07", "trial 3 of 9", None, 120.0)
    assert trial_texts(trial)[2] == "Not begun: it begins when the arm first follows. 2:00 allowed"
    assert trial_texts(replace(trial, passed_s=71.9))[2] == "1:11 of 2:00"
    over = trial_texts(replace(trial, passed_s=120.0, drops=2))
    assert over[2] == "The time is over (2:00): Q ends the trial"
    assert over[3].startswith("Drops: 2 ")


def test_a_replay_tells_where_it_is_in_how_long_a_log_and_how_it_goes() -> None:
    assert replay_texts(12.46, 127.99, ReplayFacts(2.0, False)) == ("0:12.4 / 2:07.9", "×2")
    assert replay_texts(0.0, 59.97, ReplayFacts(0.25, True)) == ("0:00.0 / 0:59.9", "×0.25, paused")
    assert replay_texts(9.0, 9.0, ReplayFacts(1.0, True)) == ("0:09.0 / 0:09.0", "×1, at the end")


# --- places ---------------------------------------------------------------------------------------


def test_the_primary_view_and_the_large_one_exchange_but_not_twice_within_a_moment() -> None:
    places = Places(("eih", "gt", "gs"))
    assert not places.step("", 0), "no primary view is known"
    assert places.step("gs", 0)
    assert places.views == ("gs", "gt", "eih")
    assert not places.step("eih", STAYS_NS - 1)
    assert places.views == ("gs", "gt", "eih")
    assert places.step("eih", STAYS_NS)
    assert places.views == ("eih", "gt", "gs")


def test_a_pinned_view_stays_large_until_it_is_let_go() -> None:
    places = Places(("eih", "gt", "gs"))
    places.pin("gs")
    assert not places.step("eih", 10 * STAYS_NS)
    assert places.views == ("gs", "gt", "eih")
    places.pin("gs")
    assert places.pinned == ""
    assert places.step("eih", 10 * STAYS_NS)
    for large, other in (("gt", "eih"), ("eih", "gt")):  # a swap takes the one beside it
        places.swap()
        assert (places.views, places.pinned) == ((large, other, "gs"), large)


# --- keys -----------------------------------------------------------------------------------------


RETURN, W, A, LEFT_SHIFT, RIGHT_SHIFT = 36, 25, 38, 50, 62  # key codes


def focused() -> Keyboard:
    """A keyboard whose window has had the focus for long."""
    keyboard = Keyboard()
    keyboard.focus(True, 0)
    return keyboard


LATER = 10 * REPEAT_NS


def test_a_key_counts_once_until_its_release_under_the_name_that_it_had_when_pressed() -> None:
    keyboard = focused()
    presses = [keyboard.press(RETURN, "Return", LATER + n * REPEAT_NS) for n in range(50)]
    assert presses == [True] + [False] * 49
    assert keyboard.held == ("Return",)
    assert not keyboard.press(RETURN, "other", LATER + 51 * REPEAT_NS)
    assert keyboard.held == ("Return",)
    keyboard.release(RETURN)
    assert keyboard.held == ()
    assert keyboard.press(RETURN, "Return", LATER + 1)  # anew, at once
    assert keyboard.presses == {"Return": 2}


def test_a_key_that_was_down_before_the_focus_came_is_no_press() -> None:
    keyboard = Keyboard()
    keyboard.focus(True, LATER)
    times = [LATER + n * REPEAT_NS // 20 for n in range(1, 100)]
    assert not any(keyboard.press(RETURN, "Return", now_ns) for now_ns in times)
    assert keyboard.held == ()
    keyboard.release(RETURN)
    assert keyboard.press(RETURN, "Return", times[-1] + 1)


def test_keys_are_held_in_the_order_of_pressing_and_none_without_the_focus() -> None:
    keyboard = focused()
    keyboard.press(W, "w", LATER)
    keyboard.press(A, "a", LATER)
    assert keyboard.held == ("w", "a")
    keyboard.focus(False, LATER + 1)
    assert keyboard.held == ()
    assert not keyboard.focused
    assert not keyboard.press(A, "a", 3 * LATER)


def with_shift(*codes: int) -> Keyboard:
    """Shift keys that are held, as the seat's modifiers say too."""
    keyboard = focused()
    for code in codes:
        keyboard.press(code, "Shift_L" if code == LEFT_SHIFT else "Shift_R", LATER)
    assert keyboard.held == ()  # the modifiers follow the key
    keyboard.modifiers(True, LATER)
    return keyboard


def test_shift_is_held_only_while_the_seats_modifiers_have_it() -> None:
    keyboard = with_shift(LEFT_SHIFT)
    keyboard.press(W, "w", LATER)
    assert keyboard.held == ("Shift_L", "w")
    keyboard.modifiers(False, LATER + 1)
    assert keyboard.held == ("w",)
    keyboard.modifiers(True, LATER + 2)  # by a latch, say: no key was pressed
    assert keyboard.held == ("w",)
    assert keyboard.shift_is_dead
    assert not keyboard.press(LEFT_SHIFT, "Shift_L", LATER + 3)  # a repeat
    keyboard.release(LEFT_SHIFT)
    assert keyboard.press(LEFT_SHIFT, "Shift_L", LATER + 4)
    assert keyboard.held == ("w", "Shift_L")
    assert not keyboard.shift_is_dead


def test_of_two_shifts_the_one_that_is_left_is_held() -> None:
    keyboard = with_shift(LEFT_SHIFT, RIGHT_SHIFT)
    keyboard.release(LEFT_SHIFT)
    assert keyboard.held == ("Shift_R",)
    keyboard.modifiers(False, LATER + 1)
    assert keyboard.held == ()


def test_a_shift_that_was_pressed_too_soon_after_the_focus_is_dead_until_it_is_pressed_again() -> (
    None
):
    keyboard = Keyboard()
    keyboard.focus(True, LATER)
    assert not keyboard.shift_is_dead
    keyboard.press(LEFT_SHIFT, "Shift_L", LATER + REPEAT_NS // 2)
    keyboard.modifiers(True, LATER + REPEAT_NS // 2)
    assert keyboard.shift_is_dead
    keyboard.release(LEFT_SHIFT)
    keyboard.modifiers(False, LATER + REPEAT_NS)
    assert not keyboard.shift_is_dead


@pytest.mark.parametrize("hand", sorted(HANDS))
@pytest.mark.parametrize("arming", STATES)
def test_the_banner_says_what_to_do_about_a_shift_that_is_dead(hand: str, arming: str) -> None:
    facts = changed(FACTS, arming=arming)
    says = "let go and press again" in banner_of(facts, hand, shift_is_dead=True).key
    assert says == (hand == "keyboard" and arming == "ready")


@pytest.mark.parametrize("hand", sorted(set(HANDS) - {SIMULATED}))
def test_who_pressed_the_deadman_while_something_was_in_the_way_is_told_to_press_it_again(
    hand: str,
) -> None:
    words = HANDS[hand]
    held = banner_of(changed(FACTS, arming="ready", deadman=True), hand).key
    assert held == words.fill("{release}, then press and hold {deadman} again")
    released = banner_of(changed(FACTS, arming="ready", deadman=False), hand).key
    assert released.startswith(words.fill("Press and hold {deadman} to move it"))
    engaged = banner_of(changed(FACTS, arming="engaged", deadman=True), hand).key
    assert "again" not in engaged


US_W = (Symbol(0, 0, "w", ord("w")), Symbol(0, 1, "W", ord("W")))
RU_W = (Symbol(1, 0, "Cyrillic_tse", ord("ц")), Symbol(1, 1, "Cyrillic_TSE", ord("Ц")))
SHIFTS_TOGGLE = (Symbol(0, 0, "Shift_L", 0), Symbol(0, 1, "ISO_Prev_Group", 0))


@pytest.mark.parametrize(
    ("code", "layout", "symbols", "name"),
    [
        (W, 0, (*US_W, *RU_W), "w"),
        (W, 1, (*US_W, *RU_W), "w"),  # that layout has no Latin letter there
        (W, 0, [Symbol(0, 0, "Cyrillic_tse", ord("ц"))], "w"),  # nor has any other: as on a US one
        (W, 0, [Symbol(0, 0, "z", ord("z"))], "z"),  # French: what is printed on the key counts
        (W, 1, [*US_W, Symbol(1, 0, "z", ord("z"))], "z"),
        (W, 0, [Symbol(0, 2, "lstroke", ord("ł")), *US_W], "w"),  # AltGr
        (LEFT_SHIFT, 1, SHIFTS_TOGGLE, "Shift_L"),
        (66, 0, [Symbol(0, 0, "Escape", 27)], "Escape"),  # caps:escape
        (48, 0, [Symbol(0, 0, "Cyrillic_e", ord("э"))], "Cyrillic_e"),
        (12, 0, [Symbol(0, 0, "quotedbl", 34), Symbol(0, 1, "3", ord("3"))], "3"),  # French
        (12, 0, [Symbol(0, 0, "3", ord("3")), Symbol(0, 1, "numbersign", 35)], "3"),
        (89, 0, [Symbol(0, 0, "KP_Page_Down", 0), Symbol(0, 1, "KP_3", ord("3"))], "3"),
        (200, 0, (), ""),
    ],
)
def test_a_key_has_one_latin_name_whatever_modifiers_and_layout_are_active(
    code: int, layout: int, symbols: list[Symbol], name: str
) -> None:
    assert key_name(code, layout, symbols) == name


def test_an_emergency_stop_counts_even_where_it_may_be_a_repeat() -> None:
    assert command_of("space", is_new=False) is Command.EMERGENCY_STOP
    assert command_of("Escape", is_new=False) is Command.EMERGENCY_STOP
    assert command_of("Return", is_new=False) is None
    assert command_of("Return", is_new=True) is Command.CONFIRM
    assert command_of("q", is_new=False) is None
    assert command_of("q", is_new=True) is Command.QUIT
    assert command_of("j", is_new=True) is None


def test_in_a_replay_the_keys_that_stop_an_arm_pause_or_go_on_once_for_each_press() -> None:
    for name in ("space", "Escape", "Return"):
        assert command_of(name, is_new=True, replay=True) is Command.CONFIRM
        assert command_of(name, is_new=False, replay=True) is None


# --- the last minute ------------------------------------------------------------------------------


def at(t_s: float, phase: str = "REACH", arming: str = "ready") -> FaceFacts:
    return changed(FACTS, t_s=t_s, phase=phase, arming=arming)


def test_phases_are_stretches_one_after_the_other_without_a_gap() -> None:
    phases = enumerate(("REACH", "REACH", "ALIGN", "GRASP", "GRASP"))
    assert stretches((float(t_s), phase) for t_s, phase in phases) == [
        Stretch(0, 2, "REACH"),
        Stretch(2, 3, "ALIGN"),
        Stretch(3, 4, "GRASP"),
    ]
    assert stretches((float(t_s), "ready") for t_s in range(5)) == [Stretch(0, 4, "ready")]


def test_what_is_older_than_a_minute_is_forgotten() -> None:
    history = History()
    for t_s in range(200):
        history.add(at(float(t_s)))
    assert history.states[0].t_s == 199 - SPAN_S


def test_one_moment_counts_once_and_an_earlier_one_makes_what_came_later_forgotten() -> None:
    history = History()
    for t_s in (*range(20), 19):
        history.add(at(float(t_s), "GRASP" if len(history.states) == 20 else "REACH"))
    assert [state.phase for state in history.states] == ["REACH"] * 20
    history.add(at(5.0, "ALIGN"))
    assert [state.t_s for state in history.states] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert history.states[-1].phase == "ALIGN"
    history.add(at(-1.0))
    assert [state.t_s for state in history.states] == [-1.0]


def went(history: History, t_s: float, jumps: int, *past: SessionState) -> list[float]:
    """The moments that are kept once a replay is there, after so many jumps."""
    history.add(replace(at(t_s), replay=ReplayFacts(1.0, False, jumps, None, past)))
    return [state.t_s for state in history.states]


def test_where_a_replay_jumps_ahead_what_was_before_is_forgotten() -> None:
    history = History()
    assert went(history, 1.0, 0) == [1.0]
    assert went(history, 2.0, 0) == [1.0, 2.0]
    assert went(history, 20.0, 1) == [20.0]
    assert went(history, 21.0, 1) == [20.0, 21.0]
    assert went(history, 20.5, 2) == [20.0, 20.5]
    assert went(history, 20.6, 2) == [20.0, 20.5, 20.6]


def test_after_a_jump_the_minute_before_is_what_the_log_has() -> None:
    history = History()
    history.add(at(1.0))
    past = [at(float(t_s)).state for t_s in range(20, 31)]
    assert went(history, 30.4, 1, *past) == [*range(20, 31), 30.4]
    assert went(history, 31.0, 1, *past)[-2:] == [30.4, 31.0]
    assert went(history, 24.5, 2, *past) == [*range(20, 25), 24.5]  # a jump back has it, too
