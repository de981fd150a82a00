"""What serves the page: which requests it answers, with what, and for how long."""

from __future__ import annotations

import json
import socket
import ssl
import threading
from base64 import b64decode
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from hashlib import sha256
from http.client import HTTPConnection, HTTPMessage, HTTPSConnection
from pathlib import Path
from typing import NamedTuple

import pytest

from tams_app.errors import HelperError
from tams_app.link import page_server
from tams_app.link.gateway_client import Endpoint, Gateway
from tams_app.link.page_client import Page, PagePlace
from tams_app.link.page_server import CONNECTIONS_OF_ONE, FILES, Server, page_files, tls_of

pytestmark = pytest.mark.waiting

HERE = "127.0.0.1"
WITHIN_S = 20.0
DOOR = {"url": "https://127.0.0.1:7300/operate", "certificate": "Q0VSVA==", "identity": "SUQ="}
Serving = Callable[..., Server]


@pytest.fixture
def serving() -> Iterator[Serving]:
    """Starts servers, which are turned by a thread as the helper does it."""
    with ExitStack() as stack:

        def start(tls: ssl.SSLContext | None = None) -> Server:
            place = (int(socket.AF_INET), (HERE, 0))
            server = Server(place, (HERE, "localhost"), page_files(FILES), tls)
            stack.enter_context(server).show_door(DOOR)
            ended = threading.Event()

            def turn() -> None:
                while not ended.is_set():
                    server.handle_request()
                    server.end_old()

            thread = threading.Thread(target=turn)
            thread.start()
            stack.callback(thread.join)
            stack.callback(ended.set)
            return server

        yield start


class Answer(NamedTuple):
    status: int
    headers: HTTPMessage
    content: bytes


def asked(origin: str, path: str, method: str = "GET", host: str = "") -> Answer:
    scheme, _, at = origin.partition("://")
    made = HTTPConnection(at, timeout=WITHIN_S)
    if scheme == "https":
        made = HTTPSConnection(at, timeout=WITHIN_S, context=ssl._create_unverified_context())
    made.putrequest(method, path, skip_host=True)
    made.putheader("host", host or at)
    made.endheaders()
    response = made.getresponse()
    return Answer(response.status, response.headers, response.read())


def test_every_file_of_the_page_is_served_as_what_it_is(serving: Serving) -> None:
    origin = serving().origins[0]
    kinds = {".js": "text/javascript", ".css": "text/css", ".html": "text/html"}
    for path in ("/", "/index.html", "/main.js?v=1", "/style.css", "/receive/rtp.js"):
        file = FILES / (path[1:].partition("?")[0] or "index.html")
        status, headers, content = asked(origin, path)
        assert (status, content) == (200, file.read_bytes())
        assert headers["content-type"] == f"{kinds[file.suffix]}; charset=utf-8"
    assert json.loads(asked(origin, "/door.json").content) == DOOR


def test_nothing_else_is_served_and_nothing_is_taken(serving: Serving) -> None:
    origin = serving().origins[0]
    for path in (
        *("/package.json", "/receive", "/receive/", "/nothing.js", "*", "index.html", "/MAIN.JS"),
        *("/../link/keys.py", "/receive/../../link/keys.py", "/%2e%2e/link/keys.py"),
        *("/..%2flink%2fkeys.py", "/main.js/", "/main.js%00", "http://elsewhere/"),
    ):
        assert asked(origin, path).status in (400, 404)
    for method in ("POST", "PUT", "DELETE", "OPTIONS", "TRACE", "CONNECT", "get"):
        assert asked(origin, "/main.js", method).status == 501
    head = asked(origin, "/main.js", "HEAD")
    assert (head.status, head.content) == (200, b"")


def test_a_foreign_name_that_leads_here_is_answered_by_nothing_of_the_page(
    serving: Serving,
) -> None:
    first, second = serving().origins
    for host in ("robot", HERE, "localhost:1", f"{HERE}.evil.example"):
        answer = asked(first, "/door.json", host=host)
        assert answer.status == 421
        assert b"operate" not in answer.content
    assert asked(first, "/", host=second.removeprefix("http://")).status == 200


@pytest.mark.parametrize("path", ["/", "/worker.js", "/door.json", "/nothing"])
def test_every_answer_forbids_what_the_page_does_not_need(serving: Serving, path: str) -> None:
    headers = asked(serving().origins[0], path).headers
    parts = headers["content-security-policy"].split("; ")
    policy = dict(part.split(" ", 1) for part in parts)
    assert policy["default-src"] == policy["frame-ancestors"] == policy["base-uri"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["worker-src"] == "'self'"
    assert policy["connect-src"] == "'self' https://127.0.0.1:7300"
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"


def test_who_is_slow_or_takes_many_connections_keeps_nobody_out_for_long(
    serving: Serving, monkeypatch: pytest.MonkeyPatch
) -> None:
    server = serving()
    with ExitStack() as stack:
        slow = [
            stack.enter_context(socket.create_connection((HERE, server.server_port), WITHIN_S))
            for _ in range(CONNECTIONS_OF_ONE + 1)
        ]
        slow[-1].settimeout(page_server.LONGEST_S / 2)
        assert slow.pop().recv(1000) == b""  # one too many
        monkeypatch.setattr(page_server, "LONGEST_S", 0.5)
        for one in slow:
            one.settimeout(0.1)
            while not _has_ended(one):
                one.sendall(b"GET")  # never idle, and never a request
    while server._open:
        pass
    assert asked(server.origins[0], "/").status == 200


def _has_ended(one: socket.socket) -> bool:
    try:
        return one.recv(1000) == b""
    except TimeoutError:
        return False


def test_a_certificate_of_its_own_is_the_one_whose_hash_is_printed(serving: Serving) -> None:
    tls, fingerprint = tls_of("")
    server = serving(tls)
    shown = ssl.PEM_cert_to_DER_cert(ssl.get_server_certificate((HERE, server.server_port)))
    assert fingerprint == sha256(shown).digest().hex(":").upper()
    assert server.origins[0] == f"https://{HERE}:{server.server_port}"
    assert asked(server.origins[0], "/").content == (FILES / "index.html").read_bytes()


def test_the_page_is_told_where_the_door_is_and_of_each_new_certificate(tmp_path: Path) -> None:
    gateway = Gateway("robot", Endpoint(HERE, 0, None), b"welcome", tmp_path)
    page = Page(PagePlace(HERE, 0, is_loopback=True), {"version": "1"})
    with ExitStack() as stack:
        stack.callback(gateway.close)
        gateway.launch()
        page.launch(tmp_path)
        stack.callback(page.close)
        gateway.wait_ready()
        page.wait_ready()
        page.let_in(gateway, is_alone=True)
        origin, code = page.link.split("/#")
        assert len(code) == 22
        assert asked(origin, "/tables.json").content == b'{"version": "1"}'
        for certificate in (b"first", b"second"):
            page.follow(certificate)
            page.follow(b"")  # not known: what was shown stays
            while (answer := asked(origin, "/door.json")).status == 404 or b64decode(
                json.loads(answer.content)["certificate"]
            ) != sha256(certificate).digest():
                pass
            door = json.loads(answer.content)
            assert door["url"] == f"https://{HERE}:{gateway.port}/operate"
            assert b64decode(door["identity"]) == gateway.identity


def test_an_address_that_is_taken_is_said_in_one_sentence(tmp_path: Path) -> None:
    with socket.create_server((HERE, 0)) as taken:
        page = Page(PagePlace(HERE, taken.getsockname()[1], is_loopback=True), {})
        page.launch(tmp_path)
        with pytest.raises(HelperError, match=r"^--page: 127\.0\.0\.1:\d+ cannot be used: "):
            page.wait_ready()
        page.close()
