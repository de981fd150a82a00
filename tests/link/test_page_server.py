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
from http.client import HTTPConnection, HTTPResponse, HTTPSConnection
from pathlib import Path

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


@pytest.fixture
def serving() -> Iterator[Callable[..., Server]]:
    """Starts servers, which are turned by a thread as the helper does it."""
    with ExitStack() as stack:

        def start(tls: ssl.SSLContext | None = None) -> Server:
            place = (int(socket.AF_INET), (HERE, 0))
            files = page_files(FILES) | {"/tables.json": ("application/json", b"{}")}
            server = stack.enter_context(Server(place, frozenset({HERE, "localhost"}), files, tls))
            server.door, ended = json.dumps(DOOR), threading.Event()

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


def port_of(server: Server) -> int:
    return int(server.server_address[1])


def asked(server: Server, path: str, method: str = "GET", host: str = "") -> HTTPResponse:
    connection = HTTPConnection(HERE, port_of(server), timeout=WITHIN_S)
    connection.putrequest(method, path, skip_host=True)
    connection.putheader("host", host or f"{HERE}:{port_of(server)}")
    connection.endheaders()
    response = connection.getresponse()
    response.content = response.read()  # type: ignore[attr-defined]
    return response


def test_every_file_of_the_page_is_served_as_what_it_is(serving: Callable[..., Server]) -> None:
    server = serving()
    for path in ("/", "/index.html", "/main.js", "/style.css", "/receive/rtp.js"):
        answer = asked(server, path)
        file = FILES / (path[1:] or "index.html")
        assert (answer.status, answer.content) == (200, file.read_bytes())  # type: ignore[attr-defined]
        kind = {".js": "text/javascript", ".css": "text/css", ".html": "text/html"}[file.suffix]
        assert answer.getheader("content-type") == f"{kind}; charset=utf-8"
    assert json.loads(asked(server, "/door.json").content) == DOOR  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "path",
    [
        *("/package.json", "/receive", "/receive/", "/nothing.js", "*", "index.html"),
        *("/../link/keys.py", "/receive/../../link/keys.py", "/%2e%2e/link/keys.py"),
        *("/..%2flink%2fkeys.py", "/main.js/", "/main.js%00", "/MAIN.JS", "http://elsewhere/"),
    ],
)
def test_nothing_else_is_served(serving: Callable[..., Server], path: str) -> None:
    assert asked(serving(), path).status in (400, 404)


@pytest.mark.parametrize("host", ["robot", "127.0.0.1", "localhost:1", "127.0.0.1.evil.example"])
def test_another_host_is_answered_by_nothing_of_the_page(
    serving: Callable[..., Server], host: str
) -> None:
    """A foreign name that leads here would give its owner's pages our origin's rights."""
    answer = asked(serving(), "/door.json", host=host)
    assert answer.status == 421
    assert b"operate" not in answer.content  # type: ignore[attr-defined]


def test_localhost_is_this_computer_as_well(serving: Callable[..., Server]) -> None:
    server = serving()
    assert asked(server, "/", host=f"localhost:{port_of(server)}").status == 200
    assert server.origins == [f"http://{host}:{port_of(server)}" for host in (HERE, "localhost")]


def test_only_reading_is_possible(serving: Callable[..., Server]) -> None:
    server = serving()
    head = asked(server, "/main.js", "HEAD")
    assert (head.status, head.content) == (200, b"")  # type: ignore[attr-defined]
    for method in ("POST", "PUT", "DELETE", "OPTIONS", "TRACE", "CONNECT", "get"):
        assert asked(server, "/main.js", method).status == 501


@pytest.mark.parametrize("path", ["/", "/worker.js", "/door.json", "/nothing"])
def test_every_answer_forbids_what_the_page_does_not_need(
    serving: Callable[..., Server], path: str
) -> None:
    answer = asked(serving(), path)
    policy = dict(
        part.split(" ", 1) for part in answer.headers["content-security-policy"].split("; ")
    )
    assert policy["default-src"] == policy["frame-ancestors"] == policy["base-uri"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["worker-src"] == "'self'"
    assert policy["connect-src"] == "'self' https://127.0.0.1:7300"
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["referrer-policy"] == "no-referrer"
    assert answer.headers["cache-control"] == "no-store"


def test_the_page_has_nothing_that_its_policy_forbids() -> None:
    text = (FILES / "index.html").read_text()
    assert "style=" not in text
    assert all(text.count(f" on{event}=") == 0 for event in ("click", "load", "error"))
    assert text.count("<script") == text.count('<script type="module" src=')


def test_who_is_slow_is_cut_off_and_keeps_nobody_out(
    serving: Callable[..., Server], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_server, "LONGEST_S", 0.5)
    server = serving()
    slow = [
        socket.create_connection((HERE, port_of(server)), WITHIN_S)
        for _ in range(CONNECTIONS_OF_ONE)
    ]
    for one in slow:
        one.sendall(b"GET / HTTP/1.1\r\nx: ")
    for one in slow:
        assert one.recv(1000) == b""  # it ends by itself
        one.close()
    assert asked(server, "/").status == 200


def test_one_address_has_so_many_connections_at_once(serving: Callable[..., Server]) -> None:
    server = serving()
    with ExitStack() as stack:
        many = [
            stack.enter_context(socket.create_connection((HERE, port_of(server)), WITHIN_S))
            for _ in range(CONNECTIONS_OF_ONE + 1)
        ]
        assert many[-1].recv(1000) == b""
    for _ in range(200):  # until it has noticed that they left
        try:
            assert asked(server, "/").status == 200
            return
        except ConnectionError:
            continue
    pytest.fail("the page is never served again")


def test_a_certificate_of_its_own_is_the_one_whose_hash_is_printed(
    serving: Callable[..., Server],
) -> None:
    tls, fingerprint = tls_of("", "192.168.1.20")
    server = serving(tls)
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    connection = HTTPSConnection(HERE, port_of(server), timeout=WITHIN_S, context=context)
    connection.request("GET", "/", headers={"host": f"{HERE}:{port_of(server)}"})
    assert isinstance(connection.sock, ssl.SSLSocket)
    shown = connection.sock.getpeercert(binary_form=True)
    assert shown is not None
    assert fingerprint == sha256(shown).digest().hex(":").upper()
    assert connection.getresponse().read() == (FILES / "index.html").read_bytes()
    assert server.origins[0] == f"https://{HERE}:{port_of(server)}"
    with pytest.raises(OSError, match=r"\[SSL\]|PEM"):
        tls_of(str(FILES / "index.html"), "robot")


def test_the_page_is_told_where_the_door_is_and_of_each_new_certificate(tmp_path: Path) -> None:
    with ExitStack() as stack:
        gateway = Gateway("robot", Endpoint(HERE, 0, None), b"welcome", tmp_path)
        stack.callback(gateway.close)
        page = Page(PagePlace(HERE, 0, is_loopback=True), {"version": "1"})
        gateway.launch()
        page.launch(tmp_path)
        stack.callback(page.close)
        gateway.wait_ready()
        page.wait_ready()
        page.let_in(gateway, is_alone=True)
        origin, code = page.link.split("/#")
        assert len(code) == 22
        for certificate in (b"first", b"second"):
            page.follow(certificate)
            shown = sha256(certificate).digest().hex()
            door = _door(origin, shown)
            assert door["url"] == f"https://{HERE}:{gateway.port}/operate"
        page.follow(b"")  # nothing is known: what was shown stays
        assert _door(origin, shown) == door


def _door(origin: str, shown: str) -> dict[str, str]:
    """What the page reads, once it has this certificate."""
    host = origin.removeprefix("http://")
    while True:
        connection = HTTPConnection(host, timeout=WITHIN_S)
        connection.request("GET", "/door.json")
        answer = connection.getresponse()
        if answer.status == 200:
            door: dict[str, str] = json.loads(answer.read())
            if b64decode(door["certificate"]).hex() == shown:
                return door


def test_an_address_that_is_taken_is_said_in_one_sentence(tmp_path: Path) -> None:
    with socket.create_server((HERE, 0)) as taken:
        page = Page(PagePlace(HERE, taken.getsockname()[1], is_loopback=True), {})
        page.launch(tmp_path)
        with pytest.raises(HelperError, match=r"^--page: 127\.0\.0\.1:\d+ cannot be used: "):
            page.wait_ready()
        page.close()
