"""The robot's certificate of the day, which its identity signs: its private key is in no file.

It is valid for no longer than browsers accept of one that they know by its hash alone (W3C
WebTransport, "custom certificate requirements": X.509v3, ECDSA P-256, 14 days), and names nobody.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding

from tams_app.link.identity import RobotIdentity

_DAY_S = 86_400.0
VALID_S = 13 * _DAY_S
BEFORE_S = _DAY_S  # it is valid already: the other computer's clock may be behind
RENEWED_AFTER_S = 6 * _DAY_S
_NOBODY = x509.Name([])
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class Leaf:
    """A certificate, and what proves that it is ours."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey = field(repr=False)
    der: bytes = field(repr=False)
    not_after_s: float  # seconds of Unix time


def leaf(identity: RobotIdentity | None, now_s: float) -> Leaf:
    """A new certificate that `identity` signs; None: itself. `now_s`: seconds of Unix time."""
    key = ec.generate_private_key(ec.SECP256R1())
    # in whole seconds, which are all that a certificate can tell
    not_before = _EPOCH + timedelta(seconds=int(now_s - BEFORE_S))
    not_after = not_before + timedelta(seconds=VALID_S)
    builder = (
        x509.CertificateBuilder(_NOBODY, _NOBODY, key.public_key(), x509.random_serial_number())
        .not_valid_before(not_before)
        .not_valid_after(not_after)
        # Chromium (156 was tried) refuses one that has no extension at all
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
    )
    if identity is None:
        certificate = builder.sign(key, SHA256())
    else:
        certificate = builder.sign(identity.signer(), algorithm=None)
    return Leaf(certificate, key, certificate.public_bytes(Encoding.DER), not_after.timestamp())


def is_signed_by(certificate: x509.Certificate, public: bytes) -> bool:
    """Whether the identity `public`, shape (32,), signed it. Says nothing of its dates."""
    try:
        Ed25519PublicKey.from_public_bytes(public).verify(
            certificate.signature, certificate.tbs_certificate_bytes
        )
    except InvalidSignature:
        return False
    return True


class LeafKeeper:
    """The certificate for new connections, renewed long before it ends."""

    def __init__(self, identity: RobotIdentity) -> None:
        self._identity = identity
        self._leaf: Leaf | None = None

    def current(self, now_s: float) -> Leaf:
        """The one to show now. `now_s`: seconds of Unix time, which may have been set meanwhile."""
        if self._leaf is not None:
            age_s = now_s + VALID_S - BEFORE_S - self._leaf.not_after_s
        if self._leaf is None or not -BEFORE_S <= age_s <= RENEWED_AFTER_S:
            self._leaf = leaf(self._identity, now_s)
        return self._leaf
