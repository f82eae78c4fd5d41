"""`twin diagnose --baseline R...` and `--since VERSION|DATE`: what has changed between two sessions."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin_daemon.errors import BadInput, UsageError
from twin_daemon.resources import state_dir
from twin_daemon.workflows.session import Session, open_session

if TYPE_CHECKING:
    from twin_daemon.changes.answer import Since
    from twin_daemon.changes.group import Believed
    from twin_daemon.simulation.alignment import Aligned
    from twin_daemon.versions import Version, VersionStore


@dataclass(frozen=True)
class Earlier:
    """What a session is compared with: recordings, or a version in their place with what it says of its values."""

    recordings: tuple[Aligned, ...] = ()
    version: str | None = None
    at: datetime | None = None  # of the version, where it stands for recordings
    believed: Believed | None = None
    note: str | None = None


def require_one(
    since: str | None,
    baseline: Sequence[Path] | None,
    version: str | None,
    terms: Path | None,
    cluster: str | None,
) -> None:
    """Raises UsageError for options that exclude each other."""
    if since is not None and baseline:
        raise UsageError("--since and --baseline exclude each other", todo="Give one of them")
    if since is not None and (version is not None or terms is not None):
        raise UsageError("--since names the version that is started from", todo="Leave --version and --terms away")
    if cluster is not None:
        raise UsageError("--cluster: two sessions are compared on this machine only", todo="Leave it away")


def version_since(store: VersionStore, reference: str) -> Version:
    """The version by a name or an id; by a date (2026-11-12, with a time if wanted) the one promoted last until then.

    Raises BadInput for a date before the first promotion, and for what is neither.
    """
    from twin_daemon.versions.history import promotions

    at = _date(reference)
    if at is None:
        return store.get(reference)
    until = [promotion for promotion in promotions(store) if promotion.at <= at]
    if not until:
        first = next((f"{p.at:%Y-%m-%d}" for p in promotions(store)), None)
        raise BadInput(
            f"no version of {store.hand} was promoted before {reference}",
            allowed=f"{first} or later" if first else "a version: nothing has been promoted yet",
            todo="twin versions list shows them; or give the earlier recording itself with --baseline",
        )
    return until[-1].version


def earlier_of(
    session: Session, baseline: Sequence[Path] | None, since: Version | None, trajectory: str | None
) -> Earlier:
    """What the session is compared with. A version's own recordings, where they are still there, say more than it."""
    if since is None:
        return Earlier(tuple(session.recordings(baseline or [], trajectory)))
    found = [path for used in since.fitted_on for path in _kept(session.hand.name, used.name)]
    wanted = {used.sha256 for used in since.fitted_on}
    read = [r for r in session.recordings(found, trajectory) if r.recording.sha256 in wanted]
    if read and {r.recording.sha256 for r in read} == wanted:
        return Earlier(tuple(read), since.id)
    from twin_daemon.changes.remembered import believed
    from twin_daemon.versions.posterior import intervals, posterior_of

    note = "the version's recordings are not at hand, so that its values stand for them: intervals are wider"
    known = believed(session.twin, intervals(posterior_of(since, session.store.now())))
    at = None if since.created is None else datetime.fromisoformat(since.created)
    return Earlier((), since.id, at, known, note)


def diagnosed_since(
    session: Session,
    recorded: Sequence[Aligned],
    held: Sequence[Aligned],
    earlier: Earlier,
    joints: Sequence[str] | None,
    seed: int,
    within_s: float | None,
    covariate: Path | None = None,
) -> tuple[dict[str, Any], Since]:
    """(what the command writes, the same as values). `covariate` is a file of temperatures by time."""
    from twin_daemon.changes.search import changes_since
    from twin_daemon.changes.thresholds import COLD_TO_WARM, SPIKE
    from twin_daemon.processor_time import TimeLimit
    from twin_daemon.versions.spread import spread_between_sessions
    from twin_daemon.workflows.diagnosis import ended_early, joint_names, read_from
    from twin_daemon.workflows.progress import streaming

    _require_another(recorded, earlier.recordings)
    spread = spread_between_sessions(session.store)
    warmed = COLD_TO_WARM if covariate is None else _warmed(covariate, recorded, earlier)
    began = time.perf_counter()
    with streaming() as say:
        found = changes_since(
            session.twin,
            earlier.recordings,
            recorded,
            held,
            joints=joint_names(session.twin, joints),
            believed=earlier.believed,
            spread=SPIKE if spread is None else spread,
            seed=seed,
            warmed=warmed,
            stream=say,
            limit=TimeLimit(wall_s=within_s),
        )
    notes = [*found.notes, *([earlier.note] if earlier.note else []), *ended_early(found, within_s)]
    about = {
        "hand": session.hand.name,
        "version": session.version,
        "seed": seed,
        "terms": session.twin.terms,
        "fitted_on": read_from(recorded),
        "held_out_on": read_from(held),
        "baseline": read_from(earlier.recordings),
        "since_version": earlier.version,
        "spread_between_sessions": spread,
    }
    found = found.model_copy(update={"notes": tuple(notes), **about})
    return {**found.model_dump(by_alias=True), "wall_s": time.perf_counter() - began}, found


def open_since(reference: str | None, hand: str | None, model: Path | None, **options: Any) -> tuple[Session, Any]:
    """(the session that a command works on, the version that is compared with, if any): that version's own twin."""
    session = open_session(hand, model, **options)
    if reference is None:
        return session, None
    since = version_since(session.store, reference)
    opened = open_session(hand, model, **{**options, "version": since.id})
    return replace(opened, store=session.store), since


def _warmed(path: Path, recorded: Sequence[Aligned], earlier: Earlier) -> float:
    """By how many of its own standard deviations a covariate differs between the sessions."""
    from twin_daemon.versions.covariate import read_covariate

    covariate = read_covariate(path)
    before = [one.recording.began for one in earlier.recordings] or ([earlier.at] if earlier.at else [])
    if not before:
        raise BadInput(
            f"version {earlier.version} is of no day, so that {path} cannot say how warm it was",
            where="--covariate",
            todo="Leave it away, or compare with a version that was fitted, or with a recording (--baseline)",
        )
    then, now = (
        float(np.mean([covariate.at(when) for when in begins]))
        for begins in (before, [one.recording.began for one in recorded])
    )
    return abs(now - then) / max(covariate.spread, 1e-12)


def _require_another(recorded: Sequence[Aligned], baseline: Sequence[Aligned]) -> None:
    same = {r.recording.sha256 for r in recorded} & {r.recording.sha256 for r in baseline}
    if same:
        name = next(r.recording.name for r in recorded if r.recording.sha256 in same)
        raise BadInput(
            "the same recording is the earlier session and the later one",
            where=name,
            todo="Give a recording of the healthy hand with --baseline, and a later one with --recording",
        )


def _kept(hand: str, name: str) -> list[Path]:
    """Files of a recording's name in the state folder."""
    folders = (state_dir() / "recordings", state_dir() / "hands" / hand / "recordings", Path.cwd())
    return [path for folder in folders for path in sorted(folder.glob(f"{name}*")) if path.exists()][:4]


def _date(text: str) -> datetime | None:
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        return None
    if len(text) == len("2026-11-12"):
        found = found.replace(hour=23, minute=59, second=59)  # the day itself counts
    return found if found.tzinfo else found.replace(tzinfo=UTC)
