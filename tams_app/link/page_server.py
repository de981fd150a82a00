"""The helper process that serves the page: its files, and what it must know of the robot's door.

Everything is read at the start and served from memory: no name of a request reaches a file. What is
served is no secret; the link's code, which is, comes to no server (RFC 3986, 3.5: fragments).

Specification: host, port, certificate (PEM file with its key, "" for one of its own, null for plain
HTTP), names (by which browsers may call it) and tables. Sent on the way: what the door is.
"""

from __future__ import annotations

import json
import socket
import ssl
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

from tams_app.link.certificate import leaf
from tams_app.link.webtransport import PATH
from tams_app.runtime.process import HelperSide

FILES = Path(__file__).resolve().parents[1] / "page"
CONNECTIONS, CONNECTIONS_OF_ONE = 64, 16  # at once, together and from one address
LONGEST_S = 10.0  # for which a connection may last
_KINDS = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
}
_JSON = "application/json"
_POLICY = (
    "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; img-src data:; "
    "connect-src 'self' {door}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = (
    ("cache-control", "no-store"),
    ("cross-origin-opener-policy", "same-origin"),
    ("cross-origin-resource-policy", "same-origin"),
    ("referrer-policy", "no-referrer"),
    ("x-content-type-options", "nosniff"),
)


def page_files(folder: Path) -> dict[str, tuple[str, bytes]]:
    """Kind and content of each file of the page, by the path of its URL."""
    found = {
        f"/{path.relative_to(folder).as_posix()}": (_KINDS[path.suffix], path.read_bytes())
        for path in sorted(folder.rglob("*"))
        if path.suffix in _KINDS and path.is_file()
    }
    return found | {"/": found["/index.html"]}


class Server(ThreadingHTTPServer):
    """Answers GET and HEAD, each connection in a thread that does not live long."""

    daemon_threads = True
    timeout = 0.05  # [s] of `handle_request`

    def __init__(
        self,
        place: tuple[int, tuple[Any, ...]],
        names: Sequence[str],
        files: Mapping[str, tuple[str, bytes]],
        tls: ssl.SSLContext | None = None,
    ) -> None:
        """Listen at `place`, family and address; OSError if that is impossible.

        `names`: by which browsers call, without the port. `files`: of `page_files`. `tls`: None:
        plain HTTP. `origins`: of the page, as browsers name them.
        """
        self.address_family, address = place
        self.files, self.policy = dict(files), _POLICY.format(door="")
        self._tls = tls
        self._lock = threading.Lock()
        self._open: dict[Any, tuple[str, float]] = {}  # address and begin of each connection
        super().__init__(address, _Handler)
        port = self.server_address[1]
        scheme, usual = ("http", 80) if tls is None else ("https", 443)
        suffix = "" if port == usual else f":{port}"  # which browsers leave out
        self.hosts = [f"[{name}]{suffix}" if ":" in name else name + suffix for name in names]
        self.origins = [f"{scheme}://{host}" for host in self.hosts]

    def show_door(self, door: Mapping[str, str]) -> None:
        """Serve where and what the robot's door is now."""
        self.files["/door.json"] = (_JSON, json.dumps(door).encode())
        self.policy = _POLICY.format(door=door["url"].removesuffix(PATH))

    def verify_request(self, request: Any, client_address: Any) -> bool:
        with self._lock:
            of_one = Counter(host for host, _ in self._open.values())[client_address[0]]
            if len(self._open) >= CONNECTIONS or of_one >= CONNECTIONS_OF_ONE:
                return False
            self._open[request] = (client_address[0], time.monotonic())
        return True

    def finish_request(self, request: Any, client_address: Any) -> None:
        with suppress(OSError):  # the browser left, or was too slow
            request.settimeout(LONGEST_S)
            if self._tls is None:
                super().finish_request(request, client_address)
                return
            with self._tls.wrap_socket(request.dup(), server_side=True) as wrapped:
                super().finish_request(wrapped, client_address)

    def shutdown_request(self, request: Any) -> None:
        with self._lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def end_old(self) -> None:
        """End what has lasted too long, whatever it does meanwhile."""
        now_s = time.monotonic()
        with self._lock:
            for request, (_, began_s) in self._open.items():
                if now_s - began_s > LONGEST_S:
                    with suppress(OSError):  # it has ended
                        request.shutdown(socket.SHUT_RDWR)


class _Handler(BaseHTTPRequestHandler):
    """One request."""

    server: Server
    server_version, sys_version = "TAMS", ""

    def do_GET(self) -> None:
        self._send(has_body=True)

    def do_HEAD(self) -> None:
        self._send(has_body=False)

    def _send(self, has_body: bool) -> None:
        if self.headers.get_all("host", []) not in [[host] for host in self.server.hosts]:
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST)
            return
        found = self.server.files.get(self.path.partition("?")[0])
        if found is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        kind, content = found
        self.send_response(HTTPStatus.OK)
        self.send_header("content-type", kind)
        self.send_header("content-length", str(len(content)))
        self.end_headers()
        if has_body:
            self.wfile.write(content)

    def end_headers(self) -> None:
        for name, value in (*_HEADERS, ("content-security-policy", self.server.policy)):
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are nobody's affair."""


def tls_of(file: str) -> tuple[ssl.SSLContext, str]:
    """TLS with the certificate in `file`, "" for a new one that signs itself; its SHA-256 if so.

    OSError (of which ssl.SSLError is one) if the file cannot be used.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    if file:
        context.load_cert_chain(file)
        return context, ""
    own = leaf(None, time.time())
    with tempfile.NamedTemporaryFile() as pem:  # mode 0600; the library reads no memory
        pem.write(own.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
        pem.write(own.certificate.public_bytes(Encoding.PEM))
        pem.flush()
        context.load_cert_chain(pem.name)
    return context, sha256(own.der).digest().hex(":").upper()


def _server(specification: Mapping[str, Any]) -> tuple[Server, str]:
    """The server that is asked for, and the SHA-256 of a certificate of its own, else ""."""
    host, port, given = (specification[name] for name in ("host", "port", "certificate"))
    tls, fingerprint = (None, "") if given is None else tls_of(given)
    family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    files = page_files(FILES)
    files["/tables.json"] = (_JSON, json.dumps(specification["tables"]).encode())
    return Server((int(family), address), specification["names"], files, tls), fingerprint


def main() -> None:
    """The helper's main function."""
    side = HelperSide()
    try:
        server, fingerprint = _server(side.specification)
    except OSError as error:
        host, port = side.specification["host"], side.specification["port"]
        side.fail(f"--page: {host}:{port} cannot be used: {error.strerror or error}")
        return
    with server:
        side.ready(origins=server.origins, fingerprint=fingerprint)
        while not side.stop_requested.is_set():
            server.handle_request()
            server.end_old()
            if side.received:
                server.show_door(side.received)


if __name__ == "__main__":
    main()
