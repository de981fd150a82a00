"""Episodes: parts of a session, recorded one after the other, each kept or discarded."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from tams_app.records.record import Record, TimeNs


class EpisodeRequest(StrEnum):
    """A person's request about episodes; the order is that of the counts in a link's message."""

    NEXT = "next"  # begin one; end the one that is recorded, and keep it
    DISCARD = "discard"
    REDO = "redo"  # discard, and begin the next
    SUCCESS = "success"
    FAILURE = "failure"


@dataclass(frozen=True, slots=True)
class Episode(Record):
    """An episode that has ended, written then and at each later verdict: the newest counts."""

    t_ns: TimeNs
    number: Annotated[int, "of the episode, from 1 in each session"]
    start_ns: Annotated[int, "when it began [ns]"]
    end_ns: Annotated[int, "when it ended, an instant that is not part of it [ns]"]
    kept: Annotated[bool, "whether it is kept, and not discarded"] = True
    success: Annotated[bool | None, "whether a person called it a success; null: nobody said"] = (
        None
    )
