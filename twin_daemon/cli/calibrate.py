"""`twin calibrate`: fit the model's parameters to recordings and store the result as a version."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli import options
from twin_daemon.cli.check import warn_before_fit
from twin_daemon.cli.commanding import As
from twin_daemon.cli.console import emit_json, people, plain_text, progress_console
from twin_daemon.cli.drive import drive
from twin_daemon.cli.run import Endpoint, Namespace
from twin_daemon.cli.session import Session, open_session, require_folder
from twin_daemon.cli.tables import by_kind, place_of, slim_table
from twin_daemon.errors import UsageError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import TaskID

    from twin_daemon.calibration.calibrate import Calibration
    from twin_daemon.estimation.solvers.tracker import Progress
    from twin_daemon.estimation.uncertainty import Estimate
    from twin_daemon.simulation.alignment import Aligned
    from twin_daemon.versions import Proposed

SearchName = Annotated[
    str, typer.Option("--search", metavar="bayes|least-squares|random|pso", help="How the parameters are searched.")
]

Run = Annotated[
    str | None,
    typer.Option("--run", metavar="NAME", help="Drive the hand along this trajectory through the gate, and fit that."),
]


def command(
    recording: options.OptionalRecordings = None,
    run: Run = None,
    holdout: options.Holdouts = None,
    search: SearchName = "least-squares",
    space: options.Space = "physical",
    budget: options.Budget = None,
    seed: options.Seed = 0,
    hand: options.HandName = None,
    model: options.Model = None,
    version: options.VersionRef = None,
    terms: options.Terms = None,
    trajectory: options.TrajectoryRef = None,
    joint_map: options.JointMap = None,
    name: As = "operator",
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    cluster: options.Cluster = None,
    json: options.Json = None,
) -> None:
    """Fit parameters, test them on validation data, and store the result as a candidate version.

    With --run the hand itself is driven along a trajectory, through the gate, and what it does is recorded first.
    Ctrl-C keeps the best so far. Without --holdout every third stretch of time of the recordings is held out.
    """
    from twin_daemon.calibration.spaces import load_space

    require_folder(json)
    if not recording and run is None:
        raise UsageError("nothing to fit", todo="Give --recording R..., or --run NAME to drive the hand")
    load_space(space or "physical")  # before the hand is driven for it
    session = open_session(hand, model, version=version, terms=terms, joint_map=joint_map)
    driven = [] if run is None else [drive(run, hand, model, namespace, endpoint, name)]
    train = session.recordings([*(recording or []), *driven], trajectory)
    held = session.recordings(holdout or [], trajectory)
    payload, result = calibrated(session, train, held, search, space or "physical", budget, seed, cluster)
    _show(payload, result, json)
    emit_json(json, payload)


def calibrated(
    session: Session,
    train: list[Aligned],
    held: list[Aligned],
    search: str,
    space: str,
    budget: int | None,
    seed: int,
    cluster: str | None = None,
) -> tuple[dict[str, Any], Calibration]:
    """(what the command writes, the same as values); the version is stored."""
    from twin_daemon.calibration.calibrate import calibrate
    from twin_daemon.calibration.spaces import load_space
    from twin_daemon.comparison.split import hold_out
    from twin_daemon.executor import on_cluster

    chosen = load_space(space)
    notes = warn_before_fit(session, train)
    if not held:
        train, held = hold_out(train)
        notes.append("no --holdout: every third stretch of each recording is held out, so the intervals are wider")
    with on_cluster(cluster), progress_bar(f"{search} over '{chosen.name}'", budget) as report:
        result = calibrate(session.twin, train, held, chosen, search, budget=budget, seed=seed, progress=report)
    stored = _store(session, result, train, held, chosen.name, search, budget, seed)
    return _payload(result, stored, notes, chosen.name, search, seed), result


class progress_bar:
    """A progress bar on standard error with the best error so far; nothing is drawn before there is one."""

    def __init__(self, label: str, budget: int | None) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("best {task.fields[best]}"),
            TimeElapsedColumn(),
            console=progress_console(),
        )
        self._label, self._budget = plain_text(label), budget
        self._task: TaskID | None = None

    def __enter__(self) -> Progress:
        return self._report

    def _report(self, count: int, best: float) -> None:
        if self._task is None:
            self._task = self._progress.add_task(self._label, total=self._budget, best="-")
            self._progress.start()
        self._progress.update(self._task, completed=count, best=f"{best:.4g} rad²")

    def __exit__(self, *_: object) -> None:
        if self._task is not None:
            self._progress.stop()


def _store(
    session: Session,
    result: Calibration,
    train: list[Aligned],
    held: list[Aligned],
    space: str,
    search: str,
    budget: int | None,
    seed: int,
) -> Proposed:
    """Stores the calibration, as the candidate where it is better."""
    from twin_daemon.versions import Draft, ParameterRecord, RecordingUsed

    twin = session.twin.changed(result.terms)
    draft = Draft(
        hand=session.hand.name,
        kind="calibrated",
        terms=result.terms.as_json(),
        parent=session.version,
        title=f"{search} over '{space}'",
        parameters={
            name: ParameterRecord(
                value=p.value,
                unit=p.unit,
                lower=p.lower,
                upper=p.upper,
                at_bound=p.at_bound,
                ci95=p.ci95,
                identifiable=p.identifiable,
            )
            for name, p in result.parameters.items()
        },
        fitted_on=tuple(RecordingUsed(name=r.recording.name, sha256=r.recording.sha256) for r in train),
        held_out_on=tuple(RecordingUsed(name=r.recording.name, sha256=r.recording.sha256) for r in held),
        errors=_errors_to_keep(result),
        search={"name": search, "space": space, "budget": budget, "evaluations": result.evaluations},
        seed=seed,
    )
    return session.store.propose(draft, twin.mjcf())


def errors(result: Calibration) -> dict[str, Any]:
    """Errors before and after, on what was fitted and on what was held out."""
    return {
        "before": {"mse_rad2": result.before_rad2},
        "after": {"mse_rad2": result.after_rad2},
        "holdout_before": {"mse_rad2": result.holdout_before_rad2},
        "holdout_after": {"mse_rad2": result.holdout_after_rad2},
    }


def _errors_to_keep(result: Calibration) -> dict[str, Any]:
    """What a version keeps: the errors, the joints they are of, and those of its parent where it began elsewhere."""
    found = {**errors(result), "joints": list(result.objective)}
    if result.given_rad2 == result.before_rad2 and result.holdout_given_rad2 == result.holdout_before_rad2:
        return found
    given = {"mse_rad2": result.given_rad2}
    return {**found, "given": given, "holdout_given": {"mse_rad2": result.holdout_given_rad2}}


def _payload(
    result: Calibration, stored: Proposed, notes: list[str], space: str, search: str, seed: int
) -> dict[str, Any]:
    return {
        **errors(result),
        "objective": result.objective,
        "search": search,
        "space": space,
        "seed": seed,
        "evaluations": result.evaluations,
        "wall_s": result.wall_s,
        "interrupted": result.interrupted,
        "onset_s": result.onsets_s,
        "parameters": fitted_values(result.parameters),
        "history": result.history,
        "version": stored.version.id,
        "candidate": stored.candidate,
        "notes": notes,
    }


def fitted_values(parameters: Mapping[str, Estimate]) -> dict[str, dict[str, Any]]:
    """Fitted parameters by name, as the contract spells them."""
    return {
        name: {
            "value": p.value,
            "unit": p.unit,
            "lower": p.lower,
            "upper": p.upper,
            "at_bound": p.at_bound,
            "ci95": list(p.ci95),
            "identifiable": p.identifiable == "identifiable",
            "identifiability": p.identifiable,
            "confused_with": p.confused_with,
        }
        for name, p in parameters.items()
    }


def _said(parameter: Estimate) -> str:
    words = (parameter.identifiable or "").replace("_", " ")
    if parameter.at_bound:
        words += ", on its bound"
    if parameter.confused_with:
        words += f", trades off with {plain_text(parameter.confused_with)}"
    return words


def _show(payload: dict[str, Any], result: Calibration, json: str | None) -> None:
    console = people(json)
    table = slim_table(
        f"parameters of '{payload['space']}'",
        ("parameter", "value", "95 % interval", "the data say"),
        words=("the data say",),
    )
    for kind, names in by_kind(list(result.parameters)).items():
        table.add_row(f"[bold]{plain_text(kind)}[/], {result.parameters[names[0]].unit}", "", "", "")
        for name in names:
            p = result.parameters[name]
            span = f"{p.ci95[0]:.3g} .. {p.ci95[1]:.3g}"
            table.add_row(place_of(name), f"{p.value:.4g}", span, _said(p))
    console.print(table)
    console.print(f"fitted:   {result.before_rad2:.4g} -> [bold]{result.after_rad2:.4g} rad²[/]")
    if result.holdout_after_rad2 is not None:
        console.print(f"held out: {result.holdout_before_rad2:.4g} -> [bold]{result.holdout_after_rad2:.4g} rad²[/]")
    for note in payload["notes"]:
        console.print(f"note: {plain_text(note)}")
    if result.interrupted:
        console.print("interrupted: this is the best so far")
    console.print(f"{result.evaluations} roll-outs in {result.wall_s:.1f} s")
    say_stored(console, payload)


def say_stored(console: Console, payload: Mapping[str, Any]) -> None:
    """Under which id a result was stored, and whether it is the candidate."""
    short = payload["version"][:12]
    if payload["candidate"]:
        console.print(f"stored as candidate {short} (twin versions show {short}, twin versions promote)")
    else:
        console.print(f"[bold]not better on validation data[/]: stored as {short}, not as the candidate")
