"""Episodes by key and by a controller's long press, and what the log keeps of them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tams_app.records import ControllerStatus, Episode, EpisodeRequest
from tams_app.robot.control import Signals
from tams_app.robot.episode_keeper import HOLD_NS, EpisodeKeeper
from tams_app.runtime.clock import VirtualClock
from tams_app.task.episodes import ARMED_NS, Episodes
from tests.session.exchange import MemoryJournal
from tests.synthetic_session import PERIOD_NS, tick

pytestmark = pytest.mark.untimed

HELD_TICKS = HOLD_NS // PERIOD_NS + 2
UP = {"a": False, "b": False, "status": ControllerStatus.OK}


class Kept:
    """A keeper, its log, and the ticks that it receives."""

    def __init__(self, countdown_s: float = 0.0, limit_s: float = 120.0, wanted: int = 0) -> None:
        self.signals, self.log = Signals(), MemoryJournal(VirtualClock())
        self.prepared = 0
        self.ended = 0
        episodes = Episodes(countdown_s, limit_s, wanted)
        self.keeper = EpisodeKeeper(episodes, self.signals, self.log)
        self.number = 0

    def ticks(self, number: int = 1, *, deadman: bool = False, **hand: object) -> None:
        for _ in range(number):
            base = tick(self.number)
            sample = replace(base.controller, **{**UP, **hand})
            due = self.keeper.step(replace(base, controller=sample, deadman=deadman))
            self.prepared += due.scene
            self.ended += due.end
            self.number += 1

    def ask(self, *requests: EpisodeRequest) -> None:
        for request in requests:
            self.signals.episode(request)
            self.ticks()

    def hold(self, **hand: object) -> None:
        """For a second, from up to up."""
        self.ticks()
        self.ticks(HELD_TICKS, **hand)
        self.ticks()

    @property
    def doing(self) -> str:
        return self.keeper.state.doing


def test_a_key_begins_an_episode_and_ends_it_at_the_ticks_after_it() -> None:
    kept = Kept()
    kept.ticks()
    kept.signals.episode(EpisodeRequest.NEXT)
    kept.ticks(5)
    kept.signals.episode(EpisodeRequest.NEXT)
    kept.ticks()
    start_ns, end_ns = tick(1).started_ns, tick(6).started_ns
    assert kept.log.of(Episode) == [Episode(end_ns, 1, start_ns, end_ns)]
    assert kept.log.notes == [
        "episode 1 is recorded",
        "episode 1, 0.0 s: kept",
    ]


def test_an_episode_ends_at_its_time_limit_and_is_kept() -> None:
    kept = Kept(limit_s=0.5)
    kept.ask(EpisodeRequest.NEXT)
    kept.ticks(59)
    assert kept.doing == "recording"
    kept.ticks(2)
    assert kept.doing == "idle"
    (episode,) = kept.log.of(Episode)
    assert episode.kept
    assert (episode.end_ns - episode.start_ns) / 1e9 == pytest.approx(0.5, abs=0.01)
    kept.ticks(20)
    assert kept.doing == "idle"


def test_the_session_ends_once_as_many_are_kept_as_are_wanted_and_the_deadman_is_up() -> None:
    kept, pause = Kept(wanted=2), ARMED_NS // PERIOD_NS + 2
    discard = EpisodeRequest.DISCARD
    kept.ask(*(EpisodeRequest.NEXT,) * 4, discard, discard)  # the second is not kept
    kept.ticks(pause)
    assert not kept.ended
    kept.ask(EpisodeRequest.NEXT, EpisodeRequest.NEXT)
    assert "all episodes are kept: the session ends in 5 s" in kept.log.notes[-1]
    kept.ticks(pause, deadman=True)
    assert not kept.ended
    kept.ticks()
    assert kept.ended == 1


def test_holding_a_begins_and_keeps_an_episode_and_holding_b_twice_discards_it() -> None:
    kept = Kept()
    kept.hold(a=True)
    assert kept.doing == "recording"
    kept.hold(a=True)
    kept.hold(a=True)
    kept.hold(b=True)
    assert kept.doing == "recording"
    kept.hold(b=True)
    assert [(one.number, one.kept) for one in kept.log.of(Episode)] == [(1, True), (2, False)]


def test_a_button_that_stays_down_asks_once() -> None:
    kept = Kept()
    kept.ticks()
    kept.ticks(5 * HELD_TICKS, a=True)
    assert (kept.doing, kept.log.of(Episode)) == ("recording", [])


@pytest.mark.parametrize(
    "hand",
    [
        {"a": True, "deadman": True},
        {"a": True, "b": True},
        {"a": True, "status": ControllerStatus.LINK_LOST},
    ],
)
def test_a_button_held_with_the_deadman_or_the_other_or_no_link_asks_nothing(
    hand: dict[str, object],
) -> None:
    kept = Kept()
    kept.hold(**hand)
    assert kept.doing == "idle"


def test_the_button_that_closed_the_gripper_asks_nothing_when_the_deadman_is_released() -> None:
    kept = Kept()
    kept.ticks(deadman=True)
    kept.ticks(10, a=True, deadman=True)
    kept.ticks(2 * HELD_TICKS, a=True)
    assert kept.doing == "idle"
    kept.hold(a=True)
    assert kept.doing == "recording"


def test_a_button_that_is_down_at_the_start_or_is_held_too_briefly_asks_nothing() -> None:
    kept = Kept()
    kept.ticks(2 * HELD_TICKS, a=True)
    kept.ticks()
    kept.ticks(HELD_TICKS - 4, a=True)
    kept.ticks()
    assert kept.doing == "idle"


def test_nothing_that_is_asked_about_episodes_confirms_or_stops() -> None:
    kept = Kept()
    for request in EpisodeRequest:
        kept.signals.episode(request)
        kept.ticks()
    pending = kept.signals.take(0)
    assert (pending.confirm, pending.estop, pending.faults) == (False, False, ())


def test_an_episode_that_the_end_of_the_session_cuts_off_is_none_and_that_is_said() -> None:
    kept = Kept()
    kept.signals.episode(EpisodeRequest.NEXT)
    kept.ticks(10)
    kept.keeper.finish()
    assert kept.log.of(Episode) == []
    assert kept.log.notes[-1].startswith("episode 1 was running and is not kept")


@pytest.mark.parametrize("countdown_s", [0.0, 60.0])
def test_the_scene_is_prepared_when_an_episode_is_asked_for_and_when_it_is_redone(
    countdown_s: float,
) -> None:
    kept = Kept(countdown_s)
    kept.ticks()
    kept.ask(EpisodeRequest.NEXT)
    assert kept.prepared == 1
    if countdown_s:
        kept.ask(EpisodeRequest.NEXT, EpisodeRequest.REDO)  # it begins already
        kept.ask(EpisodeRequest.DISCARD)
    else:
        kept.ask(EpisodeRequest.REDO)
        assert kept.prepared == 1  # once more, or nothing is lost
        kept.ask(EpisodeRequest.REDO)
        assert kept.prepared == 2
        kept.ask(EpisodeRequest.SUCCESS, EpisodeRequest.FAILURE, *[EpisodeRequest.DISCARD] * 2)
    prepared = kept.prepared
    kept.ticks(10)
    assert kept.prepared == prepared == (1 if countdown_s else 2)
