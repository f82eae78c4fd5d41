"""The versions of a hand as a list."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin_daemon.versions import Version, VersionStore


def listed(store: VersionStore) -> dict[str, Any]:
    """What the list writes."""
    found = store.everything()
    versions, notes = store.in_order(found), store.notes()
    names, shipped = store.all_names(), store.all_shipped()
    rows = [
        {
            **_summary(version),
            "names": names.get(version.id, []),
            "shipped": version.id in shipped,
            "stub": version.id in found.stubs,
            "notes": notes.get(version.id, []),
        }
        for version in versions
    ]
    return {"hand": store.hand, "versions": rows, "aliases": store.aliases(), "problems": found.problems}


def _summary(version: Version) -> dict[str, Any]:
    return version.model_dump(
        include={"id", "kind", "title", "created", "parent", "errors", "fitted_on", "held_out_on"}, mode="json"
    )
