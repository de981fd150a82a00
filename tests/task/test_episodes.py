"""The rules of episodes under a clock that is stepped, and what holds whatever people ask."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.records import Episode, EpisodeRequest
from tams_app.task.episodes import ARMED_NS, SHOWN, Episodes
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

NEXT, DISCARD, REDO = EpisodeRequest.NEXT, EpisodeRequest.DISCARD, EpisodeRequest.REDO
SUCCESS, FAILURE = EpisodeRequest.SUCCESS, EpisodeRequest.FAILURE


class Played:
    """Episodes with their clock, and what their log keeps."""

    def __init__(self, countdown_s: float = 3.0, limit_s: float = math.inf) -> None:
        self.episodes = Episodes(countdown_s, limit_s)
        self.now_ns = 0
        self.log: list[Episode] = []
        self.sentences: list[str] = []

    def wait(self, seconds: float) -> None:
        self.now_ns += round(seconds * NS_PER_S)
        self.sentences += filter(None, [self.episodes.step(self.now_ns)])

    def ask(self, *requests: EpisodeRequest) -> None:
        for request in requests:
            answer = self.episodes.ask(self.now_ns, request)
            self.sentences.append(answer.sentence)
            self.log += filter(None, [answer.record])

    def record(self, seconds: float) -> None:
        """Until it is recorded for that long."""
        self.ask(NEXT)
        self.wait(3.0)
        self.wait(seconds)

    @property
    def doing(self) -> str:
        return self.episodes.state(self.now_ns).doing


def test_the_time_limit_of_an_episode_is_announced_before_it_comes() -> None:
    played = Played(limit_s=120.0)
    played.record(109.9)
    assert played.sentences[-1] == "episode 1 is recorded"
    played.wait(0.2)
    assert played.sentences[-1] == "episode 1 ends in 10 s, at its time limit, and is kept"
    played.wait(9.8)
    assert not played.episodes.is_overdue(played.now_ns)
    played.wait(0.2)
    assert played.episodes.is_overdue(played.now_ns)


def test_a_press_that_comes_just_after_the_time_limit_meant_the_episode_that_has_ended() -> None:
    """It begins none: of that the operator knew nothing, and it would be kept."""
    played = Played(limit_s=120.0)
    for late_s, doing in ((0.9, "idle"), (1.1, "countdown")):
        played.record(120.0)
        played.ask(NEXT)  # at its limit, as `EpisodeKeeper` does
        played.wait(late_s)
        played.ask(NEXT)
        assert played.doing == doing
    assert "episode 1 has just ended, at its time limit; press again" in " ".join(played.sentences)
    played.ask(DISCARD)
    played.record(120.0)
    played.ask(NEXT, NEXT, NEXT)
    assert played.doing == "countdown", "the second press counts"
    played.ask(DISCARD)
    played.record(60.0)
    played.ask(NEXT, NEXT)
    assert played.doing == "countdown", "that one ended by the operator's own press"


def test_an_episode_begins_when_its_countdown_is_over_and_ends_kept() -> None:
    played = Played()
    played.ask(NEXT)
    state = played.episodes.state(NS_PER_S)
    assert (state.doing, state.number, state.seconds) == ("countdown", 1, 2.0)
    played.wait(3.1)
    assert played.doing == "recording"
    assert played.episodes.state(played.now_ns).seconds == pytest.approx(0.1)
    played.wait(6.9)
    played.ask(NEXT)
    assert played.log == [Episode(10 * NS_PER_S, 1, 3 * NS_PER_S, 10 * NS_PER_S, True, None)]
    assert (played.doing, played.episodes.number) == ("idle", 2)


def test_without_a_countdown_an_episode_begins_at_once() -> None:
    played = Played(countdown_s=0.0)
    played.ask(NEXT)
    assert played.doing == "recording"
    assert played.sentences == ["episode 1 is recorded"]


def test_a_second_press_in_the_countdown_ends_nothing() -> None:
    played = Played()
    played.ask(NEXT, NEXT)
    played.wait(3.0)
    assert (played.doing, played.log) == ("recording", [])


@pytest.mark.parametrize("request_", [DISCARD, REDO])
def test_one_press_discards_nothing(request_: EpisodeRequest) -> None:
    played = Played()
    played.record(5.0)
    played.ask(request_)
    assert played.episodes.state(played.now_ns).armed == request_.value
    assert (played.doing, played.log) == ("recording", [])


@pytest.mark.parametrize(
    ("seconds", "discarded"), [(ARMED_NS / NS_PER_S - 0.01, 1), (ARMED_NS / NS_PER_S, 0)]
)
def test_a_second_press_discards_only_within_its_time(seconds: float, discarded: int) -> None:
    played = Played()
    played.record(5.0)
    played.ask(DISCARD)
    played.wait(seconds)
    played.ask(DISCARD)
    assert played.episodes.state(played.now_ns).discarded == discarded


@pytest.mark.parametrize("between", [NEXT, REDO, SUCCESS])
def test_two_presses_with_another_between_them_discard_nothing(between: EpisodeRequest) -> None:
    played = Played()
    played.record(5.0)
    played.ask(NEXT)
    played.ask(DISCARD, between, DISCARD)
    assert all(one.kept for one in played.episodes.ended)


def test_a_press_for_a_running_episode_is_no_first_one_for_the_kept_one() -> None:
    played = Played()
    played.record(5.0)
    played.ask(DISCARD, NEXT, DISCARD)
    assert [one.kept for one in played.episodes.ended] == [True]


def test_an_episode_that_is_discarded_while_it_runs_ends_there() -> None:
    played = Played()
    played.record(5.0)
    played.ask(DISCARD, DISCARD)
    assert [(one.number, one.kept) for one in played.log] == [(1, False)]
    assert played.doing == "idle"


def test_the_last_kept_episode_can_still_be_discarded() -> None:
    played = Played()
    played.record(5.0)
    played.ask(NEXT)
    played.wait(60.0)
    played.ask(DISCARD, DISCARD)
    first, second = played.log
    assert (first.kept, second.kept) == (True, False)
    assert (first.start_ns, first.end_ns) == (second.start_ns, second.end_ns)


def test_redo_discards_and_begins_the_next() -> None:
    played = Played()
    played.record(5.0)
    played.ask(REDO, REDO)
    assert [one.kept for one in played.log] == [False]
    assert played.doing == "countdown"
    played.wait(3.0)
    assert (played.doing, played.episodes.number) == ("recording", 2)


def test_redo_of_what_is_discarded_already_begins_the_next_at_the_first_press() -> None:
    played = Played()
    played.record(5.0)
    played.ask(DISCARD, DISCARD, REDO)
    assert (played.doing, len(played.log)) == ("countdown", 1)


def test_a_countdown_is_called_off_at_the_first_press() -> None:
    played = Played()
    played.ask(NEXT, DISCARD)
    played.wait(10.0)
    assert (played.doing, played.log) == ("idle", [])


@pytest.mark.parametrize(("request_", "success"), [(SUCCESS, True), (FAILURE, False)])
def test_a_label_ends_a_running_episode_and_keeps_it(
    request_: EpisodeRequest, success: bool
) -> None:
    played = Played()
    played.record(5.0)
    played.ask(request_)
    assert [(one.kept, one.success) for one in played.log] == [(True, success)]


def test_the_last_episode_can_be_labelled_anew_and_keeps_its_label_when_it_is_discarded() -> None:
    played = Played()
    played.record(5.0)
    played.ask(NEXT, SUCCESS, FAILURE, DISCARD, DISCARD)
    labels = [(one.kept, one.success) for one in played.log]
    assert labels == [(True, None), (True, True), (True, False), (False, False)]
    assert len(played.episodes.ended) == 1


@pytest.mark.parametrize("request_", [SUCCESS, FAILURE, DISCARD])
def test_without_an_episode_there_is_nothing_to_label_or_discard(
    request_: EpisodeRequest,
) -> None:
    played = Played()
    played.ask(request_)
    assert played.sentences[0].startswith("there is no episode to")
    assert (played.doing, played.log) == ("idle", [])


def test_a_discarded_episode_is_not_labelled() -> None:
    played = Played()
    played.record(5.0)
    played.ask(DISCARD, DISCARD, SUCCESS)
    assert len(played.log) == 1


def test_an_episode_that_had_not_ended_when_the_session_did_is_named() -> None:
    played = Played()
    assert played.episodes.close() == ""
    played.record(5.0)
    assert played.episodes.close().startswith("episode 1 was running and is not kept")


def test_the_last_few_are_shown_with_their_verdicts() -> None:
    played = Played()
    for _ in range(SHOWN + 1):
        played.record(2.0)
        played.ask(SUCCESS)
    last = played.episodes.state(played.now_ns).last
    assert [one.number for one in last] == list(range(2, SHOWN + 2))
    assert all(one.success and one.length_s == 2.0 for one in last)


STEPS = st.lists(
    st.tuples(st.integers(0, 7_000).map(lambda ms: ms * NS_PER_MS), st.sampled_from(EpisodeRequest))
)


@given(steps=STEPS, countdown_s=st.sampled_from([0.0, 0.5, 3.0]))
def test_no_instant_is_of_two_episodes_and_each_ended_one_is_kept_or_discarded_by_two_presses(
    steps: list[tuple[int, EpisodeRequest]], countdown_s: float
) -> None:
    """At each instant the log has all that have ended: whatever happens then, they are whole."""
    played = Played(countdown_s)
    presses: list[tuple[int, EpisodeRequest]] = []
    for pause_ns, request in steps:
        played.wait(pause_ns / NS_PER_S)
        before = {one.number: one for one in played.log}
        played.ask(request)
        newest = {one.number: one for one in played.log}
        assert tuple(newest.values()) == played.episodes.ended
        state = played.episodes.state(played.now_ns)
        assert state.kept + state.discarded == len(newest)
        assert list(newest) == list(range(1, state.number))
        for number, episode in newest.items():
            was_kept = number not in before or before[number].kept
            if was_kept and not episode.kept:
                last_ns, last = presses[-1]
                assert request in (DISCARD, REDO)
                assert last is request
                assert played.now_ns - last_ns < ARMED_NS
        presses.append((played.now_ns, request))
    for one, other in pairwise(played.episodes.ended):
        assert one.start_ns <= one.end_ns <= other.start_ns <= other.end_ns
