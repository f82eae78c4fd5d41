"""What all offline work begins with: a twin, and recordings aligned to it."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_daemon.errors import BadInput, UsageError

if TYPE_CHECKING:
    from twin_daemon.comparison.region import Region
    from twin_daemon.estimation.estimate import Correlated
    from twin_daemon.estimation.variables import Remembered
    from twin_daemon.hand import Hand
    from twin_daemon.simulation.alignment import Aligned
    from twin_daemon.simulation.twin import TwinModel
    from twin_daemon.versions import ParameterRecord, PosteriorRecord, RecordingUsed, VersionStore

log = logging.getLogger("twin")


@dataclass(frozen=True)
class Session:
    """A hand, the twin in question, the version it came from (None: the nominal model), and the hand's store."""

    hand: Hand
    twin: TwinModel
    version: str | None
    store: VersionStore
    joint_map: Path | None

    def recordings(self, paths: Sequence[Path], trajectory: str | None) -> list[Aligned]:
        """Loads and aligns recordings. A trajectory stands in where a recording holds no commands."""
        from twin_daemon.recordings import load_joint_map, load_recording
        from twin_daemon.signals.trajectory import load_trajectory
        from twin_daemon.simulation.alignment import align

        names = load_joint_map(self.joint_map) if self.joint_map else None
        out = []
        for path in paths:
            recording = load_recording(path, names)
            motion = load_trajectory(trajectory, self.hand) if trajectory and recording.commands is None else None
            out.append(align(self.twin, recording, motion))
        return out

    @property
    def region(self) -> Region | None:
        """What the session's version was fitted in; None where that is unknown, and for a twin that is no version."""
        return None if self.version is None else self.store.get(self.version).region

    def last_promoted(self) -> TwinModel | None:
        """The twin of the promoted version; None before the first promotion."""
        promoted = self.store.last_promoted()
        return None if promoted is None else self.twin.changed(_terms(promoted.terms))


def open_session(
    hand: str | None,
    model: Path | None,
    *,
    version: str | None = None,
    terms: Path | None = None,
    joint_map: Path | None = None,
    assumed: Mapping[str, Any] | None = None,
) -> Session:
    """The twin that a command works on: given terms, a given version, else the promoted one, else the nominal.

    `assumed` are fields of the hand's description for this command only; those of a section change it in part.
    """
    from twin_daemon.effects import reload_files
    from twin_daemon.hand import load_hand
    from twin_daemon.simulation.terms import load_terms
    from twin_daemon.simulation.twin import TwinModel
    from twin_daemon.versions import NOMINAL, VersionStore

    if version is not None and terms is not None:
        raise UsageError("--version and --terms exclude each other", todo="Give one of them")
    silence_mujoco()
    reload_files()
    found = load_hand(hand, model)
    store = VersionStore.of(found)
    if assumed:
        found = replace(found, description=found.description.assuming(assumed))
    nominal = TwinModel.load(found)
    if terms is not None:
        return Session(found, nominal.changed(load_terms(terms)), None, store, joint_map)
    record = store.get(version) if version is not None else store.current()
    if record.id == NOMINAL:
        return Session(found, nominal, None, store, joint_map)
    return Session(found, nominal.changed(_terms(record.terms)), record.id, store, joint_map)


def held_out(recorded: Sequence[Aligned], held: Sequence[Aligned]) -> tuple[list[Aligned], list[Aligned], list[str]]:
    """(recordings to fit, recordings to judge by, what has to be said about them): without any given a part of each."""
    from twin_daemon.comparison.split import hold_out

    if held:
        return list(recorded), list(held), []
    train, judged = hold_out(recorded)
    return (
        train,
        judged,
        ["no --holdout: every third stretch of each recording is held out, so the intervals are wider"],
    )


def in_turn(recorded: Sequence[Aligned], held: Sequence[Aligned]) -> tuple[list[Aligned], list[Aligned], list[str]]:
    """As `held_out`, but of several recordings without any given, each is held out in turn: both lists are all."""
    if held or len({r.recording.sha256 for r in recorded}) < 2:
        return held_out(recorded, held)
    note = "no --holdout: each recording is predicted by what the others say, in turn, and the worst one counts"
    return list(recorded), list(recorded), [note]


def take_turns(train: Sequence[Aligned], held: Sequence[Aligned]) -> bool:
    """Whether the recordings to judge by are those that are fitted, each in turn."""
    return any(one is other for one in held for other in train)


def used(recordings: Sequence[Aligned]) -> tuple[RecordingUsed, ...]:
    """The recordings as a version names them."""
    from twin_daemon.versions import RecordingUsed

    return tuple(RecordingUsed(name=r.recording.name, sha256=r.recording.sha256) for r in recordings)


def region_after(session: Session, twin: TwinModel, recordings: Sequence[Aligned]) -> Region | None:
    """What a twin was fitted in after a fit to recordings: where these leave joints still, what was known before."""
    from twin_daemon.comparison.region import region_of
    from twin_daemon.simulation.alignment import moving_joints

    own = region_of(twin, recordings)
    return session.region if own is None else own.beside(session.region, moving_joints(recordings))


def known_after(
    session: Session, parameters: Mapping[str, ParameterRecord], correlations: Sequence[Correlated] = ()
) -> PosteriorRecord:
    """How sure the session's version is after a fit: what that could not see is as sure as it was, widened by time."""
    from twin_daemon.versions.posterior import after_fit, posterior_of

    before = None if session.version is None else session.store.get(session.version)
    return after_fit(parameters, correlations, None if before is None else posterior_of(before, session.store.now()))


def remembered(session: Session) -> dict[str, Remembered]:
    """What the session's version knows of its values by name, widened by the time since; nothing without a version.

    Sessions differ without wear, by as much as this hand's versions say.
    """
    from twin_daemon.estimation.variables import Remembered
    from twin_daemon.versions.posterior import posterior_of
    from twin_daemon.versions.spread import spread_between_sessions
    from twin_daemon.versions.trend import USUAL_SPREAD

    if session.version is None:
        return {}
    known = posterior_of(session.store.get(session.version), session.store.now())
    spread = spread_between_sessions(session.store) or USUAL_SPREAD
    return {
        name: Remembered(mean, math.hypot(known.covariance[i][i] ** 0.5, spread * mean))
        for i, (name, mean) in enumerate(zip(known.names, known.means, strict=True))
    }


def silence_mujoco() -> None:
    """MuJoCo would print its warnings and write them into the working folder; roll-outs are watched for them.

    A search tries models that diverge: that is what it learns from.
    """
    import mujoco

    mujoco.set_mju_user_warning(lambda message: log.debug("MuJoCo: %s", message))


def _terms(stored: dict):
    from pydantic import ValidationError

    from twin_daemon.simulation.terms import Terms

    try:
        return Terms.model_validate(stored)
    except ValidationError as error:
        raise BadInput(
            f"the version's terms cannot be read: {error.errors()[0]['msg']}", todo="twin versions verify"
        ) from None
