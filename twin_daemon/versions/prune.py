"""Making room: which versions keep their model, which keep their numbers only, and which go."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Literal

from twin_daemon.errors import BadInput
from twin_daemon.versions.folder import MODEL, size_bytes, strip_folder
from twin_daemon.versions.lineage import ancestors
from twin_daemon.versions.registry import Registry
from twin_daemon.versions.store import VersionStore
from twin_daemon.versions.version import Version

KEPT_TO_ROLL_BACK_TO = 5

Action = Literal["keep", "stub", "remove"]


@dataclass(frozen=True)
class Policy:
    """What may go: neither named, nor among the newest `keep`, nor younger than `older_than_days`.

    The last promotions stay whole, so that one can go back more than once. Ancestors of what stays, and everything
    that was ever promoted, keep their numbers as stubs (`ancestors`: "stub"), or stay whole ("whole").
    """

    keep: int = 20
    older_than_days: float = 30.0
    ancestors: Literal["stub", "whole"] = "stub"


@dataclass(frozen=True)
class Choice:
    """What happens to one version, why, and how many bytes that frees."""

    version: str
    action: Action
    why: str
    frees_bytes: int


def plan(store: VersionStore, policy: Policy) -> tuple[Choice, ...]:
    """What `prune` would do, oldest version first. Nothing is changed. Damaged versions are left alone."""
    found = store.everything()
    own = {stored.id: stored for stored in store.contents.own()}
    versions = [version for version in store.in_order(found) if version.id in own]
    whole = _reasons(store, versions, policy)
    above = ancestors(whole, found.versions)
    if policy.ancestors == "whole":
        whole |= dict.fromkeys(above - whole.keys(), "ancestor")
    promoted = _ever_promoted(store.registry)
    choices = []
    for version in versions:
        folder = own[version.id].folder
        if version.id in whole:
            choices.append(Choice(version.id, "keep", whole[version.id], 0))
        elif version.id in above or version.id in promoted:
            why = "ancestor" if version.id in above else "was promoted"
            stub = version.id in found.stubs
            freed = 0 if stub else size_bytes(folder, MODEL)
            choices.append(Choice(version.id, "keep" if stub else "stub", why, freed))
        else:
            choices.append(Choice(version.id, "remove", "old and unused", size_bytes(folder)))
    return tuple(choices)


def prune(store: VersionStore, policy: Policy) -> tuple[Choice, ...]:
    """Do what `plan` says, alone among writers. It is decided in one step; who dies on the way has pruned less."""
    if not store.root.is_dir():
        return ()
    with store.writing():
        choices = plan(store, policy)
        removed = tuple(choice.version for choice in choices if choice.action == "remove")
        stubbed = tuple(choice.version for choice in choices if choice.action == "stub")
        if not removed and not stubbed:
            return choices
        store.registry.decide("pruned", removed=removed, stubbed=stubbed)
        store.contents.remove(removed)  # first: it needs no room, and the stubs need a little
        if stubbed:
            with store.contents.scratch() as hidden:
                for version in stubbed:
                    strip_folder(store.contents.folders / version, hidden)
    store.everything()  # the index forgets what is gone
    return choices


def checked(keep: int, older_than_days: float, kept_ancestors: str) -> Policy:
    """A policy from what people gave. Raises BadInput."""
    if kept_ancestors not in ("stub", "whole"):
        raise BadInput(f"ancestors cannot be kept '{kept_ancestors}'", allowed="stub, whole")
    return Policy(keep, older_than_days, "whole" if kept_ancestors == "whole" else "stub")


def _reasons(store: VersionStore, versions: list[Version], policy: Policy) -> dict[str, str]:
    """What stays whole, and why."""
    names = store.registry.aliases()
    oldest_kept = store.now() - timedelta(days=policy.older_than_days)
    reasons: dict[str, str] = {}
    for version in versions:
        if version.created is not None and datetime.fromisoformat(version.created) >= oldest_kept:
            reasons[version.id] = f"younger than {policy.older_than_days:g} days"
    newest = versions[max(0, len(versions) - policy.keep) :]
    reasons |= {version.id: f"among the newest {policy.keep}" for version in newest}
    reasons |= dict.fromkeys(names.promoted[-KEPT_TO_ROLL_BACK_TO:], "one of the last promotions")
    for name, version in names.as_dict().items():
        reasons[version] = name
    return reasons


def _ever_promoted(registry: Registry) -> set[str]:
    found: set[str] = set()
    for decision in registry.decisions().decisions:
        if decision.what in ("promoted", "rolled_back") and decision.version:
            found.add(decision.version)
        found |= set(decision.promoted)
    return found
