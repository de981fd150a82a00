"""Looking at cameras until a person is done, and asking one where there is one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from calibration.cameras.bench import Bench, Shot
from calibration.desk import Desk

_CHUNK_S = 0.5


def until_done(
    desk: Desk, bench: Bench, cameras: Sequence[str], most_s: float, every: int = 1
) -> Iterator[Shot]:
    """Images until Enter is pressed, a simulated person has finished, or `most_s` are over."""
    for _ in range(round(most_s / _CHUNK_S)):
        yield from bench.shots(cameras, _CHUNK_S, every)
        if desk.pressed() or bench.done:
            return


def agreed(desk: Desk, bench: Bench, question: str, otherwise: bool) -> bool:
    """The person's answer; `otherwise` where none is there to be asked."""
    if not (bench.attended and desk.attended):
        return otherwise
    return desk.conversation.yes(question)
