"""Comparing, checking, calibrating and adding: what needs no search for a cause."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from twin_daemon.api.inputs import Recordings, Robot, Text, as_list, hand, of, opened, paths, trajectory_of
from twin_daemon.api.results import Addition, Calibration, Check, Comparison, Diagnosis
from twin_daemon.comparison.report import comparison_report
from twin_daemon.diagnosis.verdict import Diagnosis as Found
from twin_daemon.errors import UsageError
from twin_daemon.workflows.calibration import calibrated
from twin_daemon.workflows.change import added_to
from twin_daemon.workflows.data_check import checked
from twin_daemon.workflows.take_over import Taken


def compare(recording: Recordings, *, version: str | None = None, terms: Text | None = None) -> Comparison:
    """How far the twin is from measurements, joint by joint, as `twin compare`.

    `recording`: one or several of the same robot. `version`: an id, the start of one, or a name; default the
    version in use. `terms`: a file of parameters and effects instead. Raises BadInput for a recording, version or
    file that cannot be used, UsageError for no recording or recordings of different robots.
    """
    recordings, robot = of(recording)
    session = opened(robot, version, terms, recordings)
    aligned = session.recordings(paths(recordings), trajectory_of(recordings))
    report, compared = comparison_report(session.twin, aligned, session.last_promoted(), session.region)
    return Comparison.of({**report, "version": session.version}, compared)


def check(
    recording: Recordings, *, space: str = "physical", version: str | None = None, terms: Text | None = None
) -> Check:
    """What recordings can tell of parameters, before any fit, as `twin check`.

    `space`: which parameters: a name ("physical", "inertial", "thumb", ...) or a YAML file. `version`, `terms`
    and errors are as for `compare`.
    """
    recordings, robot = of(recording)
    session = opened(robot, version, terms, recordings)
    return Check.made_of(checked(session, session.recordings(paths(recordings), trajectory_of(recordings)), space))


def calibrate(
    recording: Recordings,
    holdout: Recordings | None = None,
    *,
    space: str = "physical",
    search: str = "least-squares",
    budget: int | None = None,
    seed: int = 0,
    version: str | None = None,
    terms: Text | None = None,
) -> Calibration:
    """Fits parameters to recordings and stores the result as a version, as `twin calibrate`.

    `holdout`: validation data; without it every third stretch of the recordings is held out. `space`: which
    parameters may move, a name or a YAML file. `search`: "least-squares", "bayes", "random" or "pso". `budget`:
    the largest number of roll-outs. The same `seed` gives the same result. Progress is on standard error.
    `version`, `terms` and errors are as for `compare`.
    """
    recordings, robot = of(recording)
    held = as_list(holdout)
    session = opened(robot, version, terms, [*recordings, *held])
    trajectory = trajectory_of(recordings)
    train, seen = (session.recordings(paths(each), trajectory) for each in (recordings, held))
    return Calibration.made_of(calibrated(session, train, seen, search, space, budget, seed)[0])


def add(
    effect: str | None = None,
    joints: str | Sequence[str] = (),
    recording: Recordings | None = None,
    holdout: Recordings | None = None,
    *,
    values: Mapping[str, float] | None = None,
    finding: Diagnosis | None = None,
    rank: int = 1,
    robot: Robot | None = None,
    version: str | None = None,
    terms: Text | None = None,
) -> Addition:
    """Puts an effect into the twin and stores the result as a version, as `twin add`.

    `effect`: a key of the library (`twin effects`). `joints`: where it acts; "robot" for all servos alike, "hand"
    for effects of the whole hand. `values`: the effect's parameters, each in its own unit. With a `recording`
    those that `values` does not give are fitted, with `holdout` as validation data; without one they take typical
    values. `finding` takes the finding of that `rank`, from 1, of a diagnosis over as it is, and nothing is
    fitted. `robot` says of which robot where there is no recording. Raises BadInput where the effect cannot act,
    UsageError for nothing to add.
    """
    recordings, held = as_list(recording), as_list(holdout)
    if recordings:
        robot = recordings[0].robot
    elif robot is None:
        robot = (finding and finding.of_robot) or hand()
    taken = None if finding is None else _taken(finding, rank)
    if taken is not None and values:
        raise UsageError("a finding has its values", todo="Leave values out, or fit anew without finding")
    if taken is not None and version is None and terms is None:
        version = taken.version
    session = opened(robot, version, terms, [*recordings, *held])
    places, fitted, seen = [joints] if isinstance(joints, str) else list(joints), paths(recordings), paths(held)
    if taken is not None:
        effect, places, fitted, seen = taken.wanted(effect, places, fitted, seen, session)
    if effect is None or not places:
        raise UsageError("nothing to add", todo="Give an effect and its joints, or a finding")
    trajectory = trajectory_of(recordings)
    return Addition.made_of(
        added_to(session, effect, places, values or {}, fitted, seen, trajectory=trajectory, taken=taken)
    )


def _taken(found: Diagnosis, rank: int) -> Taken:
    diagnosis = Found.model_validate(found.as_json())
    if not 1 <= rank <= len(diagnosis.findings):
        raise UsageError(f"the diagnosis has no finding {rank}", allowed=f"1 to {len(diagnosis.findings)}")
    return Taken(diagnosis.findings[rank - 1], diagnosis, Path("the diagnosis"))
