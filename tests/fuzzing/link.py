"""Both ends of the link and what they open, under datagrams that a fuzzer makes up."""

from __future__ import annotations

from collections.abc import Iterator

from tams_app.link.addresses import Address
from tams_app.link.caller import Caller
from tams_app.link.door import Door
from tams_app.link.proof import WordStream
from tams_app.link.quic import VERSION, Connection
from tams_app.units import NS_PER_MS
from tests.link.rig import ROBOT, Desk, Rig, channel_of, connected, rtcp, rtp

STRANGER: Address = ("203.0.113.9", 666)


def pieces(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Steps of a course of events: one byte of kind, one of length, and so many bytes."""
    at = 0
    while at + 2 <= len(data):
        kind, length = data[at], data[at + 1]
        yield kind, data[at + 2 : at + 2 + length]
        at += 2 + length


def altered(datagram: bytes, change: bytes) -> bytes:
    """The datagram with bytes exchanged: each pair of `change` is a place and what it is XORed."""
    copy = bytearray(datagram)
    for place, mask in zip(change[::2], change[1::2], strict=False):
        copy[place % len(copy)] ^= mask
    return bytes(copy)


def _real(end: Door | Caller, number: int, now_ns: int) -> bytes:
    """A datagram that the other side takes."""
    match number % 3:
        case 0:
            made = end.message(b"m" * (number % 90), now_ns)
        case 1:
            made = end.media(rtp(number), now_ns)
        case _:
            made = end.media(rtcp(), now_ns)
    return made[0][0]


def _course(data: bytes, at_robot: bool) -> None:
    """Nonsense, copies and altered copies reach one end: its session goes on."""
    rig, desk = connected()
    sender, address = (desk.end, desk.address) if at_robot else (rig.robot, ROBOT)
    for number, (kind, piece) in enumerate(pieces(data)):
        match kind % 4:
            case 0:
                datagram, origin = piece, STRANGER
            case 1:
                datagram, origin = altered(_real(sender, number, rig.now_ns), piece), STRANGER
            case 2:
                datagram, origin = _real(sender, number, rig.now_ns), address
            case _:
                rig.now_ns += sum(piece[:1]) * NS_PER_MS
                continue
        if at_robot:
            rig.at_robot(datagram, origin)
        else:
            rig.at_desk(desk, datagram)
    rig.run_ms(1500, desk)
    assert rig.gets_through(desk)


def robot_end(data: bytes) -> None:
    """The robot's end with an operator."""
    _course(data, at_robot=True)


def operator_end(data: bytes) -> None:
    """The operator's end with a robot."""
    _course(data, at_robot=False)


def channel(data: bytes) -> None:
    """What opens messages and packets: only what was sent comes out, and only once."""
    rig, desk = connected()
    sent = [_real(desk.end, number, rig.now_ns) for number in range(3)]
    received = []
    for kind, piece in pieces(data):
        datagram = piece if kind % 2 else altered(sent[kind % 3], piece)
        heard = rig.at_robot(datagram, desk.address)
        received += heard.messages + heard.media
        assert not (heard.messages or heard.media) or datagram in sent
    assert len(received) <= len(sent)


def handshake(data: bytes) -> None:
    """The door while somebody calls: what is on its way is exchanged, altered and made up."""
    rig, desk = Rig(), Desk()
    steps = pieces(data)

    def passes(datagram: bytes) -> bool:
        kind, piece = next(steps, (3, b""))
        if kind % 4 == 0:
            rig.at_robot(altered(datagram, piece), desk.address)
        elif kind % 4 == 1:
            rig.at_robot(b"\xc0" + VERSION + piece.ljust(1200, b"\0"), STRANGER)
        return kind % 4 > 1

    rig.up = passes
    rig.run_ms(500, desk)
    rig.up = lambda _: True
    rig.run_ms(12_000, desk)
    assert rig.gets_through(desk)


def authentic(data: bytes) -> None:
    """What an operator with a key may say that no program of ours says: it ends them at most."""
    rig, desk = connected()
    connection = channel_of(desk.end).connection
    for kind, piece in pieces(data):
        match kind % 3:
            case 0:
                connection.put(piece)
            case 1:
                connection.write(piece)  # which ends it here if it is broken
            case _:
                _stream(connection, piece)
        rig.send_up(desk, channel_of(desk.end).datagrams(rig.now_ns))
        if not desk.end.connected:
            break
    WordStream().of(data)
    other = Desk(address=("10.0.0.3", 1))
    rig.now_ns += 4_000 * NS_PER_MS
    rig.run_ms(500, other)
    assert rig.gets_through(other)


def _stream(connection: Connection, piece: bytes) -> None:
    """Use a stream that the link does not use, or break the one that it does."""
    quic = connection._quic
    match len(piece) % 3:
        case 0:
            quic.send_stream_data(quic.get_next_available_stream_id(), piece)
        case 1:
            quic.stop_stream(1, 0)
        case _:
            quic.reset_stream(1, 0)
