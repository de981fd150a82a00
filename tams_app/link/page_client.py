"""The application's side of the page: the process that serves it, its link, and who may call."""

from __future__ import annotations

import base64
import secrets
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from tams_app.link.addresses import named
from tams_app.link.gateway_client import Gateway, PageAccess
from tams_app.link.pages import CODE_BYTES
from tams_app.link.webtransport import PATH
from tams_app.runtime.process import HelperProcess

_ANYWHERE = ("0.0.0.0", "::")


@dataclass(frozen=True, slots=True)
class PagePlace:
    """Where the page is served, and how.

    certificate: a PEM file with its key; None: one of its own, or plain HTTP if `is_loopback`.
    """

    host: str
    port: int
    is_loopback: bool
    certificate: Path | None = None


class Page:
    """One page server. `launch`, `wait_ready`; `let_in` once, then `follow`; `close`.

    `link`: with the code, for who is to drive alone. `fingerprint`: of a certificate of its own.
    """

    def __init__(self, place: PagePlace, tables: dict[str, Any]) -> None:
        """`tables`: words and figures that the page shows."""
        self.link = self.fingerprint = ""
        self._place, self._tables = place, tables
        self._code = secrets.token_bytes(CODE_BYTES)
        self._origins: tuple[str, ...] = ()
        self._told: dict[str, str] = {}
        self._certificate = b""
        self.process: HelperProcess

    def launch(self, log_directory: Path) -> None:
        """Start the process without waiting."""
        place = self._place
        own = None if place.is_loopback else ""
        specification = {
            "host": place.host,
            "port": place.port,
            "certificate": own if place.certificate is None else str(place.certificate.resolve()),
            "names": [place.host, "localhost"] if place.is_loopback else [place.host],
            "tables": self._tables,
        }
        self.process = HelperProcess(
            "page", "tams_app.link.page_server", specification, log_directory
        )
        self.process.start()

    def wait_ready(self) -> None:
        """Wait until it listens; HelperError if it cannot."""
        ready = self.process.wait_ready()
        self._origins = tuple(ready["origins"])
        self.fingerprint = ready["fingerprint"]
        code = base64.urlsafe_b64encode(self._code).decode().rstrip("=")
        self.link = f"{self._origins[0]}/#{code}"

    def let_in(self, gateway: Gateway, is_alone: bool) -> None:
        """Let the gateway, which is ready, answer this page; `is_alone`: and nobody else."""
        gateway.let_in(PageAccess(self._code, self._origins, is_alone))
        host = self._place.host if gateway.host in _ANYWHERE else gateway.host
        self._told = {
            "url": f"https://{named((host, gateway.port))}{PATH}",
            "identity": base64.b64encode(gateway.identity).decode(),
        }

    def follow(self, certificate: bytes) -> None:
        """Tell the page which certificate the door shows now; DER, b"" if it is not known yet."""
        if not certificate or certificate == self._certificate:  # asked in every control tick
            return
        self._certificate = certificate
        self._told["certificate"] = base64.b64encode(sha256(certificate).digest()).decode()
        self.process.send(**self._told)

    def close(self) -> None:
        """End the process."""
        self.process.stop()
