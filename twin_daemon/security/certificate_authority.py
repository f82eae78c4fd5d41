"""A small authority of its own for one installation: who may join the hand's network, by certificate.

X.509 (RFC 5280) with keys on the curve P-256. Nobody outside has to be trusted or asked, and nothing is looked up.
"""

from __future__ import annotations

import contextlib
import ipaddress
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from twin_daemon.errors import BadInput
from twin_daemon.files import write_atomically
from twin_daemon.privileges import as_root
from twin_daemon.security.tls import AUTHORITY, CERTIFICATE, KEY

_OWN = "authority"
_LASTS = timedelta(days=3650)
_ISSUED_LASTS = timedelta(days=825)
_RENEW = timedelta(days=30)
_SKEW = timedelta(hours=1)  # another machine's clock may be behind
_SECRET = 0o600


class Authority:
    """Its certificate and key are in a folder of its `own`, `folder`/authority by default, and each name's in
    `folder`/NAME, with the authority's certificate beside them: one folder is all that a machine needs."""

    def __init__(self, folder: Path, own: Path | None = None) -> None:
        """Opens the authority, or makes it. Raises BadInput where its files cannot be read or written."""
        self.folder = folder
        own = folder / _OWN if own is None else own
        try:
            with as_root(own):
                if not (own / KEY).exists():
                    key = ec.generate_private_key(ec.SECP256R1())
                    name = _named("twin authority")
                    made = _begun(name, name, key, _LASTS)
                    made = made.add_extension(x509.BasicConstraints(ca=True, path_length=0), True)
                    _write(own, key, made.sign(key, hashes.SHA256()))
                loaded = serialization.load_pem_private_key((own / KEY).read_bytes(), None)
                self.certificate = x509.load_pem_x509_certificate((own / CERTIFICATE).read_bytes())
        except (OSError, ValueError, TypeError) as error:
            raise BadInput(
                f"no authority: {error}", where=own, todo="Restore it from a copy, or move it away"
            ) from None
        if not isinstance(loaded, ec.EllipticCurvePrivateKey):
            raise BadInput("no key of this authority", where=own / KEY, todo="Restore it from a copy")
        self._key = loaded

    def issue(self, name: str, hosts: Sequence[str] = (), *, renew: bool = False) -> datetime:
        """Until when `name` has a certificate: the one that it has, or a new one where that is missing, ends within 30
        days, is another authority's or leaves one of the `hosts` out."""
        folder = self.folder / name
        known = certificate_of(folder)
        if known is not None and not renew and self._serves(name, known, hosts):
            return known.not_valid_after_utc
        key = ec.generate_private_key(ec.SECP256R1())
        built = (
            _begun(_named(name), self.certificate.subject, key, _ISSUED_LASTS)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), True)
            .add_extension(x509.SubjectAlternativeName([_host(host) for host in hosts or (name,)]), False)
        )
        made = built.sign(self._key, hashes.SHA256())
        try:
            _write(folder, key, made)
            write_atomically(folder / AUTHORITY, _pem(self.certificate))
        except OSError as error:
            raise BadInput(
                f"cannot be written ({error.strerror})",
                where=error.filename or folder,
                todo="Whoever owns the folder above has to be able to: look for a link that leads elsewhere",
            ) from None
        return made.not_valid_after_utc

    def _serves(self, name: str, known: x509.Certificate, hosts: Iterable[str]) -> bool:
        if known.not_valid_after_utc < datetime.now(UTC) + _RENEW:
            return False
        with contextlib.suppress(Exception):
            known.verify_directly_issued_by(self.certificate)
            key = serialization.load_pem_private_key((self.folder / name / KEY).read_bytes(), None)
            if key.public_key() != known.public_key():  # a renewal was killed half-way
                return False
            there = known.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
            return all(_host(host) in there for host in hosts)
        return False


def certificate_of(folder: Path) -> x509.Certificate | None:
    """The certificate of an identity's folder; None where there is none that can be read."""
    try:
        return x509.load_pem_x509_certificate((folder / CERTIFICATE).read_bytes())
    except (OSError, ValueError):
        return None


def _begun(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, lasts: timedelta
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _SKEW)
        .not_valid_after(now + lasts)
    )


def _named(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _host(host: str) -> x509.GeneralName:
    with contextlib.suppress(ValueError):
        return x509.IPAddress(ipaddress.ip_address(host))
    try:
        return x509.DNSName(host)
    except ValueError as error:
        raise BadInput(f"'{host}' is no host: {error}", todo="Name a host or an address") from None


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _write(folder: Path, key: ec.EllipticCurvePrivateKey, certificate: x509.Certificate) -> None:
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    secret = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    write_atomically(folder / KEY, secret, mode=_SECRET)
    write_atomically(folder / CERTIFICATE, _pem(certificate))
