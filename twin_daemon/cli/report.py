"""`twin report`: what is known of a twin on one page that asks nobody for anything."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli import options
from twin_daemon.cli.console import emit_json, people, plain_text, require_folder
from twin_daemon.errors import BadInput, UsageError
from twin_daemon.workflows.session import Session, open_session

if TYPE_CHECKING:
    from twin_daemon.diagnosis.verdict import Diagnosis, LadderResult, Step
    from twin_daemon.report.reproduce import Recipe
    from twin_daemon.simulation.alignment import Aligned
    from twin_daemon.versions import Version

DiagnosisFile = Annotated[
    Path | None,
    typer.Option("--diagnosis", metavar="FILE.json", help="A finished diagnosis: what twin diagnose --json wrote."),
]
DiagnoseNow = Annotated[bool, typer.Option("--diagnose", help="Diagnose these recordings now (may take minutes).")]
LadderFile = Annotated[
    Path | None, typer.Option("--ladder", metavar="FILE.json", help="A finished ladder: what twin ladder --json wrote.")
]
ProposalsFile = Annotated[
    Path | None,
    typer.Option("--proposals", metavar="FILE.json", help="Proposed laws: what twin propose --json wrote."),
]
_MOST_SERIES = 8  # of the history that are drawn

Page = Annotated[Path, typer.Option("--output", "-o", metavar="FILE.html", help="Where to write the page.")]


def command(
    recording: options.Recordings,
    holdout: options.Holdouts = None,
    output: Page = Path("report.html"),
    diagnosis: DiagnosisFile = None,
    diagnose: DiagnoseNow = False,
    ladder: LadderFile = None,
    proposals: ProposalsFile = None,
    seed: options.Seed = 0,
    hand: options.HandName = None,
    model: options.Model = None,
    version: options.VersionRef = None,
    terms: options.Terms = None,
    trajectory: options.TrajectoryRef = None,
    joint_map: options.JointMap = None,
    json: options.Json = None,
) -> None:
    """Write one self-contained HTML page: the comparison, where the twin fails, its parameters, how to do it again.

    With a diagnosis, proposals or a ladder these stand on it as well. The page loads nothing from anywhere, works by
    keyboard, in light and dark, and prints.
    """
    if diagnosis is not None and diagnose:
        raise UsageError("--diagnosis and --diagnose exclude each other", todo="Give one of them")
    from twin_daemon.diagnosis.verdict import Diagnosis, LadderResult
    from twin_daemon.files import write_atomically
    from twin_daemon.proposals.proposal import Proposals
    from twin_daemon.report.finished import read_result
    from twin_daemon.report.motion import motion
    from twin_daemon.report.page import Content, render
    from twin_daemon.report.parameters import parameter_rows
    from twin_daemon.versions.history import changing

    require_folder(json, output)
    found = read_result(diagnosis, Diagnosis, "twin diagnose") if diagnosis else None
    grown = read_result(ladder, LadderResult, "twin ladder") if ladder else None
    laws = read_result(proposals, Proposals, "twin propose") if proposals else None
    session = open_session(hand, model, version=version, terms=terms, joint_map=joint_map)
    stored = session.store.get(session.version) if session.version is not None else None
    notes = [
        *(_notes(session, diagnosis, "diagnosis", found.hand, (found.version,)) if found else []),
        *(_notes(session, proposals, "search for a law", laws.hand, (laws.version,)) if laws else []),
        *(_notes(session, ladder, "ladder", grown.hand, (grown.parent, grown.version)) if grown else []),
    ]
    recorded = session.recordings(recording, trajectory)
    held = session.recordings(holdout or [], trajectory)
    if diagnose:
        found = _diagnosed(session, recorded, holdout, trajectory, seed)
    promoted = session.last_promoted()
    motions = [motion("recorded", session.twin, recorded, promoted)]
    if held:
        motions.append(motion("held out", session.twin, held, promoted))
    given = {
        "--hand": hand, "--model": model, "--version": session.version or (None if terms else "nominal"),
        "--terms": terms, "--recording": recording, "--trajectory": trajectory, "--joint-map": joint_map,
    }  # fmt: skip
    more = {
        "--holdout": holdout,
        "--diagnosis": diagnosis,
        "--diagnose": diagnose,
        "--ladder": ladder,
        "--proposals": proposals,
    }
    recipe = _recipe(session, stored, given, {**more, "--seed": seed if diagnose else None, "-o": output},
                     {"recorded": recorded, "held out": held}, found, grown)  # fmt: skip
    content = Content(
        hand=session.hand.name,
        motions=tuple(motions),
        version=stored,
        parameters=tuple(parameter_rows(session.twin, stored)),
        recipe=recipe,
        diagnosis=found,
        ladder=grown,
        proposals=laws,
        candidates=found.findings if found is not None and found.version == session.version and not terms else (),
        **_fall(session, stored, grown),
        notes=tuple(notes),
        history=tuple(changing(session.store, session.hand.description.bands)[:_MOST_SERIES]),
    )
    page = render(content).encode()
    write_atomically(output, page)
    result = {
        "path": output.absolute(),
        "bytes": len(page),
        "sha256": hashlib.sha256(page).hexdigest(),
        "sections": content.sections,
        "hand": session.hand.name,
        "version": session.version,
        "mse_rad2": motions[0].report["mse_rad2"],
        "holdout_mse_rad2": motions[1].report["mse_rad2"] if held else None,
        "notes": notes,
    }
    console = people(json)
    for note in notes:
        console.print(f"note: {plain_text(note)}")
    size = len(page) / 1e6
    console.print(f"{plain_text(output)}: {size:.1f} MB, with {', '.join(content.sections)}", soft_wrap=True)
    emit_json(json, result)


def _notes(
    session: Session, path: Path | None, what: str, hand: str | None, versions: tuple[str | None, ...]
) -> list[str]:
    """What a reader has to know of a result that was made elsewhere. BadInput where it is another hand's."""
    if path is None:
        return []
    if hand is not None and hand != session.hand.name:
        raise BadInput(
            f"this {what} is of the hand '{hand}', not of '{session.hand.name}'",
            where=path,
            todo="Give one of this hand, or name the hand with --hand",
        )
    if session.version in versions:
        return []
    of = " or ".join(version[:12] if version else "the nominal model" for version in versions)
    shown = session.version[:12] if session.version else "a model that is not stored"
    return [f"the {what} was made for {of}; the comparison on this page is of {shown}"]


def _fall(session: Session, stored: Version | None, ladder: LadderResult | None) -> dict[str, Any]:
    """The errors from the nominal model to this one: those of the ladder, else those kept with the versions."""
    from twin_daemon.versions.steps import error_steps

    if ladder is not None:
        told = [(_added(number, one), one.mse_rad2, one.holdout_mse_rad2) for number, one in enumerate(ladder.steps)]
    elif stored is not None:
        steps = error_steps(session.store, stored)
        told = [(f"+ {one.title}" if one.title else "nominal", one.mse_rad2, one.holdout_mse_rad2) for one in steps]
    else:
        return {}
    held_out = all(held is not None for _, _, held in told)
    errors = [(name, held if held_out else fitted) for name, fitted, held in told]
    if any(error is None for _, error in errors):
        return {}
    return {"steps": tuple(errors), "steps_held_out": held_out}


def _added(number: int, step: Step) -> str:
    if step.effect is None:
        return "all together" if number else "before"
    return f"+ {step.effect.replace('_', ' ')} at {step.target}"


def _diagnosed(
    session: Session, recorded: list[Aligned], holdout: list[Path] | None, trajectory: str | None, seed: int
) -> Diagnosis:
    from twin_daemon.cli.console import SCHEMA
    from twin_daemon.diagnosis.verdict import Diagnosis
    from twin_daemon.jsonable import plain
    from twin_daemon.workflows.diagnosis import judged

    payload, _ = judged(session, recorded, holdout, trajectory, None, seed)
    return Diagnosis.model_validate(plain({"schema": SCHEMA, **payload}))


def _recipe(
    session: Session,
    stored: Version | None,
    given: dict[str, Any],
    more: dict[str, Any],
    recordings: dict[str, list[Aligned]],
    diagnosis: Diagnosis | None,
    ladder: LadderResult | None,
) -> Recipe:
    from twin_daemon.report import reproduce
    from twin_daemon.signals.trajectory import trajectory_file

    commands = [reproduce.how_it_was_fitted(stored)] if stored is not None else []
    commands += [
        reproduce.command_line(["twin", "report"], {**given, **more}),
        reproduce.command_line(["twin", "compare"], {**given, "--json": "-"}),
    ]
    if more["--diagnose"]:
        options = {**given, "--holdout": more["--holdout"], "--seed": more["--seed"], "--json": "-"}
        commands.append(reproduce.command_line(["twin", "diagnose"], options))
    files = {
        "diagnosis": more["--diagnosis"],
        "ladder": more["--ladder"],
        "proposals": more["--proposals"],
        "model": given["--model"],
        "terms": given["--terms"],
        "joint map": given["--joint-map"],
        "trajectory": trajectory_file(given["--trajectory"]) if given["--trajectory"] else None,
    }
    went_in = reproduce.ingredients(stored, recordings)
    went_in += [
        reproduce.Ingredient(role, str(path), reproduce.sha256_of(path)) for role, path in files.items() if path
    ]
    mjcf = session.hand.model_path
    went_in.append(reproduce.Ingredient("the hand's MJCF", mjcf.name, reproduce.sha256_of(mjcf)))
    seeds = {
        "version": stored.seed if stored is not None else None,
        "diagnosis": diagnosis.seed if diagnosis is not None else None,
        "ladder": ladder.seed if ladder is not None else None,
    }
    return reproduce.recipe(commands, stored, seeds, went_in)
