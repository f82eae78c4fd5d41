"""What differs between two versions, in numbers and in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from twin_daemon.versions.version import ParameterRecord, Version


@dataclass(frozen=True)
class ParameterChange:
    """One parameter in both versions; a side is None where that version does not set it."""

    name: str
    unit: str
    before: float | None
    after: float | None
    ratio: float | None
    before_ci95: tuple[float, float] | None
    after_ci95: tuple[float, float] | None
    intervals_overlap: bool | None  # None where an interval is missing

    @property
    def words(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        if self.before is None or self.after is None:
            side, value, interval = (
                ("set", self.after, self.after_ci95)
                if self.before is None
                else ("no longer set", self.before, self.before_ci95)
            )
            return f"{self.name} {side}: {_number(value)}{_interval(interval)}{unit}"
        text = f"{self.name}: {_number(self.before)}{_interval(self.before_ci95)} → "
        text += f"{_number(self.after)}{_interval(self.after_ci95)}{unit}"
        notes = [f"×{self.ratio:.3g}"] if self.ratio is not None else []
        if self.intervals_overlap is not None:
            notes.append("the intervals overlap" if self.intervals_overlap else "the intervals do not overlap")
        return f"{text} ({'; '.join(notes)})" if notes else text


@dataclass(frozen=True)
class VersionDiff:
    """From `before` to `after` (ids)."""

    before: str
    after: str
    parameters: tuple[ParameterChange, ...]
    effects_added: tuple[dict[str, Any], ...]
    effects_removed: tuple[dict[str, Any], ...]
    effects_changed: tuple[dict[str, Any], ...]  # {effect, target, before: {name: value}, after: {...}}
    measurement_changed: bool

    @property
    def words(self) -> tuple[str, ...]:
        """One sentence a difference; empty when there is none."""
        lines = [f"added {_effect(effect)}" for effect in self.effects_added]
        lines += [f"removed {_effect(effect)}" for effect in self.effects_removed]
        for effect in self.effects_changed:
            lines.append(f"{_place(effect)}: {_values(effect['before'])} → {_values(effect['after'])}")
        lines += [parameter.words for parameter in self.parameters]
        if self.measurement_changed:
            lines.append("what is assumed of the measurement differs")
        return tuple(lines)


def diff(before: Version, after: Version) -> VersionDiff:
    """Every parameter and effect that is not the same in both."""
    old, new = _parameters(before), _parameters(after)
    changes = (_change(name, old.get(name), new.get(name)) for name in sorted({*old, *new}))
    old_effects, new_effects = _effects(before), _effects(after)
    both = [key for key in old_effects if key in new_effects]
    return VersionDiff(
        before=before.id,
        after=after.id,
        parameters=tuple(change for change in changes if change.before != change.after),
        effects_added=tuple(effect for key, effect in new_effects.items() if key not in old_effects),
        effects_removed=tuple(effect for key, effect in old_effects.items() if key not in new_effects),
        effects_changed=tuple(
            {"effect": key[0], "target": key[1], "before": _of(old_effects[key]), "after": _of(new_effects[key])}
            for key in both
            if _of(old_effects[key]) != _of(new_effects[key])
        ),
        measurement_changed=before.terms.get("measurement") != after.terms.get("measurement"),
    )


def _parameters(version: Version) -> dict[str, ParameterRecord]:
    """What the model is set to, with intervals where the version was fitted."""
    set_values = version.terms.get("parameters") or {}
    plain = {
        name: ParameterRecord(value=value) for name, value in set_values.items() if isinstance(value, (int, float))
    }
    return {**plain, **version.parameters}


def _change(name: str, old: ParameterRecord | None, new: ParameterRecord | None) -> ParameterChange:
    before, after = old.value if old else None, new.value if new else None
    before_ci, after_ci = old.ci95 if old else None, new.ci95 if new else None
    overlap = None
    if before_ci and after_ci:
        overlap = before_ci[0] <= after_ci[1] and after_ci[0] <= before_ci[1]
    return ParameterChange(
        name=name,
        unit=(new.unit if new else "") or (old.unit if old else ""),
        before=before,
        after=after,
        ratio=after / before if before and after is not None else None,
        before_ci95=before_ci,
        after_ci95=after_ci,
        intervals_overlap=overlap,
    )


def _effects(version: Version) -> dict[tuple[str, str], dict[str, Any]]:
    return {(str(e.get("effect")), str(e.get("target"))): e for e in version.terms.get("effects") or []}


def _of(effect: dict[str, Any]) -> dict[str, Any]:
    return effect.get("values") or {}


def _place(effect: dict[str, Any]) -> str:
    return f"{effect.get('effect')} at {effect.get('target')}"


def _effect(effect: dict[str, Any]) -> str:
    values = _values(_of(effect))
    return f"{_place(effect)} ({values})" if values else _place(effect)


def _values(values: dict[str, Any]) -> str:
    return ", ".join(f"{name} {_number(value)}" for name, value in values.items())


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, (int, float)) else "unknown"


def _interval(ci95: tuple[float, float] | None) -> str:
    return f" [{ci95[0]:.3g}, {ci95[1]:.3g}]" if ci95 else ""
