"""`doctor --link` against a real gateway on loopback."""

from __future__ import annotations

import io
import json
import socket
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest

from tams_app.console import link_check
from tams_app.console.link_check import findings, measured, run_link_check
from tams_app.console.options import endpoint_of
from tams_app.errors import ConfigError, HelperError, TamsError
from tams_app.link.gateway_client import Endpoint, Gateway
from tams_app.link.keys import new_key
from tams_app.printing import Console
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.free_port import free_port

pytestmark = pytest.mark.waiting


@pytest.fixture
def key(tmp_path: Path) -> Path:
    new_key(tmp_path / "key")
    return tmp_path / "key"


@pytest.fixture
def robot(key: Path, tmp_path: Path) -> Iterator[Endpoint]:
    endpoint = Endpoint("127.0.0.1", free_port(socket.SOCK_DGRAM), key)
    gateway = Gateway("robot", endpoint, b"welcome", tmp_path)
    gateway.launch()
    try:
        gateway.wait_ready()
        yield endpoint
    finally:
        gateway.close()


@pytest.fixture
def a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """It measures for a second only."""
    monkeypatch.setattr(link_check, "_PINGS", 125)


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """It waits a second for an answer."""
    monkeypatch.setattr(link_check, "_ANSWER_NS", NS_PER_S)


@pytest.mark.usefixtures("a_second")
def test_it_says_what_was_measured_and_what_to_set(robot: Endpoint):
    out = io.StringIO()
    run_link_check(robot, console=Console(file=out, width=200))
    text = out.getvalue()
    assert "round trip:" in text
    assert "lost 0.0%" in text
    assert "latency_ms:" in text


@pytest.mark.usefixtures("a_second")
def test_a_program_reads_the_measurement_as_one_object(robot: Endpoint):
    out = io.StringIO()
    run_link_check(robot, True, Console(file=out, width=40))
    found = json.loads(out.getvalue())
    assert found["lost_fraction"] == 0.0
    assert found["round_trip_ms"]["p50"] <= found["round_trip_ms"]["p99"]
    assert found["latency_ms"] == found["round_trip_ms"]["p50"] / 2


@pytest.mark.usefixtures("impatient")
def test_a_key_that_is_not_accepted_is_among_the_reasons_for_no_answer(
    robot: Endpoint, tmp_path: Path
):
    new_key(tmp_path / "other")
    with pytest.raises(HelperError, match=r"no answer: .*or it is refused \(another key"):
        run_link_check(Endpoint(robot.host, robot.port, tmp_path / "other"), console=quiet())


@pytest.mark.usefixtures("impatient")
def test_nothing_that_answers_is_told_in_a_sentence(key: Path):
    with pytest.raises(HelperError, match="no answer: the call does not arrive there"):
        run_link_check(Endpoint("127.0.0.1", free_port(socket.SOCK_DGRAM), key), console=quiet())


def test_a_robots_side_that_ends_meanwhile_is_not_measured(key: Path, tmp_path: Path):
    endpoint = Endpoint("127.0.0.1", free_port(socket.SOCK_DGRAM), key)
    with (
        closing(Gateway("robot", endpoint, b"welcome", tmp_path)) as gateway,
        ThreadPoolExecutor(1) as other,
    ):
        gateway.launch()
        gateway.wait_ready()
        found = other.submit(run_link_check, endpoint, console=quiet())
        while not gateway.event.connected:
            gateway.receive()
            time.sleep(0.01)
        gateway.send_goodbye()
        with pytest.raises(HelperError, match="the robot's side ended meanwhile"):
            found.result()


def test_an_operator_who_is_there_is_not_disturbed(robot: Endpoint, tmp_path: Path):
    operator = Gateway("operator", robot, b"", tmp_path)
    operator.launch()
    try:
        operator.wait_ready()
        with pytest.raises(HelperError, match="another operator"):
            run_link_check(robot, console=Talking(operator))
    finally:
        operator.close()


class Talking(Console):
    """A console whose first line waits until `operator` is connected; who then goes on talking."""

    def __init__(self, operator: Gateway) -> None:
        super().__init__(file=io.StringIO())
        self._operator = operator

    def print(self, *_: object, **__: object) -> None:
        while not self._operator.event.connected:
            self._operator.receive()
            time.sleep(0.01)
        self._operator.send(b"m")
        time.sleep(0.1)


def quiet() -> Console:
    return Console(file=io.StringIO())


def echoes(*trips_ms: float) -> list[tuple[int, int]]:
    """Of pings in turn, that took so long."""
    sent = [(NS_PER_S + n * 8 * NS_PER_MS, trip) for n, trip in enumerate(trips_ms)]
    return [(ns, ns + round(trip * NS_PER_MS)) for ns, trip in sent]


def bursts(every_ms: int, held_ms: int = 150) -> list[tuple[int, int]]:
    """Ten seconds of pings on a link that holds them so long, so often."""
    return echoes(*(1.0 + max(0, held_ms - 8 * n % every_ms) for n in range(1250)))


def text_of(found: list[tuple[int, int]]) -> str:
    return "\n".join(findings(measured(found)))


def test_a_link_that_answers_nothing_is_no_measurement():
    with pytest.raises(TamsError, match="answers no measurement"):
        measured([])


def test_of_a_network_on_which_samples_may_be_seconds_old_no_settings_are_proposed():
    usual = text_of(echoes(20.0, 22.0, 25.0))
    assert "latency_ms: 11.0" in usual
    assert "older than 2" in usual
    queued = text_of(echoes(20.0, 700.0, 1500.0))
    assert "no arm may be moved over this network" in queued
    assert "latency_ms:" not in queued


def test_gaps_that_would_hold_the_arm_are_told_and_prescribed_for():
    text = text_of(bursts(1000))
    assert "54 a minute exceed link.lost_after_ms (100 ms) and hold the arm" in text
    assert "\n  lost_after_ms: 190" in text
    assert "link gaps" not in text
    assert "lost_after_ms:" not in text_of(echoes(*[20.0] * 1250))


@pytest.mark.parametrize(("every_ms", "held_ms"), [(400, 150), (320, 90), (304, 200)])
def test_of_gaps_that_would_hold_the_arm_whatever_is_set_it_prescribes_nothing(
    every_ms: int, held_ms: int
):
    text = text_of(bursts(every_ms, held_ms))
    assert "are the third within a second and hold the arm (link gaps): no setting helps" in text
    assert "  lost_after_ms:" not in text


def test_gaps_that_hold_the_arm_even_with_what_is_prescribed_are_counted():
    in_a_row = [(10 * NS_PER_S + sent, 10 * NS_PER_S + came) for sent, came in bursts(400)]
    text = text_of([*bursts(1000), *in_a_row[:130]])
    assert "\n  lost_after_ms: 190" in text
    assert "whatever is set, 6 a minute hold the arm (link gaps)" in text


def test_without_a_key_only_loopback_is_allowed(key: Path):
    assert endpoint_of("--listen", "127.0.0.1:7400", None).key is None
    assert endpoint_of("--listen", "[::1]:7400", None).host == "::1"
    with pytest.raises(ConfigError, match=r"^--listen: '7400' is not HOST:PORT, such as 192"):
        endpoint_of("--listen", "7400", None)
    for host in ("0.0.0.0", "[::]", "192.0.2.1"):
        with pytest.raises(ConfigError, match="--key is needed"):
            endpoint_of("--listen", f"{host}:7400", None)
        assert endpoint_of("--listen", f"{host}:7400", key).key == key


def test_a_key_that_cannot_be_used_is_refused_before_anything_starts(tmp_path: Path):
    with pytest.raises(ConfigError, match="cannot be read"):
        endpoint_of("--robot", "127.0.0.1:7400", tmp_path / "missing")
