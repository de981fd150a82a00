"""The link between two computers, as each side logs it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class HandHeard:
    """A sample of the hand as the robot's side heard it.

    t_ns, echo_ns: on the robot's clock; sent_ns, pose_ns: on that of the operator's side.
    refusal: why it did not count, "" if it did. operator: the number of the application that sent
        it, `link_operator` in its own log.
    """

    t_ns: int
    sent_ns: int
    pose_ns: int
    echo_ns: int
    refusal: str
    operator: int


@dataclass(frozen=True, slots=True)
class StateHeard:
    """A message of the robot's side as the operator's side heard it.

    t_ns, echo_ns: on the clock of the operator's side; sent_ns: on the robot's.
    """

    t_ns: int
    sent_ns: int
    echo_ns: int


@dataclass(frozen=True, slots=True)
class LinkHealth:
    """How the link stands, as one side sees it.

    age_bound_ns: what was heard last is no older. offset_ns: the other side's clock minus ours,
    with its uncertainty; None before the first exchange. refused, ignored: messages and datagrams
    that changed nothing, by reason, since the start.
    """

    t_ns: int
    connected: bool
    age_bound_ns: int | None
    offset_ns: int | None
    uncertainty_ns: int | None
    refused: dict[str, int]
    ignored: dict[str, int]
