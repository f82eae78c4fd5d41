"""Which model the daemon runs: the version it was told, else the promoted one, else the nominal model."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from twin_daemon.errors import BadInput, TwinError
from twin_daemon.hand.description import Hand
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import Version, VersionStore


class ModelSource:
    """Loads the model in use and notices when another version was promoted.

    A fixed `version` (id, alias or name) is never replaced by a promotion.
    """

    def __init__(self, hand: Hand, version: str | None = None, store: VersionStore | None = None) -> None:
        self._hand = hand
        self._fixed = version
        self.store = store or VersionStore.of(hand)
        self._loaded: str | None = None
        self._refused: str | None = None

    def load(self) -> tuple[TwinModel, dict[str, Any]]:
        """The model to run and what the version query says of it. Raises BadInput where it cannot be used."""
        reference = self._fixed if self._fixed is not None else self._promoted()
        version = self.store.get(reference)
        twin = TwinModel.load(self._hand, _terms(version))
        self._loaded = version.id
        return twin, describe(version)

    def poll(self) -> tuple[TwinModel, dict[str, Any]] | None:
        """Another version, if one was promoted since; None while nothing changed.

        A version that cannot be used is reported once, by raising, and the model in use stays.
        """
        if self._fixed is not None:
            return None
        promoted = self._promoted()
        if promoted in (self._loaded, self._refused):
            return None
        try:
            found = self.load()
        except TwinError:
            self._refused = promoted
            raise
        self._refused = None
        return found

    def _promoted(self) -> str:
        return self.store.aliases()["current"]

    def answer(self, reference: str) -> dict[str, Any] | None:
        """What `versions/**` answers: all versions for "", else one of them, or None."""
        if not reference:
            versions, problems = self.store.survey()
            return {
                "schema": 1,
                "in_use": self._loaded,
                "aliases": self.store.aliases(),
                "versions": [describe(version) for version in versions],
                "problems": problems,
            }
        try:
            version = self.store.get(reference)
        except BadInput:
            return None
        return version.as_json()


def describe(version: Version) -> dict[str, Any]:
    """A version in short: who it is and how good it was found to be."""
    full = version.as_json()
    kept = ("id", "kind", "title", "created", "parent", "errors", "mjcf_sha256", "terms", "region")
    return {key: full[key] for key in kept} | {"short_id": version.short_id}


def _terms(version: Version) -> Terms:
    try:
        return Terms.model_validate(version.terms)
    except ValidationError as error:
        raise BadInput(
            f"version {version.short_id} holds terms that this release cannot read: {error.errors()[0]['msg']}",
            todo="Update the package, or promote another version",
        ) from None
