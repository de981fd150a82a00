"""From a network's name to its conditions and capacity."""

import math
from pathlib import Path

import pytest

from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.errors import ConfigError
from tams_app.units import NS_PER_MS
from tams_app.video.live.networks import network_capacity, resolve_network

pytestmark = pytest.mark.untimed


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
