"""Prometheus reads the figures of a session that runs."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tams_app.config import load_config
from tams_app.errors import ConfigError, SetupError
from tams_app.records import LINK_LOST, Note, Phase, SessionState, StopRecord, ViewState
from tams_app.runtime.clock import VirtualClock
from tams_app.session.recorders import Recorders
from tams_app.session.viewing import check_viewers, invite_viewers
from tams_app.telemetry import Address, Metrics
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.scraping import free_port, scrape
from tests.synthetic_session import START_NS, header, live_records, tick

pytestmark = pytest.mark.waiting

STATE = SessionState(
    t_s=12.5,
    arming="holding",
    deadman=True,
    phase="GRASP",
    primary_view="eih",
    views={
        "eih": ViewState(target_kbps=1500.0, sent_kbps=1400.0, latency_ms=80.0, age_ms=95.0),
        "gt": ViewState(target_kbps=300.0, given_fps=30.0, shown_fps=29.0),
    },
    link_kbps=1800.0,
    budget_kbps=2000.0,
    estimate_kbps=2200.0,
    queue_ms=12.0,
    loss=0.01,
    now_ns=5 * NS_PER_S,
    heard_ns=5 * NS_PER_S - 20 * NS_PER_MS,
)


@pytest.fixture
def address() -> Address:
    return Address("127.0.0.1", free_port(), "--metrics", "http")


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock(START_NS)


@pytest.fixture
def metrics(address: Address, clock: VirtualClock) -> Iterator[Metrics]:
    made = Metrics(address, header(), clock)
    yield made
    made.close()


def read(address: Address) -> dict[tuple[str, ...], float]:
    return scrape(f"{address.host}:{address.port}")


def test_the_state_is_given_in_units_that_the_names_say(metrics: Metrics, address: Address) -> None:
    metrics.refresh(lambda: STATE)
    figures = read(address)
    assert figures["tams_session_seconds",] == 12.5
    assert figures["tams_arm_state_age_seconds",] == pytest.approx(0.02)
    assert figures["tams_budget_bits_per_second",] == 2_000_000
    assert figures["tams_estimated_capacity_bits_per_second",] == 2_200_000
    assert figures["tams_uplink_queue_seconds",] == pytest.approx(0.012)
    assert figures["tams_uplink_loss_ratio",] == 0.01
    assert figures["tams_video_target_bits_per_second", "gt"] == 300_000
    assert figures["tams_video_latency_seconds", "eih"] == pytest.approx(0.08)
    assert figures["tams_video_age_seconds", "eih"] == pytest.approx(0.095)
    assert figures["tams_video_shown_frames_per_second", "gt"] == 29.0


def test_of_the_states_and_phases_one_is_1(metrics: Metrics, address: Address) -> None:
    metrics.refresh(lambda: STATE)
    figures = read(address)
    arming = {name[1]: value for name, value in figures.items() if name[0] == "tams_arming_state"}
    assert [state for state, value in arming.items() if value] == ["holding"]
    assert set(arming) == {
        *("disarmed", "ready", "engaged", "holding", "fault"),
        *("starting", LINK_LOST),
    }
    phases = {name[1]: value for name, value in figures.items() if name[0] == "tams_phase"}
    assert phases == {phase.value: phase is Phase.GRASP for phase in Phase}
    assert figures["tams_primary_view", "eih"] == 1


def test_what_is_not_known_is_left_out(metrics: Metrics, address: Address) -> None:
    before = read(address)
    assert not any(name[0] == "tams_arming_state" for name in before)
    metrics.refresh(lambda: STATE)
    figures = read(address)
    assert ("tams_emulated_capacity_bits_per_second",) not in figures
    assert ("tams_video_latency_seconds", "gt") not in figures
    assert ("tams_stops_total",) not in figures


def test_a_state_of_another_version_is_shown_as_it_is(metrics: Metrics, address: Address) -> None:
    metrics.refresh(lambda: SessionState(t_s=0.0, arming="parked"))
    assert read(address)["tams_arming_state", "parked"] == 1


def test_the_state_is_asked_for_once_a_second(metrics: Metrics, clock: VirtualClock) -> None:
    asked = []

    def state() -> SessionState:
        asked.append(clock.now_ns())
        return STATE

    for _ in range(60):
        metrics.refresh(state)
        clock.sleep_until_ns(clock.now_ns() + 50 * NS_PER_MS)
    assert [ns - START_NS for ns in asked] == [0, NS_PER_S, 2 * NS_PER_S]


def test_late_ticks_are_counted_with_those_left_out(metrics: Metrics, address: Address) -> None:
    for late_ns, skipped in ((0, 0), (NS_PER_MS, 0), (NS_PER_MS + 1, 0), (0, 3), (0, 3)):
        metrics.receive(tick(0, late_ns=late_ns, skipped=skipped), START_NS)
    figures = read(address)
    assert figures["tams_control_ticks_total",] == 5
    assert figures["tams_control_late_ticks_total",] == 4


def test_stops_are_counted_by_reason_and_sentences_by_level(
    metrics: Metrics, address: Address
) -> None:
    for reason in ("stale video", "e-stop", "stale video"):
        metrics.receive(StopRecord(reason, START_NS, None), START_NS)
    metrics.receive(Note(START_NS, "warning", "one"), START_NS)
    figures = read(address)
    assert figures["tams_stops_total", "stale video"] == 2
    assert figures["tams_stops_total", "e-stop"] == 1
    assert figures["tams_notes_total", "warning"] == 1


def recorders(folder: Path, port: int) -> Recorders:
    def fails(thread: str, failure: BaseException) -> None:
        raise AssertionError(thread) from failure

    config = load_config(
        None, {"recording.metrics": f"127.0.0.1:{port}", "recording.viewers": False}
    )
    (folder / "helpers").mkdir(parents=True)
    return Recorders(config, VirtualClock(START_NS), folder, fails)


def test_they_count_what_the_log_keeps_and_end_with_it(tmp_path: Path) -> None:
    port = free_port()
    log = recorders(tmp_path / "one", port)
    given = list(live_records(1.0))
    sent = sum(type(record).__name__ == "EncodedFrame" for record in given)
    for record in given:
        if type(record).__name__ == "PacketRecord":
            log.packets([record])
        else:
            log.record(record)
    deadline_s = time.monotonic() + 10
    while (figures := scrape(f"127.0.0.1:{port}")).get(("tams_control_ticks_total",)) != 120:
        assert time.monotonic() < deadline_s, figures
    assert (
        sum(count for name, count in figures.items() if name[0] == "tams_video_sent_frames_total")
        == sent
        > 0
    )
    log.close()
    with pytest.raises(OSError, match="refused"):
        scrape(f"127.0.0.1:{port}")
    recorders(tmp_path / "two", port).close()  # the address is free again


def test_a_caller_that_sends_nothing_keeps_others_waiting_for_a_second_at_most(
    metrics: Metrics, address: Address
) -> None:
    silent = [socket.create_connection((address.host, address.port)) for _ in range(2)]
    begun_s = time.monotonic()
    assert read(address)
    assert time.monotonic() - begun_s < 4.0
    for caller in silent:
        caller.close()


def test_a_caller_that_leaves_at_once_is_not_told_of_on_the_terminal(
    metrics: Metrics, address: Address, capfd: pytest.CaptureFixture[str]
) -> None:
    for _ in range(5):
        caller = socket.create_connection((address.host, address.port))
        caller.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        caller.sendall(b"GET /metrics HTTP/1.1\r\n\r\n")
        caller.close()
    assert read(address)
    assert capfd.readouterr().err == ""


def test_a_port_in_use_is_told_in_one_sentence_before_anything_is_made() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        config = load_config(None, {"recording.metrics": f"127.0.0.1:{port}"})
        with pytest.raises(SetupError, match=f"^--metrics: .*127.0.0.1:{port} .*in use") as told:
            check_viewers(config)
    assert told.value.exit_code == 1


def test_what_is_no_address_is_told() -> None:
    with pytest.raises(ConfigError, match=r"^--metrics: 'here' is not HOST:PORT"):
        check_viewers(load_config(None, {"recording.metrics": "here"}))


@pytest.mark.parametrize(
    ("host", "said"),
    [
        ("127.0.0.1", ("info", "Prometheus may scrape http://127.0.0.1:9464")),
        (
            "0.0.0.0",
            (
                "warning",
                "all who reach http://0.0.0.0:9464 see this session: no password is asked",
            ),
        ),
    ],
)
def test_it_is_said_where_prometheus_scrapes_and_who_else_could(
    host: str, said: tuple[str, str]
) -> None:
    notes: list[tuple[str, str]] = []
    config = load_config(None, {"recording.metrics": f"{host}:9464"})
    invite_viewers(config, lambda level, text: notes.append((level, text)))
    assert notes == [said]
