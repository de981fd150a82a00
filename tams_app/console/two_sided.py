"""`robot` and `operate`: the two halves of a session on two computers."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from tams_app.config import Config
from tams_app.console.app import check_session, run_and_report
from tams_app.errors import ConfigError
from tams_app.faces.registry import check_faces
from tams_app.link.addresses import addresses_of, is_loopback
from tams_app.link.gateway_client import Endpoint
from tams_app.link.keys import accepted_keys, read_key
from tams_app.printing import Console
from tams_app.robot.build import check_hand
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.shared_ring import require_room
from tams_app.session.operate import operate
from tams_app.session.robot import robot
from tams_app.session.session import Session
from tams_app.session.shared_memory import robot_bytes, station_bytes
from tams_app.telemetry import Address


def run_robot(config: Config, endpoint: Endpoint, arm_at_once: bool, dry_run: bool) -> int:
    """The robot's side until its session ends; the exit code."""
    check_session(config, dry_run, robot_bytes(config))

    def make(folder: Path) -> Session:
        session = robot(config, MonotonicClock(), folder, endpoint, arm_at_once, dry_run)
        names = [] if endpoint.key is None else [key.name for key in accepted_keys(endpoint.key)]
        keys = f" with the key of {' or '.join(names)}" if names else ""
        session.sentences.note(f"waiting for an operator on {endpoint.host}:{endpoint.port}{keys}")
        return session

    return run_and_report(config, make)


def run_operate(config: Config, endpoint: Endpoint) -> int:
    """The operator's side until either ends the session; the exit code."""
    check_hand(config)
    check_faces(config)
    require_room(station_bytes(config))
    notify = partial(Console().print, soft_wrap=True)
    make = partial(operate, config, MonotonicClock(), endpoint=endpoint, notify=notify)
    return run_and_report(config, make)


def endpoint_of(
    option: str, given: str, key: Path | None, accepts_several: bool = False
) -> Endpoint:
    """HOST:PORT (IPv6: [HOST]:PORT) and the key; ConfigError unless they can be used together.

    `accepts_several`: on the robot's side the key may be a folder of keys.
    """
    at = Address.of(given, option, "192.168.1.20:7300")
    host, port = at.host, at.port
    try:
        _, addresses = addresses_of(host, port)
    except (OSError, UnicodeError) as error:
        raise ConfigError(f"{option}: {host} is not known: give a name or an address") from error
    if key is None and not all(map(is_loopback, addresses)):
        raise ConfigError(
            f"{option}: {host} can be reached from other computers, so --key is needed: "
            "make one with: key new FILE"
        )
    if key is None:
        # what listens does so at what was judged, not what it is later; who calls judges it again
        return Endpoint(addresses[0][0] if accepts_several else host, port, None)
    # what is wrong with it is reported before anything is started
    if accepts_several:
        accepted_keys(key)
    else:
        read_key(key)
    return Endpoint(host, port, key)
