"""A browser's connection: HTTP/3 (RFC 9114) with one WebTransport session (draft-ietf-webtrans-02).

The session is the connection's first request, on stream 0. Its datagrams are those of the link, and
the first stream that the browser opens in it is the one on which a code is proved.
"""

from __future__ import annotations

from aioquic.h3.connection import H3_ALPN, H3Connection
from aioquic.h3.events import H3Event, HeadersReceived
from aioquic.quic.events import ProtocolNegotiated, QuicEvent, StreamDataReceived, StreamReset

from tams_app.link.certificate import Leaf
from tams_app.link.quic import STREAM_BYTES, Came, Connection, answering

PATH = "/operate"
_SESSION = 0  # the stream of its request
_QUARTER = b"\0"  # before each datagram: of which session it is (RFC 9297, 2.1)
_OPENING = b"\x40\x41\0"  # before what is said on a stream of the session
_BIDIRECTIONAL = 4  # every fourth stream is the client's, and goes both ways


class PageConnection(Connection):
    """The robot's side of it; `Came.begun`: the page has opened the stream."""

    def __init__(
        self, leaf: Leaf, original: bytes, retry: bytes, origins: frozenset[bytes]
    ) -> None:
        """As of `Connection.called`. `origins`: of the pages that may have a session."""
        super().__init__(answering(leaf, original, retry, H3_ALPN))
        self._datagram_head = _QUARTER
        self._stream = _SESSION  # until there is one to prove a code on
        self._origins = origins
        self._http: H3Connection | None = None
        self._was_asked = self._has_session = False
        self._head = b""
        self._came_bytes = 0

    def _take(self, event: QuicEvent, came: Came) -> None:
        match event:
            case ProtocolNegotiated():
                self._http = H3Connection(self._quic, enable_webtransport=True)
            case StreamDataReceived():
                self._came_bytes += len(event.data)
                is_over = event.end_stream and event.stream_id in (_SESSION, self._stream)
                self.ended = self.ended or is_over or self._came_bytes > STREAM_BYTES
                if self._is_of_proof(event.stream_id):
                    self._stream = event.stream_id
                    self._read(event.data, came)
                else:
                    self._ask(event)
            case StreamReset():
                self.ended = True
            case _:
                super()._take(event, came)

    def _is_of_proof(self, stream: int) -> bool:
        is_first = self._stream in (_SESSION, stream)
        return self._has_session and is_first and stream > 0 and stream % _BIDIRECTIONAL == 0

    def _read(self, content: bytes, came: Came) -> None:
        """Of the stream: what opens it, and what is said after that."""
        if len(self._head) == len(_OPENING):
            came.stream += content
            return
        content = self._head + content
        self._head = content[: len(_OPENING)]
        came.stream += content[len(_OPENING) :]
        came.begun = self._head == _OPENING
        self.ended = self.ended or not _OPENING.startswith(self._head)

    def _ask(self, event: StreamDataReceived) -> None:
        """Of any other stream: the request for a session, and what HTTP/3 needs for it."""
        events: list[H3Event] = []
        try:
            if self._http is not None and not self.ended:
                events = self._http.handle_event(event)
        except Exception:  # noqa: BLE001 - as in `receive`: who makes errors of parsers is dropped
            self.ended = True
            self.counts["not sound"] += 1
        for one in events:
            if isinstance(one, HeadersReceived) and not self._was_asked:
                self._was_asked = True
                self._answer(one.stream_id, dict(one.headers))
        self.ended = self.ended or self._is_closed

    def _answer(self, stream: int, headers: dict[bytes, bytes]) -> None:
        """To the one request."""
        assert self._http is not None
        asked = (headers.get(b":method"), headers.get(b":protocol"), headers.get(b":path"))
        status = b"404"
        if stream == _SESSION and asked == (b"CONNECT", b"webtransport", PATH.encode()):
            self._has_session = headers.get(b"origin") in self._origins
            status = b"200" if self._has_session else b"403"
        answer = [(b":status", status), (b"sec-webtransport-http3-draft", b"draft02")]
        self._http.send_headers(stream, answer, end_stream=not self._has_session)
