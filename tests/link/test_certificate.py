"""The certificate of the day: signed by the robot, short-lived, nameless, and renewed in time."""

from __future__ import annotations

import os
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import SignatureAlgorithmOID

from tams_app.link.certificate import BEFORE_S, RENEWED_AFTER_S, LeafKeeper, is_signed_by, leaf
from tams_app.link.identity import RobotIdentity, read_identity
from tams_app.link.keys import new_key, read_key

pytestmark = pytest.mark.untimed

ROBOT, OTHER = RobotIdentity(b"r" * 32), RobotIdentity(b"s" * 32)
HOUR_S, DAY_S = 3600.0, 86_400.0
NOW_S = 1_800_000_000.25
VALID = timedelta(days=13)


def test_a_robots_public_half_is_that_of_rfc_8032() -> None:
    """Its section 7.1, test 1; with another one two versions could not connect."""
    private = "9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60"
    public = "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a"
    assert RobotIdentity(bytes.fromhex(private)).public.hex() == public


def test_the_operator_knows_the_robot_of_their_key_by_its_certificate(tmp_path: Path) -> None:
    key = read_key(new_key(tmp_path, "kim"))
    assert key.robot is not None
    assert is_signed_by(leaf(read_identity(tmp_path), NOW_S).certificate, key.robot)
    assert not is_signed_by(leaf(ROBOT, NOW_S).certificate, key.robot)


def test_a_changed_certificate_is_not_the_robots() -> None:
    """Each bit but those between the signed part and the signature, which name its algorithm."""
    made = leaf(ROBOT, NOW_S)
    signed = made.certificate.tbs_certificate_bytes
    start = made.der.index(signed)
    for at in (*range(start, start + len(signed)), *range(len(made.der) - 64, len(made.der))):
        changed = bytearray(made.der)
        changed[at] ^= 1 << at % 8
        try:
            certificate = x509.load_der_x509_certificate(bytes(changed))
        except (ValueError, x509.InvalidVersion):
            continue  # no certificate at all
        assert not is_signed_by(certificate, ROBOT.public)


def test_a_certificate_is_what_browsers_accept_by_its_hash() -> None:
    made = leaf(ROBOT, NOW_S)
    certificate = x509.load_der_x509_certificate(made.der)
    assert certificate.version == x509.Version.v3
    assert not certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    key = certificate.public_key()
    assert isinstance(key, ec.EllipticCurvePublicKey)
    assert isinstance(key.curve, ec.SECP256R1)
    assert key == made.key.public_key()
    now = datetime.fromtimestamp(NOW_S, UTC)
    assert certificate.not_valid_before_utc < now - timedelta(hours=23)
    assert certificate.not_valid_after_utc - certificate.not_valid_before_utc == VALID
    assert certificate.not_valid_after_utc.timestamp() == made.not_after_s


def test_a_certificate_names_nobody_and_no_two_have_anything_in_common() -> None:
    one, two = (leaf(ROBOT, NOW_S) for _ in range(2))
    for made in (one, two):
        assert not list(made.certificate.subject)
        assert not list(made.certificate.issuer)
        assert len(made.certificate.extensions) == 1
        assert made.certificate.signature_algorithm_oid == SignatureAlgorithmOID.ED25519
        assert ROBOT.public not in made.der
    assert one.certificate.serial_number != two.certificate.serial_number
    assert one.key.public_key() != two.key.public_key()


def test_a_running_robot_renews_its_certificate_over_15_days() -> None:
    keeper = LeafKeeper(ROBOT)
    shown = []
    for hour in range(15 * 24 + 1):
        now_s = NOW_S + hour * HOUR_S
        made = keeper.current(now_s)
        assert made is keeper.current(now_s)
        now = datetime.fromtimestamp(now_s, UTC)
        assert made.certificate.not_valid_before_utc < now
        assert made.certificate.not_valid_after_utc > now + timedelta(days=5)
        assert is_signed_by(made.certificate, ROBOT.public)
        if made not in shown:
            shown.append(made)
    assert len(shown) == 3


@pytest.mark.parametrize(
    ("later_s", "renewed"),
    [
        (RENEWED_AFTER_S - 1, False),
        (RENEWED_AFTER_S + 1, True),
        (-HOUR_S, False),
        (1 - BEFORE_S, False),
        (-BEFORE_S - 1, True),
    ],
)
def test_a_clock_that_is_set_leads_to_a_new_certificate_only_if_the_old_one_is_none_then(
    later_s: float, renewed: bool
) -> None:
    keeper = LeafKeeper(ROBOT)
    before = keeper.current(NOW_S)
    assert (keeper.current(NOW_S + later_s) is not before) is renewed


def test_a_robot_whose_clock_starts_in_1970_has_a_certificate() -> None:
    assert is_signed_by(LeafKeeper(ROBOT).current(0.0).certificate, ROBOT.public)


def test_a_fresh_identity_is_made_of_what_is_drawn() -> None:
    assert RobotIdentity.fresh(lambda size: b"r" * size) == ROBOT
    assert RobotIdentity.fresh(os.urandom).public != RobotIdentity.fresh(os.urandom).public
    assert OTHER.public != ROBOT.public
