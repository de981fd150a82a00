"""The page of a session on the command line: where it may be served, its link, its browser."""

from __future__ import annotations

import html
import os
import ssl
import webbrowser
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from tams_app.config import Config
from tams_app.errors import ConfigError
from tams_app.faces.display import has_display
from tams_app.link.addresses import addresses_of, is_loopback
from tams_app.link.gateway_client import Endpoint
from tams_app.link.page_client import Page, PagePlace
from tams_app.printing import Console
from tams_app.session.session import Session
from tams_app.telemetry.gate import Address

HERE = PagePlace("127.0.0.1", 0, is_loopback=True)  # any free port
_ANYWHERE = ("0.0.0.0", "::")
_OPENED = "open-page.html"


def by_page(config: Config, moves: bool) -> Config:
    """The configuration of a session in this process whose operator has a page.

    `moves`: a real arm. ConfigError for what a page does not do.
    """
    _refuse_real_arm("--hand page", moves)
    if config.view.predict != "off":
        raise ConfigError("--predict: the page shows frames as received; leave it out")
    if config.headless:
        raise ConfigError("--headless: nothing is shown but the page; leave it out")
    video, quality = config.video, config.video.quality.model_copy(update={"enabled": False})
    video = video.model_copy(update={"quality": quality})
    controller = config.controller.model_copy(update={"device": "auto"})
    changed = {"controller": controller, "headless": True, "video": video}
    return config.model_copy(update=changed)


def place_of(
    page: str | None, certificate: Path | None, endpoint: Endpoint, moves: bool
) -> PagePlace | None:
    """Where the page of `robot` is served; ConfigError where it cannot or must not be.

    `endpoint`: where operators call. `moves`: a real arm.
    """
    if page is None:
        if certificate is not None:
            raise ConfigError("--page-cert: is for --page HOST:PORT; leave it out")
        return None
    _refuse_real_arm("--page", moves)
    at = Address.of(page.lower(), "--page", "192.168.1.20:8443")  # as browsers name it
    try:
        _, addresses = addresses_of(at.host, at.port)
        _, doors = addresses_of(endpoint.host, endpoint.port)
    except (OSError, UnicodeError) as error:
        raise ConfigError(f"--page: {at.host} is not known: give a name or an address") from error
    if at.host in _ANYWHERE:
        raise ConfigError(f"--page: {at.host} is no address to call: give the one for browsers")
    is_here = all(map(is_loopback, addresses))
    if not is_here and all(map(is_loopback, doors)):
        raise ConfigError("--page: browsers elsewhere do not reach --listen on loopback")
    if certificate is not None:
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate)
        except OSError as error:
            raise ConfigError(
                f"--page-cert: {certificate}: is no PEM file of a certificate and its key"
            ) from error
    return PagePlace(at.host, at.port, is_here, certificate)


def _refuse_real_arm(option: str, moves: bool) -> None:
    if moves:
        raise ConfigError(
            f"{option}: no page has been tried with a real arm yet: give --sim or --dry-run, or "
            "drive with `operate` or another --hand"
        )


@contextmanager
def offered(
    opening: AbstractContextManager[Session], page: Page, folder: Path, opens: bool
) -> Iterator[Session]:
    """Open the session, and print its link, for the terminal alone: who has it may drive.

    `opens`: open it in a browser, if there is a display. `folder`: the session's.
    """
    with opening as session:
        console = Console()
        console.print(f"drive from a browser: {page.link}", soft_wrap=True)
        if page.fingerprint:
            console.print(
                "the browser warns of the page's certificate, which is self-signed; its SHA-256 "
                f"must be {page.fingerprint}",
                soft_wrap=True,
            )
        shown = folder / _OPENED
        try:
            if opens and has_display():
                _open(page.link, shown)
            yield session
        finally:
            shown.unlink(missing_ok=True)


def _open(link: str, shown: Path) -> None:
    """By a file that leads there: the words of a command can be read by others here."""
    with os.fdopen(os.open(shown, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        target = html.escape(f"0;url={link}", quote=True)
        file.write(f'<!doctype html><meta http-equiv="refresh" content="{target}">')
    webbrowser.open(shown.resolve().as_uri())
