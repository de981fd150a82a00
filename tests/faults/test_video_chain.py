"""The real video chain cut, frozen and killed while the arm moves: slower, held, and back."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tams_app.config import Network, load_config
from tams_app.errors import HelperError
from tams_app.records import ShownFrame
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_S
from tests.faults.applications import until
from tests.faults.bench import NETWORK
from tests.faults.braking import TICKS_TO_REST, comes_to_rest
from tests.faults.chain import Chain, StreamedBench
from tests.faults.promises import is_logged, recovers_from_hold
from tests.faults.test_video_freeze import HOLD_NS, expected_scale

pytestmark = [
    pytest.mark.timed,
    pytest.mark.second_chance(standstill_ms=100),  # a frame's age has 500 ms
    pytest.mark.verify,
    pytest.mark.usefixtures("real_time"),
]

PRIMARY = "gt"  # in the phase REACH, in which the arm stays
S2 = load_config().networks[NETWORK]


@pytest.fixture(autouse=True)
def _no_glib_complaints(glib_complaints: list[str]) -> None:
    """Nothing to do but to listen."""


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chain]:
    with Chain(S2, tmp_path_factory.mktemp("chain")) as chain:
        yield chain


@pytest.fixture
def chain(shared: Chain) -> Chain:
    """A chain that works, whatever the test before did to it."""
    until(shared.is_fresh, "fresh frames")
    return shared


def live(chain: Chain, folder: Path) -> StreamedBench:
    """An arm that moves to and fro."""
    made = StreamedBench(chain, folder)
    made.run(0.3)
    return made


def obeys_the_video(chain: Chain, made: StreamedBench) -> None:
    """Every tick while engaged was slowed by the age of its frame, and the first too old held.

    Whatever this machine's load made of the ages.
    """
    outputs = made.bench.outputs
    ages_ns = chain.ages_ns[-len(outputs) :]
    engaged = [
        (age_ns, output)
        for age_ns, output in zip(ages_ns, outputs, strict=True)
        if output.arming is ArmingState.ENGAGED
    ]
    assert engaged
    for age_ns, output in engaged:
        assert age_ns < HOLD_NS
        assert output.speed_scale == pytest.approx(expected_scale(age_ns), abs=1e-6)


def first_hold(made: StreamedBench) -> int:
    """The tick in which the arm began to hold."""
    armings = [output.arming for output in made.bench.outputs]
    return armings.index(ArmingState.HOLDING)


def reason_of_hold(chain: Chain, made: StreamedBench) -> Reason:
    """Why the arm began to hold: the frame that counts is too old, whatever came after it.

    What the link lost of the last frames may have left them damaged, which the reason says.
    """
    held = first_hold(made) - len(made.bench.outputs)
    reason = made.bench.outputs[held].reason
    assert reason is (Reason.VIDEO_DAMAGED if chain.are_damaged[held] else Reason.STALE_VIDEO)
    assert chain.ages_ns[held] >= HOLD_NS
    return reason


def holds_then_recovers(chain: Chain, made: StreamedBench) -> None:
    """Held for the video; once it is back the trigger must be released, and all is well."""
    bench = made.bench
    held, reason = first_hold(made), reason_of_hold(chain, made)
    assert comes_to_rest(bench, held, steady=False) <= TICKS_TO_REST
    obeys_the_video(chain, made)
    made.run_until(chain.is_fresh, "the frame's return")
    assert bench.outputs[-1].arming is ArmingState.HOLDING
    bench.hand.velocity = np.zeros(3)
    recovers_from_hold(bench, reason)
    is_logged(bench, reason)
    bench.close()


def is_held(made: StreamedBench) -> bool:
    return made.bench.outputs[-1].arming is ArmingState.HOLDING


@pytest.mark.parametrize("seconds", [0.3, 1.0, 5.0])
def test_an_uplink_blackout_slows_then_holds_the_arm_until_it_is_over(
    chain: Chain, tmp_path: Path, seconds: float
) -> None:
    made = live(chain, tmp_path)
    os.kill(chain.relay_pid, signal.SIGSTOP)
    try:
        made.run(seconds)
    finally:
        os.kill(chain.relay_pid, signal.SIGCONT)
    if seconds >= 1.0 or is_held(made):
        holds_then_recovers(chain, made)
        return
    made.run_until(chain.is_fresh, "the frame's return")
    obeys_the_video(chain, made)
    made.bench.close()


@pytest.mark.parametrize("view", ["eih", "gs"])
def test_a_frozen_camera_of_another_view_stops_nothing(
    chain: Chain, tmp_path: Path, view: str
) -> None:
    made = live(chain, tmp_path)
    chain.cameras[view].frozen = True
    try:
        made.run_until(
            lambda: (chain.operator.age_ns(view, time.monotonic_ns()) or 0) > HOLD_NS, "an old view"
        )
        made.run(0.2)
    finally:
        chain.cameras[view].frozen = False
    obeys_the_video(chain, made)
    late = max(chain.ages_ns[-len(made.bench.outputs) :]) >= HOLD_NS
    assert late or made.bench.outputs[-1].arming is ArmingState.ENGAGED
    made.bench.close()


def test_a_frozen_camera_of_the_primary_view_holds_the_arm(chain: Chain, tmp_path: Path) -> None:
    made = live(chain, tmp_path)
    chain.cameras[PRIMARY].frozen = True
    try:
        made.run_until(lambda: is_held(made), "the hold")
        made.run(0.3)
    finally:
        chain.cameras[PRIMARY].frozen = False
    holds_then_recovers(chain, made)


def test_a_capacity_that_falls_to_nothing_holds_the_arm_until_it_returns(tmp_path: Path) -> None:
    trace = tmp_path / "outages.csv"
    trace.write_text("t_ms,kbps\n0,6000\n8000,0\n9500,6000\n")
    network = Network(latency_ms=40, jitter_ms=8, trace=str(trace))
    epoch_ns = time.monotonic_ns() - 5 * NS_PER_S  # the first outage is not far
    with Chain(network, tmp_path, epoch_ns) as chain:
        made = live(chain, tmp_path)
        made.run_until(lambda: is_held(made), "an outage")
        made.run(0.2)
        holds_then_recovers(chain, made)


def test_a_killed_receiver_holds_the_arm(tmp_path: Path) -> None:
    with Chain(S2, tmp_path) as chain:
        made = live(chain, tmp_path)
        chain.receiver(PRIMARY).close()
        made.run_until(lambda: is_held(made), "the hold")
        made.run(0.3)
        held, reason = first_hold(made), reason_of_hold(chain, made)
        assert comes_to_rest(made.bench, held, steady=False) <= TICKS_TO_REST
        obeys_the_video(chain, made)
        made.bench.hand.trigger = 0.0
        made.run(0.5)
        assert is_held(made), "not without a frame"
        is_logged(made.bench, reason)
        made.bench.close()


def test_a_receiver_that_runs_out_of_memory_names_itself_and_a_killed_relay_too(
    tmp_path: Path,
) -> None:
    """Both end the session: the sentence of either is what the session would fail with."""
    exhausted = False

    def run_out(shown: ShownFrame) -> None:
        if exhausted and shown.view == PRIMARY:
            raise MemoryError("no room for a frame")

    with Chain(S2, tmp_path, on_shown=run_out) as chain:
        made = live(chain, tmp_path)
        assert chain.poll() == ""
        exhausted = True
        made.run_until(lambda: is_held(made), "the hold")
        reason_of_hold(chain, made)
        assert chain.poll().startswith(f"the receiver of view {PRIMARY} failed")
        os.kill(chain.relay_pid, signal.SIGKILL)
        until(lambda: bool(chain.failures), "the relay's end")
        ((_, failure),) = chain.failures
        assert isinstance(failure, HelperError)
        assert "ended unasked" in str(failure)
        made.bench.close()
