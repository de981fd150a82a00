"""The link between two computers, as each side logs it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from tams_app.records.record import Record, TimeNs


@dataclass(frozen=True, slots=True)
class HandHeard(Record):
    """A sample of the hand as the robot's side received it."""

    t_ns: TimeNs
    sent_ns: Annotated[int, "when the operator's side sent it, on its own clock [ns]"]
    pose_ns: Annotated[int, "when the value of the pose last changed, on the same clock [ns]"]
    echo_ns: Annotated[int, "newest stamp of this side in the message [ns]"]
    refusal: Annotated[str, "why the sample did not count; empty: it did"]
    operator: Annotated[
        int, "number of the application that sent it, `link_operator` in its own log"
    ]


@dataclass(frozen=True, slots=True)
class StateHeard(Record):
    """A message of the robot's side as the operator's side received it."""

    t_ns: TimeNs
    sent_ns: Annotated[int, "when the robot's side sent it, on its own clock [ns]"]
    echo_ns: Annotated[int, "newest stamp of the operator's side in the message, on its clock [ns]"]


@dataclass(frozen=True, slots=True)
class LinkHealth(Record):
    """How the link stands, as one side sees it."""

    t_ns: TimeNs
    connected: Annotated[bool, "whether messages of the other side arrive"]
    age_bound_ns: Annotated[
        int | None, "what arrived last is no older [ns]; null: nothing has arrived"
    ]
    offset_ns: Annotated[
        int | None, "the other side's clock minus this one's [ns]; null: not known yet"
    ]
    uncertainty_ns: Annotated[int | None, "of the offset [ns]; null: not known yet"]
    refused: Annotated[dict[str, int], "messages that changed nothing since the start, by reason"]
    ignored: Annotated[dict[str, int], "datagrams that changed nothing since the start, by reason"]
