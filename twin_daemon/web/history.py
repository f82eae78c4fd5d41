"""Versions: as a tree, their parameters over time, what differs between two, promotion and the way back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute

from twin_daemon.errors import BadInput
from twin_daemon.versions import NOMINAL, Version, VersionStore, diff
from twin_daemon.versions.aliases import CANDIDATE, CURRENT
from twin_daemon.versions.history import changing, history
from twin_daemon.versions.history_words import heading
from twin_daemon.versions.lineage import tree
from twin_daemon.versions.standing import known_errors, worse_than
from twin_daemon.versions.steps import error_of, error_steps
from twin_daemon.web.app import posting, reading

_MOST_DECISIONS = 500
_MOST_TEXT = 400


class History:
    """The questions of the view, and the two that change something."""

    def __init__(self, store: VersionStore, bands: Mapping[str, tuple[float | None, float | None]]) -> None:
        """`bands` are the limits of the hand's description, by the name of a parameter or a value of an effect."""
        self._store, self._bands = store, bands

    @property
    def routes(self) -> list[BaseRoute]:
        return [
            reading("/api/versions", lambda _: self._list()),
            reading("/api/versions/diff", self._diff),
            reading("/api/versions/parameter", self._parameter),
            reading("/api/versions/history", self._over_time),
            reading("/api/versions/ladder", self._ladder),
            reading("/api/versions/export", self._export),
            posting("/api/versions/note", self._note),
            posting("/api/versions/tag", self._tag),
            posting("/api/versions/untag", lambda body: {"version": self._store.remove_alias(_text(body, "name"))}),
            posting("/api/versions/promote", self._promote),
            posting("/api/versions/rollback", self._rollback),
        ]

    def _list(self) -> dict[str, Any]:
        """Every version under the one it was made from, `depth` deep; the oldest first."""
        versions, problems = self._store.survey()
        names, shipped = self._store.all_names(), self._store.all_shipped()
        current = next((v for v in versions if v.id == self._store.aliases()["current"]), None)
        known = known_errors(versions)
        notes = self._store.notes()
        rows: list[dict[str, Any]] = []
        waiting = [(branch, 0) for branch in reversed(tree(versions))]
        while waiting:
            branch, depth = waiting.pop()
            own = branch.version.id
            told = {"names": names.get(own, []), "shipped": own in shipped, "depth": depth}
            worse = None if current is None else worse_than(branch.version, current, known)
            told["worse"] = None if worse is None or own == NOMINAL else worse.words
            told["notes"] = [vars(note) for note in notes.get(own, [])]
            rows.append(_summary(branch.version) | told)
            waiting += [(child, depth + 1) for child in reversed(branch.children)]
        parameters = sorted({name for version in versions for name in _values(version)})
        log = self._store.decisions().decisions[-_MOST_DECISIONS:]
        decisions = [{name: getattr(one, name) for name in ("at", "what", "version", "name", "text")} for one in log]
        return {
            "versions": rows,
            "aliases": self._store.aliases(),
            "problems": problems,
            "parameters": parameters,
            "decisions": decisions,
        }

    def _diff(self, request: Request) -> dict[str, Any]:
        before, after = (self._store.get(request.query_params.get(name, "")) for name in ("before", "after"))
        old, new = _values(before), _values(after)
        held = {name: one for name, one in new.items() if name in old and old[name]["value"] == one["value"]}
        same = [f"{name} = {one['value']} {one['unit']}".strip() for name, one in held.items()]
        return {"before": before.id, "after": after.id, "words": diff(before, after).words, "same": same}

    def _parameter(self, request: Request) -> dict[str, Any]:
        """One parameter in every version that sets it, by the time at which they were made."""
        name = request.query_params.get("name", "")
        points = []
        for version in self._store.list():
            record = _values(version).get(name)
            if record is not None:
                points.append({"version": version.id, "created": version.created, **record})
        if not points:
            raise BadInput(f"no version sets '{name}'")
        return {"name": name, "points": points}

    def _over_time(self, request: Request) -> dict[str, Any]:
        """What changes from promotion to promotion, the most urgent first; or one parameter, by its `name`."""
        name = request.query_params.get("name", "")
        if name:
            found = [one for one in history(self._store, [name], limits=self._bands) if one.name == name]
        else:
            found = changing(self._store, self._bands)
        shown = ("name", "unit", "points", "levels", "steps", "band")
        return {"series": [{n: getattr(one, n) for n in shown} | {"words": heading(one)} for one in found]}

    def _ladder(self, request: Request) -> dict[str, Any]:
        """The errors from the nominal model to a version, one step for each version on the way."""
        version = self._store.get(request.query_params.get("version", ""))
        steps = []
        for one in error_steps(self._store, version):
            values = {} if one.version is None else _values(one.version)
            steps.append(
                {
                    "effect": one.title,
                    "target": one.version and one.version.short_id,
                    "parameters": {n: record["value"] for n, record in values.items() if record["ci95"] is not None},
                    "mse_rad2": one.mse_rad2,
                    "holdout_mse_rad2": one.holdout_mse_rad2,
                }
            )
        return {"version": version.id, "steps": steps}

    def _export(self, request: Request) -> Response:
        reference = request.query_params.get("version", "")
        version, mjcf = self._store.get(reference), self._store.model(reference)
        name = f"{version.hand}-{version.short_id}.xml"  # both are letters, digits and _.- alone
        headers = {"Content-Disposition": f'attachment; filename="{name}"'}
        return Response(mjcf, media_type="application/xml", headers=headers)

    def _note(self, body: dict[str, Any]) -> dict[str, Any]:
        return {"version": self._store.note(_text(body, "version"), _text(body, "text")).id}

    def _tag(self, body: dict[str, Any]) -> dict[str, Any]:
        """A name of one's own; those that promote have a way of their own."""
        name = _text(body, "name")
        if name in (CANDIDATE, CURRENT):
            raise BadInput(f"'{name}' cannot be given here", allowed="a name of your own", todo="Promote the version")
        return {"version": self._store.set_alias(name, _text(body, "version")).id}

    def _promote(self, body: dict[str, Any]) -> dict[str, Any]:
        force, reason = body.get("force") is True, str(body.get("reason") or "")[:400] or None
        return self._moved(self._store.promote(str(body.get("version", "")), reason=reason, force=force))

    def _rollback(self, body: dict[str, Any]) -> dict[str, Any]:
        return self._moved(self._store.rollback(reason=str(body.get("reason") or "")[:400] or None))

    def _moved(self, version: Version) -> dict[str, Any]:
        return {"current": version.id, "title": version.title or version.kind}


def _text(body: dict[str, Any], name: str) -> str:
    return str(body.get(name) or "")[:_MOST_TEXT]


def _summary(version: Version) -> dict[str, Any]:
    return {
        "id": version.id,
        "kind": version.kind,
        "title": version.title,
        "note": version.note,
        "created": version.created,
        "parent": version.parent,
        "effects": [f"{e.get('effect')} at {e.get('target')}" for e in version.terms.get("effects") or []],
        "errors": {name: error_of(version, name) for name in ("before", "after", "holdout_before", "holdout_after")},
        "fitted_on": [used.name for used in version.fitted_on],
    }


def _values(version: Version) -> dict[str, dict[str, Any]]:
    """Fitted and set parameters and the values of effects, by name."""
    found: dict[str, dict[str, Any]] = {
        name: {"value": value, "unit": "", "ci95": None} for name, value in version.sets().items()
    }
    for name, record in version.parameters.items():
        found[name] = {"value": record.value, "unit": record.unit, "ci95": record.ci95}
    return found
