"""Reading capacity traces, and from a network's name to its conditions and capacity."""

import math
from pathlib import Path

import pytest

from tams_app.capacity import TraceCapacity
from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.errors import ConfigError
from tams_app.units import NS_PER_MS
from tams_app.video.live.networks import (
    described,
    network_capacity,
    parse_trace,
    read_trace,
    resolve_network,
)

pytestmark = pytest.mark.untimed


def test_a_table_holds_each_rate_until_the_next_row_in_times_since_the_first():
    trace = parse_trace("t_ms,kbps\r\n1000,6000\r\n1250,0\r\n1400,1500.5\r\n", "x.csv")
    assert trace.starts_ns == (0, 250 * NS_PER_MS, 400 * NS_PER_MS)
    assert trace.kbps == (6000.0, 0.0, 1500.5)
    assert trace.period_ns == 550 * NS_PER_MS  # the last row lasts as long as the one before


def test_a_full_packet_ends_at_its_mahimahi_opportunity():
    opportunities_ms = [2, 5, 5, 5, 40, 41]
    capacity = TraceCapacity(parse_trace("\n".join(map(str, opportunities_ms)), "up"), 0)
    ends_ns, now_ns = [], 0
    for _ in range(2 * len(opportunities_ms)):
        now_ns = capacity.finish_ns(now_ns, 1500 * 8)
        ends_ns.append(now_ns)
    # three at one time share the 3 ms before it
    first_round = [2, 3, 4, 5, 40, 41]
    expected_ms = first_round + [41 + ms for ms in first_round]
    # a nanosecond of rounding in a fast stretch is a hundred in a slow one
    assert ends_ns == pytest.approx([ms * NS_PER_MS for ms in expected_ms], abs=1000)


def test_mahimahi_opportunities_at_time_zero_close_the_round():
    trace = parse_trace("0\n0\n10\n", "up")
    assert (trace.starts_ns, trace.kbps, trace.period_ns) == ((0,), (3600.0,), 10 * NS_PER_MS)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "x: is empty"),
        ("t_ms,kbps\n", "x: holds a header but no rows"),
        ("time,rate\n0,1\n", "x, line 1: the header must be t_ms,kbps"),
        ("t_ms,kbps\n0,1\n\n100,abc\n", "x, line 4: '100,abc' is not two numbers"),
        ("t_ms,kbps\n0,1,2\n", "x, line 2: a row holds two numbers"),
        ("t_ms,kbps\n0,1\n100,2\n100,3\n", "x, line 4: t_ms must be greater"),
        ("t_ms,kbps\n0,1\n100,-2\n", "x, line 3: kbps must be 0 or from 1 to 1,000,000,000"),
        ("t_ms,kbps\n0,0.99\n", "x, line 2: kbps must be 0 or from 1"),
        ("t_ms,kbps\n0,1000000001\n", "x, line 2: kbps must be 0 or from 1"),
        ("t_ms,kbps\n-1e308,1\n1e308,2\n", "x, line 3: the trace is longer than a day"),
        ("t_ms,kbps\n1e308,1\n-1e308,2\n", "x, line 3: t_ms must be greater"),
        ("t_ms,kbps\n0,1\n43200001,2\n", "x, line 3: the trace is longer than a day"),
        ("1\n86400001\n", "x, line 2: the trace is longer than a day"),
        (f"1\n{'9' * 5000}\n", "x, line 2: the trace is longer than a day"),
        (f"1\n{'0' * 5000}\n", "x, line 2: times must not go back"),
        ("t_ms,kbps\n0,nan\n", "x, line 2: numbers must be finite"),
        ("t_ms,kbps\n0,0\n100,0\n", "x: the trace carries nothing"),
        ("1\n2\n1\n", "x, line 3: times must not go back"),
        ("1\n-2\n", "x, line 2: '-2' is neither a time in whole milliseconds nor"),
        ("hello\n", "x, line 1: 'hello' is neither"),
        ("0\n0\n", "x: every time is 0"),
    ],
)
def test_a_wrong_trace_is_refused_with_file_line_and_reason(text, reason):
    with pytest.raises(ConfigError) as caught:
        parse_trace(text, "x")
    assert str(caught.value).startswith(reason)


def test_a_day_and_the_bounds_of_the_rates_are_still_accepted():
    table = parse_trace("t_ms,kbps\n0,1\n43200000,1e9\n", "x")
    assert (table.kbps, table.period_ns) == ((1.0, 1e9), 86_400_000 * NS_PER_MS)
    slow = parse_trace("86400000\n", "x")
    assert TraceCapacity(slow, 0).finish_ns(0, 1500 * 8) == slow.period_ns


@pytest.mark.parametrize("text", ["t_ms,kbps\n0,5\n", "10\n20\n"])
def test_a_byte_order_mark_is_no_part_of_the_trace(tmp_path, text):
    path = tmp_path / "sheet.csv"
    path.write_text(text, encoding="utf-8-sig")
    assert read_trace(path) == parse_trace(text, "x")


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"none\.csv: cannot be read: No such file"):
        read_trace(tmp_path / "none.csv")
    (tmp_path / "frame").write_bytes(b"\xff\xd8\xff\x00")
    with pytest.raises(ConfigError, match="frame: is not a text file"):
        read_trace(tmp_path / "frame")


@pytest.mark.parametrize(
    "text",
    [
        "t_s,kbps\n0,6000\n0.25,1500\n",
        "t_s,mbps\n0,6\n0.25,1.5\n",
        "t_ms;kbps\n0;6000\n250;1500\n",
        "t_s;mbps\n0;6\n0,25;1,5\n",  # as spreadsheets of half of Europe write it
        "t_ms\tkbps\n0\t6000\n250\t1500\n",
        '"t_ms","kbps"\n"0","6000"\n"250","1500"\n',
        "T_s, Mbps\n0, 6\n0.25, 1.5\n",
    ],
)
def test_a_table_may_have_other_units_separators_and_quotes(text):
    assert parse_trace(text, "x") == parse_trace("t_ms,kbps\n0,6000\n250,1500\n", "x")


def test_a_trace_is_described_by_length_mean_and_peak():
    trace = parse_trace("t_s,kbps\n0,6000\n1,2000\n", "x")
    assert described(trace) == ("2 s, 4000 kbit/s in the mean, 6000 at most", True)


@pytest.mark.parametrize("text", ["t_ms,kbps\n0,5\n60,6\n", "t_ms,kbps\n0,6000000\n1000,3000000\n"])
def test_a_trace_that_is_shorter_or_faster_than_links_are_is_asked_about(text):
    said, is_plausible = described(parse_trace(text, "x"))
    assert not is_plausible
    assert "are its units those of t_ms,kbps?" in said


# --- networks ------------------------------------------------------------------------------------


def test_a_name_is_looked_up():
    network = resolve_network(load_config(), "s2")
    assert (network.latency_ms, network.rate_kbps) == (40, 6000)
    assert network_capacity(network, 0).mean_kbps(0, 5) == 6000


def test_none_has_no_bottleneck():
    network = resolve_network(load_config(), "none")
    assert network_capacity(network, 0).rate_kbps(0) == math.inf


def test_the_path_of_a_trace_is_a_network_that_follows_it_from_the_epoch(tmp_path, monkeypatch):
    (tmp_path / "mine.csv").write_text("t_ms,kbps\n0,100\n10,200\n")
    monkeypatch.chdir(tmp_path)
    network = resolve_network(load_config(), "mine.csv")
    assert Path(network.trace) == tmp_path / "mine.csv"
    assert (network.latency_ms, network.loss) == (0, 0)
    capacity = network_capacity(network, 77)
    assert [capacity.rate_kbps(77 + ms * NS_PER_MS) for ms in (0, 10, 20)] == [100, 200, 100]


def test_a_trace_of_the_configuration_folder_is_found_from_anywhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    network = resolve_network(load_config(), "traces/step.csv")
    assert Path(network.trace) == CONFIG_DIRECTORY / "traces" / "step.csv"


def test_a_configured_network_keeps_its_delay_and_takes_its_rate_from_the_trace():
    config = load_config(
        None, {"networks.lte": {"latency_ms": 30, "rate_kbps": 9, "trace": "traces/step.csv"}}
    )
    network = resolve_network(config, "lte")
    assert network.latency_ms == 30
    assert network_capacity(network, 0).rate_kbps(0) == 12_000


@pytest.mark.parametrize("name", ["s9", "x" * 5000])
def test_an_unknown_name_lists_the_valid_ones(name):
    with pytest.raises(ConfigError, match="is not one of s1, s2, s3, none"):
        resolve_network(load_config(), name)


def test_a_missing_trace_is_refused_by_its_key():
    for gone in ("/nope", "y" * 5000):
        config = load_config(None, {"networks.s9": {"trace": gone}})
        with pytest.raises(ConfigError, match=rf"^networks\.s9\.trace: there is no file {gone}$"):
            resolve_network(config, "s9")


def test_a_wrong_trace_is_refused_at_once(tmp_path):
    (tmp_path / "bad.csv").write_text("t_ms,kbps\n0,x\n")
    with pytest.raises(ConfigError, match=r"bad\.csv, line 2"):
        resolve_network(load_config(), str(tmp_path / "bad.csv"))
