"""An authority of one's own: what is good stays, what is not is made anew."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin_daemon.errors import BadInput
from twin_daemon.files import write_atomically
from twin_daemon.security.certificate_authority import Authority, certificate_of


def test_what_is_good_stays_and_the_keys_are_nobody_elses(tmp_path: Path) -> None:
    until = Authority(tmp_path).issue("ann")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.pem")}
    assert Authority(tmp_path).issue("ann") == until
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.pem")} == before
    assert {path.stat().st_mode & 0o777 for path in tmp_path.rglob("key.pem")} == {0o600}
    certificate = certificate_of(tmp_path / "ann")
    assert certificate is not None
    certificate.verify_directly_issued_by(Authority(tmp_path).certificate)


def test_a_new_host_a_lost_key_and_another_authority_make_it_anew(tmp_path: Path) -> None:
    authority = Authority(tmp_path / "one")

    def made() -> bytes:
        authority.issue("daemon", ["localhost", "10.0.0.7"])
        return (tmp_path / "one/daemon/certificate.pem").read_bytes()

    authority.issue("daemon", ["localhost"])
    first = (tmp_path / "one/daemon/certificate.pem").read_bytes()
    second = made()
    assert second not in (first, b"")
    assert made() == second
    other = Authority(tmp_path / "two")
    other.issue("daemon", ["localhost", "10.0.0.7"])
    for name in ("key.pem", "certificate.pem"):  # the key alone is what a renewal leaves that was killed half-way
        write_atomically(tmp_path / "one/daemon" / name, (tmp_path / "two/daemon" / name).read_bytes())
        third = made()
        assert third not in (first, second)
        second = third
    authority.issue("daemon", ["localhost", "10.0.0.7"], renew=True)
    assert (tmp_path / "one/daemon/certificate.pem").read_bytes() != second


def test_what_cannot_be_read_is_said_and_left_alone(tmp_path: Path) -> None:
    Authority(tmp_path)
    key = tmp_path / "authority" / "key.pem"
    key.write_text("no key")
    with pytest.raises(BadInput, match="no authority"):
        Authority(tmp_path)
    assert key.read_text() == "no key"
