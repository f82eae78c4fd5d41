"""`twin consent`: whether the twin may move the hand by itself."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from twin_daemon.cli.command import Group
from twin_daemon.cli.console import emit_json, people, plain_text
from twin_daemon.cli.options import HandName, Json, Model, Namespace
from twin_daemon.cli.run import hand_folder, load_named
from twin_daemon.errors import BadInput

app = Group(
    "Consent to motion that the twin begins by itself (recalibration.mode: active), given on this machine only."
)


@app.command("give")
def give(
    person: Annotated[str, typer.Option("--name", metavar="PERSON", help="Who answers for it.")],
    until: Annotated[str, typer.Option("--until", metavar="YYYY-MM-DD", help="The last day of it, UTC.")],
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    json: Json = None,
) -> None:
    """Consent to motion that the twin begins by itself, until a day. Each is announced, and anybody may cancel it."""
    from twin_daemon.daemon import consent

    path = _file(hand, model, namespace)
    try:
        given = consent.give(path, person, consent.end_of(until), datetime.now(UTC))
    except OSError as error:
        raise BadInput(f"the consent cannot be written: {error.strerror}", where=path) from None
    emit_json(json, {"schema": 1, "given": True, **given.model_dump(mode="json", exclude={"schema_"})})
    people(json).print(
        plain_text(f"{given.in_words()}. The hand may move by itself; 'twin consent withdraw' takes it back")
    )


@app.command("show")
def show(hand: HandName = None, model: Model = None, namespace: Namespace = None, json: Json = None) -> None:
    """Who has consented, and until when."""
    from twin_daemon.daemon.consent import NoConsent, standing

    try:
        found = standing(_file(hand, model, namespace), datetime.now(UTC))
    except NoConsent as error:
        emit_json(json, {"schema": 1, "given": False, "why": str(error)})
        people(json).print(plain_text(str(error)))
        return
    emit_json(json, {"schema": 1, "given": True, **found.model_dump(mode="json", exclude={"schema_"})})
    people(json).print(plain_text(found.in_words()))


@app.command("withdraw")
def withdraw(hand: HandName = None, model: Model = None, namespace: Namespace = None, json: Json = None) -> None:
    """Take the consent back. A motion of the twin's own that is announced or under way ends within a second."""
    from twin_daemon.daemon import consent

    path = _file(hand, model, namespace)
    try:
        was = consent.withdraw(path)
    except OSError as error:
        raise BadInput(f"the consent cannot be removed: {error.strerror}", where=path) from None
    emit_json(json, {"schema": 1, "given": False, "withdrawn": was})
    people(json).print("withdrawn; the hand does not move by itself" if was else "there was none")


def _file(hand: str | None, model: Path | None, namespace: str | None) -> Path:
    from twin_daemon.daemon.consent import CONSENT

    return hand_folder(load_named(hand, model, namespace).description.namespace) / CONSENT
