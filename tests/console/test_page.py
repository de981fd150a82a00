"""Where a page may be served, as the command line says it in one sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.console.page import by_page, place_of
from tams_app.errors import ConfigError
from tams_app.link.certificate import leaf
from tams_app.link.gateway_client import Endpoint
from tams_app.link.page_client import PagePlace

pytestmark = pytest.mark.untimed

HERE, LAN = "127.0.0.1:8443", "192.0.2.20:8443"
ROBOT = ("robot", "--listen", "127.0.0.1:7300")
Tams = Callable[..., tuple[int, str, str]]
Begun = list[tuple[Any, ...]]


@pytest.fixture
def certificate(tmp_path: Path) -> Path:
    own, path = leaf(None, 1.8e9), tmp_path / "page.pem"
    key = own.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    path.write_bytes(key + own.certificate.public_bytes(Encoding.PEM))
    return path


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> Begun:
    """The sessions that would have begun."""
    found: Begun = []
    monkeypatch.setattr("tams_app.console.app.run_robot", lambda *given: found.append(given))
    return found


@pytest.mark.parametrize(
    ("page", "listen", "moves", "sentence"),
    [
        ("0.0.0.0:8443", "192.0.2.20", False, "is no address to call"),
        ("[::]:8443", "192.0.2.20", False, "is no address to call"),
        (LAN, "127.0.0.1", False, "browsers elsewhere do not reach --listen on loopback"),
        (LAN, "192.0.2.20", True, "no page has been tried with a real arm"),
        (HERE, "127.0.0.1", True, "no page has been tried with a real arm"),
        ("no.such.host.invalid:1", "192.0.2.20", False, "is not known"),
        ("192.0.2.20:0", "192.0.2.20", False, "is not HOST:PORT"),
    ],
)
def test_a_place_that_would_not_do_is_refused(
    page: str, listen: str, moves: bool, sentence: str
) -> None:
    with pytest.raises(ConfigError, match=f"^--page: .*{sentence}"):
        place_of(page, None, Endpoint(listen, 7300, None), moves)


@pytest.mark.parametrize(
    ("page", "listen", "is_loopback"),
    [
        (HERE, "127.0.0.1", True),
        (HERE, "0.0.0.0", True),
        ("[::1]:8443", "127.0.0.1", True),
        (LAN, "0.0.0.0", False),
    ],
)
def test_a_place_that_will_do(page: str, listen: str, is_loopback: bool) -> None:
    place = place_of(page, None, Endpoint(listen, 7300, None), moves=False)
    assert place is not None
    assert (place.port, place.is_loopback) == (8443, is_loopback)


def test_a_page_may_have_a_certificate_of_the_laboratory(certificate: Path) -> None:
    place = place_of(LAN, certificate, Endpoint("0.0.0.0", 7300, None), moves=False)
    assert place == PagePlace("192.0.2.20", 8443, False, certificate)


def test_without_a_page_nothing_is_served() -> None:
    assert place_of(None, None, Endpoint("0.0.0.0", 7300, None), moves=True) is None


def test_a_certificate_that_is_none_or_has_no_page_is_refused(
    tmp_path: Path, certificate: Path
) -> None:
    listen = Endpoint("0.0.0.0", 7300, None)
    for wrong in (tmp_path / "nothing.pem", tmp_path, CONFIG_DIRECTORY / "lite6.yaml"):
        with pytest.raises(ConfigError, match=r"^--page-cert: .*: is no PEM file"):
            place_of(HERE, wrong, listen, moves=False)
    with pytest.raises(ConfigError, match=r"^--page-cert: is for --page HOST:PORT"):
        place_of(None, certificate, listen, moves=False)


@pytest.mark.parametrize(
    "options",
    [
        (*ROBOT, "--page-cert", "page.pem"),
        (*ROBOT, "--page", LAN),
        (*ROBOT, "--page", "here"),
        ("run", "--hand", "page", "--predict", "eih"),
        ("run", "--hand", "page", "--headless"),
    ],
)
def test_wrong_use_is_one_sentence(tams: Tams, begun: Begun, options: tuple[str, ...]) -> None:
    code, _, err = tams(*options)
    assert (code, len(err.splitlines()), begun) == (2, 1, [])


def test_run_by_a_page_is_the_robots_side_on_this_computer_with_the_rig(
    tams: Tams, begun: Begun
) -> None:
    assert tams("run", "--hand", "page", "--network", "s3")[0] == 0
    ((config, *given),) = begun
    assert given == [None, False, False, PagePlace("127.0.0.1", 0, is_loopback=True)]
    assert config.rig.enabled
    assert (config.network, config.headless) == ("s3", True)
    assert not config.video.quality.enabled


def test_robot_serves_a_page_beside_its_operators(tams: Tams, begun: Begun) -> None:
    assert tams(*ROBOT, "--page", HERE, "--sim")[0] == 0
    ((_, endpoint, _, _, place),) = begun
    assert endpoint == Endpoint("127.0.0.1", 7300, None)
    assert place == PagePlace("127.0.0.1", 8443, is_loopback=True)


def test_no_page_moves_a_real_arm_not_even_on_its_own_computer() -> None:
    hardware = load_config(CONFIG_DIRECTORY / "lite6.yaml", {"controller.device": "page"})
    with pytest.raises(ConfigError, match=r"^--hand page: no page has been tried with a real arm"):
        by_page(hardware, moves=True)
    dry = by_page(hardware, moves=False)
    assert (dry.controller.device, dry.rig.enabled) == ("auto", False)
