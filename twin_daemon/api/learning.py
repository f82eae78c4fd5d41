"""Diagnosing, the ladder, and the versions that come of it."""

from __future__ import annotations

from collections.abc import Sequence

from twin_daemon.api.inputs import Recordings, Robot, Text, as_list, hand, of, opened, paths, trajectory_of
from twin_daemon.api.results import Diagnosis, Ladder, Versions
from twin_daemon.versions import VersionStore
from twin_daemon.workflows.diagnosis import judged
from twin_daemon.workflows.ladder import laddered
from twin_daemon.workflows.versions import listed


def diagnose(
    recording: Recordings,
    holdout: Recordings | None = None,
    *,
    joints: Sequence[str] = (),
    seed: int = 0,
    version: str | None = None,
    terms: Text | None = None,
) -> Diagnosis:
    """Which effects the twin lacks, with evidence, or that the data cannot tell, as `twin diagnose`. Stores no version.

    `holdout`: validation data; without it each of several recordings is held out in turn, of one every third stretch.
    `joints`: only these. The same `seed` gives the same answer. `version`: the twin that is diagnosed, default the
    one in use; `terms`: a file of parameters and effects instead. Candidates appear on standard error. Raises BadInput
    for a recording, version or file that cannot be used, UsageError for no recording or recordings of different robots.
    """
    recordings, robot = of(recording)
    held = as_list(holdout)
    session = opened(robot, version, terms, [*recordings, *held])
    trajectory = trajectory_of(recordings)
    recorded = session.recordings(paths(recordings), trajectory)
    return Diagnosis.of(judged(session, recorded, paths(held), trajectory, list(joints), seed)[0], robot)


def ladder(
    recording: Recordings,
    holdout: Recordings | None = None,
    *,
    max_steps: int = 6,
    seed: int = 0,
    version: str | None = None,
    terms: Text | None = None,
) -> Ladder:
    """Diagnoses, adds an effect, refits, and again, until nothing helps on validation data, as `twin ladder`.

    Stores the result as a version. `max_steps`: the largest number of effects. The other arguments and errors are
    as for `diagnose`.
    """
    recordings, robot = of(recording)
    held = as_list(holdout)
    session = opened(robot, version, terms, [*recordings, *held])
    trajectory = trajectory_of(recordings)
    whole = session.recordings(paths(recordings), trajectory)
    return Ladder.made_of(laddered(session, whole, paths(held), trajectory, max_steps, seed)[0])


def versions(robot: Robot | None = None) -> Versions:
    """Every version of a robot's twin, as `twin versions list`; of the Shadow Hand where none is given."""
    return Versions.made_of(listed(VersionStore.of((robot or hand()).description)))
