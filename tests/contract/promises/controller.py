"""The contract of every controller in an operator's hand."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from hw.controller import Controller
from tams_app.config.motion import FreshnessConfig
from tams_app.records import ControllerSample, ControllerStatus, Haptic
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.contract.promises.promise import Promise, require

FRESH_WITHIN_NS = round(FreshnessConfig().buttons_ms * NS_PER_MS)  # by the safety logic
_WITHIN_NS = 20 * NS_PER_S  # generous: the machine may be busy


class ControllerBench(ABC):
    """A controller in use, its deadman held down, and a way to let time pass."""

    controller: Controller
    """Not started yet; its deadman is held from then on."""

    @abstractmethod
    def advance(self) -> int:
        """Let one tick of about 8 ms pass; the time after it [ns], by the clock of the samples."""

    def sample(self) -> ControllerSample:
        """The sample of the next tick."""
        return self.controller.sample(self.advance())

    def until(self, holds: Callable[[ControllerSample], bool]) -> ControllerSample:
        """The first sample of which `holds` is true; AssertionError if none is within 20 s."""
        deadline_ns = self.advance() + _WITHIN_NS
        while True:
            now_ns = self.advance()
            sample = self.controller.sample(now_ns)
            if holds(sample):
                return sample
            require(now_ns < deadline_ns, f"after {_WITHIN_NS // NS_PER_S} s still {sample}")


def is_in_use(sample: ControllerSample) -> bool:
    """Test whether the deadman is held and known to be."""
    return sample.status is ControllerStatus.OK and sample.trigger == 1.0


def is_released(sample: ControllerSample) -> bool:
    """Test whether nothing reads as pressed."""
    pressed = sample.a or sample.b or sample.menu
    return (sample.trigger, sample.grip, pressed) == (0.0, 0.0, False)


def _require_away(sample: ControllerSample) -> None:
    require(
        sample.status is ControllerStatus.DISCONNECTED,
        f"its status is {sample.status.value}, not {ControllerStatus.DISCONNECTED.value}",
    )
    require(sample.pose is None, "it has a pose")
    require(is_released(sample), "something reads as pressed")


def one_that_was_not_started_is_disconnected_and_released(bench: ControllerBench) -> None:
    _require_away(bench.sample())


def the_first_sample_after_the_start_is_fresh(bench: ControllerBench) -> None:
    bench.controller.start()
    before_ns = bench.advance()
    sample = bench.until(lambda sample: sample.pose_ns >= before_ns)
    require(sample.status is ControllerStatus.OK, f"its status is {sample.status.value}")
    require(sample.pose is not None, "it has no pose")


def pose_and_buttons_stay_fresh(bench: ControllerBench) -> None:
    _held(bench)
    for _ in range(20):
        asked_ns = bench.advance()
        sample = bench.until(lambda s, a=asked_ns: min(s.pose_ns, s.buttons_ns) >= a)  # type: ignore[misc]
        require(is_in_use(sample), f"a held controller gives {sample}")


def times_never_go_back_and_never_lie_ahead(bench: ControllerBench) -> None:
    _held(bench)
    pose_ns = buttons_ns = 0
    for _ in range(30):
        now_ns = bench.advance()
        sample = bench.controller.sample(now_ns)
        for what, before_ns, t_ns in (
            ("pose", pose_ns, sample.pose_ns),
            ("buttons", buttons_ns, sample.buttons_ns),
        ):
            require(before_ns <= t_ns, f"the time of the {what} goes back")
            require(t_ns <= now_ns + FRESH_WITHIN_NS, f"the time of the {what} lies ahead")
        pose_ns, buttons_ns = sample.pose_ns, sample.buttons_ns


def after_closing_everything_is_released_and_pulses_are_harmless(bench: ControllerBench) -> None:
    _held(bench)
    bench.controller.close()
    bench.controller.close()
    bench.controller.pulse(Haptic.FAULT)
    _require_away(bench.sample())


def one_that_was_closed_can_be_started_again(bench: ControllerBench) -> None:
    _held(bench)
    bench.controller.close()
    bench.controller.start()
    asked_ns = bench.advance()
    bench.until(lambda s: is_in_use(s) and min(s.pose_ns, s.buttons_ns) >= asked_ns)


def closing_what_was_never_started_is_harmless(bench: ControllerBench) -> None:
    bench.controller.close()
    _require_away(bench.sample())


def _held(bench: ControllerBench) -> None:
    """Started and in use."""
    bench.controller.start()
    bench.until(is_in_use)


CONTROLLER_PROMISES: tuple[Promise[ControllerBench], ...] = (
    one_that_was_not_started_is_disconnected_and_released,
    the_first_sample_after_the_start_is_fresh,
    pose_and_buttons_stay_fresh,
    times_never_go_back_and_never_lie_ahead,
    after_closing_everything_is_released_and_pulses_are_harmless,
    one_that_was_closed_can_be_started_again,
    closing_what_was_never_started_is_harmless,
)
