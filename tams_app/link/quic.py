"""One QUIC connection (RFC 9000, by aioquic) as the link needs it: datagrams in, datagrams out.

All that reaches into aioquic is here. Where it sends to is not its affair: it is told one address
for ever, since it follows a packet to a new address before that one has answered. Nothing here
limits a rate: the video's own budget does (RFC 9002 would let it fill queues).
"""

from __future__ import annotations

import hmac
import logging
from collections import Counter
from dataclasses import dataclass, field
from hashlib import sha256
from ssl import CERT_NONE

from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.congestion.base import QuicCongestionControl, register_congestion_control
from aioquic.quic.connection import QuicConnection
from aioquic.quic.crypto import CryptoContext, CryptoError, CryptoPair  # type: ignore[attr-defined]
from aioquic.quic.events import (
    ConnectionIdIssued,
    ConnectionIdRetired,
    DatagramFrameReceived,
    HandshakeCompleted,
    ProtocolNegotiated,
    QuicEvent,
    StreamDataReceived,
)
from aioquic.quic.packet import QuicProtocolVersion, encode_quic_retry
from aioquic.quic.recovery import QuicPacketPacer, QuicPacketSpace
from aioquic.tls import CipherSuite, Epoch
from cryptography import x509

from tams_app.link.addresses import Address
from tams_app.link.certificate import Leaf
from tams_app.units import NS_PER_MS, NS_PER_S

ALPN = "tams/6"
LONGEST_DATAGRAM_BYTES = 1200  # UDP payload; QUIC asks no more of a path (RFC 9000, 14)
ID_BYTES = 8  # of a connection id of ours
# Of a packet with one DATAGRAM frame: first byte, connection id, packet number, tag; type, length.
OVERHEAD_BYTES = 1 + ID_BYTES + 2 + 16 + 1 + 2
SESSION_BYTES = 1  # more of a browser's: the session that it belongs to
LONGEST_CONTENT_BYTES = LONGEST_DATAGRAM_BYTES - OVERHEAD_BYTES - SESSION_BYTES
LONG_HEADER = 0x80
VERSION = int(QuicProtocolVersion.VERSION_1).to_bytes(4)
IDLE_NS = 600 * NS_PER_S  # a connection of which nothing comes is forgotten
_STREAM = 1  # the robot's side begins it (RFC 9000, 2.1): it asks before the handshake is complete
STREAM_BYTES = 16_384  # that the other side may send before it has proved a key
# An acknowledgement waits for a packet that leaves anyway, and needs none of its own where ten a
# second do; that it comes later than the 25 ms of RFC 9000, 18.2, the other side's timers learn.
ACK_WAIT_NS = 95 * NS_PER_MS
_SOMEWHERE = ("", 0)
_SLOT_NS = 5 * NS_PER_S  # a proof of an address is valid for five to ten seconds
_RETRY = b"\x02"
_PROOF_BYTES = 16

# What strangers send makes it warn, and nobody reads that.
logging.getLogger("quic").addHandler(logging.NullHandler())
logging.getLogger("quic").propagate = False


class _Unlimited(QuicCongestionControl):
    """Limits nothing: what is sent is not counted, so the window is never full."""

    def _stay(self, **_: object) -> None:
        pass

    on_packet_acked = on_packet_sent = on_packets_expired = on_packets_lost = _stay
    on_persistent_congestion = on_rtt_measurement = _stay


class _Unpaced(QuicPacketPacer):
    """Delays nothing: no rate is ever known to it."""

    def update_rate(self, congestion_window: int, smoothed_rtt: float) -> None:
        pass


class _Keys(CryptoPair):
    """The keys of a connection, which also opens what the ones before have sealed.

    aioquic forgets them as it changes them, and with them all packets that are on their way.
    """

    def __init__(self, pair: CryptoPair, space: QuicPacketSpace) -> None:
        super().__init__()
        self.recv, self.send = pair.recv, pair.send
        self._update_key_requested = pair._update_key_requested
        self.opened = self.repeated = self.renewals = 0
        self.before: CryptoContext | None = None
        self._received = space.received_packets

    def decrypt_packet(
        self, packet: bytes, encrypted_offset: int, expected_packet_number: int
    ) -> tuple[bytes, bytes, int]:
        given = packet, encrypted_offset, expected_packet_number
        try:
            opened = super().decrypt_packet(*given)
        except CryptoError:
            if self.before is None:
                raise
            opened = self.before.decrypt_packet(*given)[:3]
        if opened[2] in self._received:  # aioquic leaves it out: so that it can be counted
            self.repeated += 1
        self.opened += 1
        return opened

    def _update_key(self, trigger: str) -> None:
        before = CryptoContext(key_phase=self.recv.key_phase)
        for name in ("aead", "cipher_suite", "hp", "secret", "version"):
            setattr(before, name, getattr(self.recv, name))
        super()._update_key(trigger)
        self.before = before
        self.renewals += 1


register_congestion_control("tams", _Unlimited)


@dataclass(slots=True)
class Came:
    """What a datagram brought. `issued`, `retired`: connection ids by which it is called."""

    asked: bytes = b""  # the token of a Retry packet
    begun: bool = False  # the robot's side has answered the caller's first packet
    complete: bool = False  # the handshake is
    contents: list[bytes] = field(default_factory=list)  # of datagrams
    stream: bytes = b""
    issued: list[bytes] = field(default_factory=list)
    retired: list[bytes] = field(default_factory=list)


class Connection:
    """One side of a QUIC connection. `ended`: the other side closed it, or is not sound."""

    def __init__(self, quic: QuicConnection) -> None:
        self.counts: Counter[str] = Counter()
        self.ended = False
        self._quic = quic
        self._stream, self._datagram_head = _STREAM, b""
        self._keys: _Keys | None = None
        quic._loss._pacer = _Unpaced(max_datagram_size=LONGEST_DATAGRAM_BYTES)

    @staticmethod
    def calling(greeting: bytes, now_ns: int) -> Connection:
        """A new one that calls; its first packets carry the greeting."""
        configuration = _configuration([ALPN], is_client=True)
        configuration.token = greeting
        configuration.verify_mode = CERT_NONE  # the caller of this looks whose certificate it is
        quic = QuicConnection(configuration=configuration)
        quic.connect(_SOMEWHERE, _seconds(now_ns))
        return Connection(quic)

    @staticmethod
    def called(leaf: Leaf, original: bytes, retry: bytes) -> Connection:
        """One that answers: `original`: whom the caller called first; `retry`: then."""
        return Connection(answering(leaf, original, retry, [ALPN]))

    @property
    def is_heard(self) -> bool:
        """Whether a packet of the other side was authentic."""
        return self._quic._remote_initial_source_connection_id is not None

    @property
    def first_id(self) -> bytes:
        """The connection id by which the other side calls it before it knows others."""
        return self._quic.host_cid

    @property
    def certificate(self) -> x509.Certificate | None:
        """What the robot's side has shown."""
        return self._quic.tls._peer_certificate  # there is no other way to it

    @property
    def renewals(self) -> int:
        """How often the keys were replaced."""
        return 0 if self._keys is None else self._keys.renewals

    def renew_keys(self) -> None:
        """Send with new keys from now on, which the other side answers with new ones."""
        self._quic.request_key_update()

    def forget_old_keys(self) -> None:
        """Nothing is taken any more that the keys before have sealed."""
        if self._keys is not None:
            self._keys.before = None

    def receive(self, datagram: bytes, now_ns: int) -> Came:
        """Take a datagram in."""
        before = (0, 0) if self._keys is None else (self._keys.opened, self._keys.repeated)
        retries = self._quic._retry_count
        try:
            self._quic.receive_datagram(datagram, _SOMEWHERE, _seconds(now_ns))
        except Exception:  # noqa: BLE001 - it lets errors of parsers out; who makes them is dropped
            self.ended = True
            self.counts["not sound"] += 1
            return Came()
        if self._keys is not None:
            if self._keys.opened == before[0]:
                self.counts["not authentic"] += 1
            self.counts["late"] += self._keys.repeated - before[1]
        # closed by the other side, or about to be by ours, whose reasons are nobody's affair
        self.ended = self.ended or self._is_closed
        return self._came(self._quic._peer_token if self._quic._retry_count > retries else b"")

    def answer(self, word: bytes) -> None:
        """Send this behind a Retry packet's token, which alone would come back otherwise."""
        self._quic._peer_token += word

    @property
    def _is_closed(self) -> bool:
        return self._quic._close_event is not None

    def _came(self, asked: bytes) -> Came:
        came = Came(asked=asked)
        while (event := self._quic.next_event()) is not None:
            self._take(event, came)
        return came

    def _take(self, event: QuicEvent, came: Came) -> None:
        match event:
            case DatagramFrameReceived() if event.data.startswith(self._datagram_head):
                came.contents.append(event.data[len(self._datagram_head) :])
            case StreamDataReceived() if event.stream_id == self._stream:
                came.stream += event.data
            case ProtocolNegotiated():
                came.begun = True
            case HandshakeCompleted():
                came.complete = True
                cryptos, space = self._quic._cryptos, self._quic._spaces[Epoch.ONE_RTT]
                self._keys = _Keys(cryptos[Epoch.ONE_RTT], space)
                cryptos[Epoch.ONE_RTT] = self._keys
            case ConnectionIdIssued():
                came.issued.append(event.connection_id)
            case ConnectionIdRetired():
                came.retired.append(event.connection_id)

    def write(self, content: bytes) -> None:
        """Send this on the stream, in order and for certain."""
        try:
            self._quic.send_stream_data(self._stream, content)
        except (RuntimeError, ValueError):  # the other side broke it, which none of ours does
            self.ended = True

    def put(self, content: bytes) -> bool:
        """Send this as a datagram; False if it is too long for one."""
        fits = len(content) <= LONGEST_CONTENT_BYTES  # a longer one would stay, before all others
        if fits:
            self._quic.send_datagram_frame(self._datagram_head + content)
        return fits

    def due_ns(self) -> int | None:
        """When `datagrams` is to be called although nothing was put; None: at no time."""
        if self.ended or (timer := self._quic.get_timer()) is None:
            return None
        due_ns = round(timer * NS_PER_S) + NS_PER_MS // 1000  # whose seconds are rounded
        return due_ns if self._keys is None else due_ns + ACK_WAIT_NS

    def datagrams(self, now_ns: int) -> list[bytes]:
        """What is to be sent now."""
        if self.ended:
            return []
        now_s, timer = _seconds(now_ns), self._quic.get_timer()
        if timer is not None and now_s >= timer:
            self._quic.handle_timer(now_s)
            if self._keys is None:  # who calls does so at an even pace, as long as it may take
                self._quic._loss._pto_count = 0
            self.ended = self._is_closed
        return [datagram for datagram, _ in self._quic.datagrams_to_send(now_s)]


def answering(leaf: Leaf, original: bytes, retry: bytes, protocols: list[str]) -> QuicConnection:
    """The robot's side of a connection, for one of these protocols (RFC 7301).

    `original`: the connection id that the caller called first; `retry`: then.
    """
    configuration = _configuration(protocols, is_client=False)
    configuration.certificate, configuration.private_key = leaf.certificate, leaf.key
    return QuicConnection(
        configuration=configuration,
        original_destination_connection_id=original,
        retry_source_connection_id=retry,
    )


def _configuration(protocols: list[str], is_client: bool) -> QuicConfiguration:
    return QuicConfiguration(
        is_client=is_client,
        alpn_protocols=protocols,
        cipher_suites=[CipherSuite.AES_256_GCM_SHA384],
        congestion_control_algorithm="tams",
        connection_id_length=ID_BYTES,
        idle_timeout=IDLE_NS / NS_PER_S,
        max_data=STREAM_BYTES,
        max_stream_data=STREAM_BYTES,
        max_datagram_size=LONGEST_DATAGRAM_BYTES,
        max_datagram_frame_size=LONGEST_DATAGRAM_BYTES,
        supported_versions=[QuicProtocolVersion.VERSION_1],
    )


def _seconds(now_ns: int) -> float:
    return now_ns / NS_PER_S


# --- before there is a connection ---------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Initial:
    """The header of a packet that may begin a connection (RFC 9000, 17.2.2)."""

    destination: bytes
    source: bytes
    token: bytes


def destination_of(datagram: bytes) -> bytes:
    """The connection id that a packet is addressed to; cut if the datagram is."""
    if datagram[0] & LONG_HEADER:
        return datagram[6 : 6 + datagram[5]] if len(datagram) > 5 else b""
    return datagram[1 : 1 + ID_BYTES]


def is_initial(datagram: bytes) -> bool:
    """Whether it begins as an Initial packet of QUIC's version 1 does."""
    return datagram[0] & 0xF0 == 0xC0 and datagram[1:5] == VERSION


def read_initial(datagram: bytes) -> Initial | None:
    """The header; None for what is none, or is shorter than a client may make it."""
    if len(datagram) < LONGEST_DATAGRAM_BYTES or not is_initial(datagram):
        return None
    at = 6 + datagram[5]
    destination, source_at = datagram[6:at], at + 1
    at = source_at + datagram[at]
    source, head = datagram[source_at:at], datagram[at]
    if not ID_BYTES <= len(destination) <= 20 or len(source) > ID_BYTES:
        return None
    size_bytes = 1 << (head >> 6)  # of the token's length (RFC 9000, 16)
    length = int.from_bytes(datagram[at : at + size_bytes]) & ((1 << 8 * size_bytes - 2) - 1)
    at += size_bytes
    return Initial(destination, source, datagram[at : at + length])


class Retries:
    """Proofs that who sends from an address also receives there; nothing is kept of any.

    A Retry packet (RFC 9000, 8.1.2) carries one. `said`: what it is to bring back besides.
    """

    def __init__(self, secret: bytes) -> None:
        self._secret = secret

    def retry(self, initial: Initial, address: Address, here: bytes, said: bytes, at: int) -> bytes:
        """The packet that answers. `here`: the connection id to call now; `at`: now [ns]."""
        body = bytes((len(initial.destination),)) + initial.destination + said
        token = _RETRY + body + self._proof(body, address, here, at // _SLOT_NS)
        return encode_quic_retry(
            QuicProtocolVersion.VERSION_1, here, initial.source, initial.destination, token
        )

    def read(
        self, token: bytes, here: bytes, address: Address, now_ns: int
    ) -> tuple[bytes, bytes] | None:
        """The connection id that was called first, and what was said; None: no such proof."""
        body, proof = token[1:-_PROOF_BYTES], token[-_PROOF_BYTES:]
        if not token.startswith(_RETRY) or not body:
            return None
        slot = now_ns // _SLOT_NS
        given = (self._proof(body, address, here, one) for one in (slot, slot - 1))
        if not any(hmac.compare_digest(proof, one) for one in given):
            return None
        return body[1 : 1 + body[0]], body[1 + body[0] :]

    def _proof(self, body: bytes, address: Address, here: bytes, slot: int) -> bytes:
        said = f"{slot} {address!r} {here.hex()} ".encode() + body
        return hmac.digest(self._secret, said, sha256)[:_PROOF_BYTES]
