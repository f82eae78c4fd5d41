"""Who asks: names with a role and a secret key, and what proves that a request is theirs (HMAC, RFC 2104)."""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from twin_daemon.errors import BadInput
from twin_daemon.files import write_atomically
from twin_daemon.privileges import as_root

Role = Literal["operator", "viewer", "hand"]
ANONYMOUS = "anonymous"
INTERNAL = "-daemon"  # what no identity of a file can be called
KEYS = "keys.json"
_MAX_PROOF_BYTES = 1000
_ANSWER = "answer/"  # no verb, so that a proof of a reply proves no request
_USUAL: dict[str, Role] = {"operator": "operator", "hand": "hand", "viewer": "viewer", "automatic": "operator"}
_Key = Annotated[str, Field(pattern=r"^[0-9a-f]{64,128}$")]


@dataclass(frozen=True)
class Who:
    """Somebody who asks. Only an operator may command; everybody may look and stop."""

    name: str
    role: Role = "viewer"


NOBODY = Who(ANONYMOUS)


class Identity(BaseModel):
    """One line of the identity file. The key is a secret of 32 bytes or more, in hexadecimal digits."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    role: Role
    key: _Key = Field(repr=False)


class _Identities(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    schema_: Literal[1] = Field(1, alias="schema")
    identities: dict[Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.\-]{0,63}$")], Identity]


@dataclass(frozen=True)
class Proof:
    """What goes beside a request: a name, and the code that only its key makes of this verb and these bytes."""

    who: str
    code: str

    def encode(self) -> bytes:
        return json.dumps({"who": self.who, "code": self.code}).encode()

    @classmethod
    def decode(cls, data: bytes | None) -> Proof | None:
        """None for what is no proof."""
        if data is not None and len(data) > _MAX_PROOF_BYTES:
            return None
        try:
            read = json.loads(data or b"")
            return cls(str(read["who"])[:64], str(read["code"])[:200])
        except (ValueError, TypeError, KeyError, RecursionError):
            return None


class Keyring:
    """The identities that a gate knows."""

    def __init__(self, identities: dict[str, Identity]) -> None:
        self._identities = identities

    def sign(self, name: str, verb: str, payload: bytes) -> Proof:
        """The proof of `name` for a request. Raises KeyError for a name that it does not hold."""
        return Proof(name, _code(self._identities[name], verb, payload))

    def who(self, verb: str, payload: bytes, proof: Proof | None) -> Who | None:
        """Whose request it is; anonymous without a proof; None where the proof is wrong or its name unknown."""
        if proof is None:
            return NOBODY
        known = self._identities.get(proof.who)
        if known is None:
            return None
        right = _code(known, verb, payload).encode()
        if not hmac.compare_digest(right, proof.code.encode(errors="replace")):
            return None
        return Who(proof.who, known.role)

    def answer_proof(self, name: str, verb: str, request: bytes, reply: bytes) -> Proof:
        """What shows `name` that this reply to its request comes from one that knows its key, the gate."""
        return self.sign(name, _ANSWER + verb, hashlib.sha256(request).digest() + reply)

    def proves_answer(self, name: str, verb: str, request: bytes, reply: bytes, proof: Proof | None) -> bool:
        """Whether a reply to a request of `name` is the gate's own. A request is new each time, and so is its reply."""
        if proof is None or proof.who != name or name not in self:
            return False
        right = self.answer_proof(name, verb, request, reply).code
        return hmac.compare_digest(right.encode(), proof.code.encode(errors="replace"))

    def among_ourselves(self) -> Keyring:
        """A keyring of one identity, INTERNAL, for those who hold this whole file: the gate and its daemon."""
        whole = "".join(f"{name}:{one.key};" for name, one in sorted(self._identities.items()))
        key = hashlib.sha256(f"gate and daemon;{whole}".encode()).hexdigest()
        return Keyring({INTERNAL: Identity(role="hand", key=key)})

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._identities)

    def role(self, name: str) -> Role:
        return self._identities[name].role

    def password(self, name: str) -> str:
        """What `name` logs in with on the network; the key itself never leaves."""
        return hmac.new(bytes.fromhex(self._identities[name].key), b"zenoh", hashlib.sha256).hexdigest()

    def only(self, name: str) -> Keyring:
        """A keyring with one identity of this one."""
        return Keyring({name: self._identities[name]})

    def changed(self, name: str, identity: Identity | None) -> Keyring:
        """With one identity added, or without it. Raises BadInput for a name that cannot be one."""
        left = {known: one for known, one in self._identities.items() if known != name}
        try:
            read = _Identities(schema=1, identities=left | ({} if identity is None else {name: identity}))
        except ValidationError:
            raise BadInput(
                f"'{name}' is no name", allowed="letters, digits and underscore, behind the first also dot and dash"
            ) from None
        return Keyring(read.identities)

    def save(self, path: Path) -> None:
        """Writes the file that `load_keyring` reads, for this user alone."""
        made = {name: one.model_dump() for name, one in self._identities.items()}
        with as_root(path):
            write_atomically(path, json.dumps({"schema": 1, "identities": made}, indent=1).encode(), mode=0o600)

    def __contains__(self, name: str) -> bool:
        return name in self._identities


def _code(identity: Identity, verb: str, payload: bytes) -> str:
    return hmac.new(bytes.fromhex(identity.key), verb.encode() + b"\0" + payload, hashlib.sha256).hexdigest()


def load_keyring(path: Path) -> Keyring:
    """The identities of a file. Raises BadInput; the message never quotes the file."""
    try:
        with as_root(path):
            if path.stat().st_mode & _seen_by_others(path):
                raise BadInput("others can read these keys", where=path, todo=f"chmod 600 {path}")
            read = _Identities.model_validate_json(path.read_bytes())
    except OSError as error:
        raise BadInput(
            f"no identities: {error.strerror}", where=path, todo="'twin run' makes them; or name a file with TWIN_KEYS"
        ) from None
    except ValidationError as error:
        place = ".".join(str(part) for part in error.errors()[0]["loc"])
        raise BadInput(
            f"{place}: not an identity file",
            where=path,
            allowed='{"schema": 1, "identities": {NAME: {"role": operator, viewer or hand, "key": 64 hex digits}}}',
        ) from None
    return Keyring(read.identities)


def keyring_of(name: str, key: str) -> Keyring:
    """What somebody proves himself with who gives his name and his key. Whether both are right, the gate says.

    Raises BadInput for what can be none; the message never quotes the key.
    """
    try:
        return Keyring({}).changed(name.strip(), Identity(role="operator", key=key.strip().lower()))
    except ValidationError:
        raise BadInput("this is no key", allowed="64 hexadecimal digits, as in the key file") from None


def _seen_by_others(path: Path) -> int:
    """The bits that a key file must not have. systemd's credentials show the service's own access as the group's."""
    folder = os.environ.get("CREDENTIALS_DIRECTORY")
    return 0o007 if folder and path.parent == Path(folder) else 0o077


def ensure_keyring(path: Path) -> Keyring:
    """The identities of a file, which is made with one of each role where there is none yet."""
    if not path.exists():
        with as_root(path):
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        Keyring({name: new_identity(role) for name, role in _USUAL.items()}).save(path)
    return load_keyring(path)


def ensure_identity(path: Path, keyring: Keyring, name: str, role: Role) -> Keyring:
    """With this identity, too: it is added to the file where it is missing. Raises OSError where that cannot be."""
    if name in keyring:
        return keyring
    added = keyring.changed(name, new_identity(role))
    added.save(path)
    return added


def new_identity(role: Role) -> Identity:
    """An identity with a key that nobody else has."""
    return Identity(role=role, key=secrets.token_hex(32))


def keys_file(state: Path) -> Path:
    """TWIN_KEYS, or the file in the folder of TWIN_SECURITY where it has one, or that in the state folder."""
    if given := os.environ.get("TWIN_KEYS"):
        return Path(given)
    carried = Path(os.environ.get("TWIN_SECURITY", "")) / KEYS
    return carried if os.environ.get("TWIN_SECURITY") and carried.is_file() else state / KEYS
