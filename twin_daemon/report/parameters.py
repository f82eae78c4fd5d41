"""The numbers that make a twin: what is set on top of the nominal model, with what is known of each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from twin_daemon.effects import LIBRARY
from twin_daemon.errors import BadInput
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import Version


@dataclass(frozen=True)
class ParameterRow:
    """One parameter in `unit`. `plain` is the nominal model's value, or the one at which an effect does nothing."""

    name: str
    value: float | None
    unit: str
    plain: float | None
    ci95: tuple[float, float] | None
    lower: float | None
    upper: float | None
    at_bound: bool
    identifiable: str | None


def parameter_rows(twin: TwinModel, version: Version | None) -> list[ParameterRow]:
    """What was fitted, with intervals and bounds, then what is set without having been fitted here."""
    nominal = twin.changed(Terms())
    rows = []
    fitted = version.parameters if version is not None else {}
    for name, record in fitted.items():
        known, plain, lower, upper = _known(nominal, name)
        rows.append(
            ParameterRow(
                name=name,
                value=record.value,
                unit=record.unit or known,
                plain=plain,
                ci95=record.ci95,
                lower=record.lower if record.lower is not None else lower,
                upper=record.upper if record.upper is not None else upper,
                at_bound=record.at_bound,
                identifiable=_said(record.identifiable),
            )
        )
    for name, value in _set(twin.terms):
        if name not in fitted:
            unit, plain, lower, upper = _known(nominal, name)
            rows.append(ParameterRow(name, value, unit, plain, None, lower, upper, value in (lower, upper), None))
    return rows


def _set(terms: Terms) -> Iterator[tuple[str, float]]:
    yield from terms.parameters.items()
    for term in terms.effects:
        for name, value in term.values.items():
            yield f"{term.effect}:{term.target}.{name}", value


def _known(nominal: TwinModel, name: str) -> tuple[str, float | None, float | None, float | None]:
    """(unit, plain value, lower, upper) of a parameter or of an effect's value; unknown for a group's."""
    effect, colon, place = name.partition(":")
    if colon:
        known = {p.name: p for p in LIBRARY[effect].parameters} if effect in LIBRARY else {}
        found = known.get(place.rpartition(".")[2])
        return (found.unit, found.neutral, found.lower, found.upper) if found else ("", None, None, None)
    try:
        reference = nominal.parameter(name)
    except BadInput:
        return "", None, None, None
    return reference.kind.unit, reference.read(nominal.base_model), *reference.limits


def _said(identifiable: bool | str | None) -> str | None:
    if isinstance(identifiable, str) or identifiable is None:
        return identifiable
    return "identifiable" if identifiable else "not identifiable"
