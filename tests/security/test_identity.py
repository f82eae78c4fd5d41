"""A proof is believed when its key made it, and refused, whatever its bytes, when not."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin_daemon.security.identity import Keyring, Proof, ensure_keyring


@pytest.fixture
def keyring(tmp_path: Path) -> Keyring:
    return ensure_keyring(tmp_path / "keys.json")


def test_its_own_proof_is_believed_for_its_own_request_alone(keyring: Keyring) -> None:
    proof = keyring.sign("operator", "arm", b"{}")
    who = keyring.who("arm", b"{}", proof)
    assert who is not None
    assert (who.name, who.role) == ("operator", "operator")
    assert keyring.who("move", b"{}", proof) is None
    assert keyring.who("arm", b"{ }", proof) is None


@pytest.mark.parametrize("code", ["", "0" * 64, "\u00800", "\ud800", "\0"])
def test_any_other_code_is_refused(keyring: Keyring, code: str) -> None:
    assert keyring.who("arm", b"{}", Proof("operator", code)) is None
