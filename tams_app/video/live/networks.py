"""Uplink conditions by name or trace file, and the capacity of their bottleneck."""

from __future__ import annotations

from pathlib import Path

from tams_app.capacity import (
    Capacity,
    ConstantCapacity,
    RateTrace,
    TraceCapacity,
    UnlimitedCapacity,
)
from tams_app.config import CONFIG_DIRECTORY, Config, Network
from tams_app.errors import ConfigError, not_one_of
from tams_app.video.live.traces import parse_trace


def resolve_network(config: Config, name: str) -> Network:
    """The condition `name`, or for a trace's path one with that trace and nothing else.

    A trace is looked for from the working directory, then from `config/`, and is read once so
    that a wrong one is reported now; `trace` is absolute in the result. ConfigError lists the
    valid names.
    """
    network = config.networks.get(name)
    if network is None:
        if _find(name) is None:
            raise ConfigError(
                f"network: no such trace file, and {not_one_of(name, config.networks)}"
            )
        network = Network(trace=name)
    if network.trace is None:
        return network
    path = _find(network.trace)
    if path is None:
        raise ConfigError(f"networks.{name}.trace: there is no file {network.trace}")
    read_trace(path)
    return network.model_copy(update={"trace": str(path)})


def network_capacity(network: Network, epoch_ns: int) -> Capacity:
    """The capacity of `network`'s bottleneck; a trace begins at `epoch_ns`."""
    if network.trace is not None:
        return TraceCapacity(read_trace(Path(network.trace)), epoch_ns)
    if network.rate_kbps is not None:
        return ConstantCapacity(network.rate_kbps)
    return UnlimitedCapacity()


def read_trace(path: Path) -> RateTrace:
    """The trace in `path`; ConfigError names file, line and reason."""
    try:
        text = path.read_text(encoding="utf-8-sig")  # spreadsheets write a byte order mark
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not a text file, so it is no capacity trace") from error
    return parse_trace(text, str(path))


def _find(name: str) -> Path | None:
    candidates = (Path(name), CONFIG_DIRECTORY / name)
    try:
        return next((path.resolve() for path in candidates if path.is_file()), None)
    except OSError:  # too long to be a path, or below a folder that may not be read
        return None
