"""What Prometheus reads of a session."""

from __future__ import annotations

import socket
from urllib.request import ProxyHandler, build_opener

from prometheus_client.parser import text_string_to_metric_families


def free_port() -> int:
    """A port of this computer that nobody listens at now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


_DIRECT = build_opener(ProxyHandler({}))


def scrape(address: str) -> dict[tuple[str, ...], float]:
    """The value of each sample by its name and its labels' values; OSError if nobody answers."""
    with _DIRECT.open(f"http://{address}/metrics", timeout=5) as answer:
        text = answer.read().decode("utf-8")
    return {
        (sample.name, *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }
