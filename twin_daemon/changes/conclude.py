"""From what groups of joints have said about two sessions to one answer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_daemon.changes import temperature
from twin_daemon.changes.answer import (
    BY_TEMPERATURE,
    UNKNOWN,
    Change,
    Since,
    Unchanged,
    Undetectable,
    Valued,
    rivals_in_words,
    sentence,
)
from twin_daemon.changes.diagnosed import as_change
from twin_daemon.changes.group_search import GroupFound
from twin_daemon.changes.quantities import Quantity, term_of
from twin_daemon.changes.thresholds import AS_GOOD_AS_NONE, BLOCK_SAMPLES, LEFT_OVER, NAMED, POSSIBLE
from twin_daemon.diagnosis.left_out import LeftOut
from twin_daemon.diagnosis.verdict import Diagnosis, Finding, PartSummary, VerdictName
from twin_daemon.effects import LIBRARY
from twin_daemon.estimation.estimate import Estimate
from twin_daemon.estimation.thresholds import RELATIVE_FLOOR, Z95
from twin_daemon.estimation.uncertainty import block_gain
from twin_daemon.simulation.alignment import Aligned


def conclude(
    found: Sequence[GroupFound],
    told: Sequence[Diagnosis],
    now: Sequence[Aligned],
    left_out: LeftOut,
    seed: int,
    interrupted: bool,
    warmed: float,
) -> Since:
    """The verdict of all groups, with every change as a finding under the effect that it stands for.

    `told` are diagnoses of the groups that are not among `found`. `warmed` is by how many standard deviations of the
    temperature sessions may differ.
    """
    first_seen = min(r.recording.began for r in now).isoformat(timespec="seconds")
    pairs = [(group, index) for group in found for index in group.changed]
    pairs.sort(key=lambda pair: -pair[0].evidence[pair[1]])
    changes = tuple(_change(group, index, first_seen, _rivals(found, group, index, warmed)) for group, index in pairs)
    findings = tuple(
        _finding(group, index, change, seed) for (group, index), change in zip(pairs, changes, strict=True)
    )
    shared = [finding for one in told for finding in one.findings]
    changes = (*changes, *(as_change(finding, first_seen) for finding in shared))
    findings = (*findings, *shared)
    worst = max(found, key=lambda group: group.left, default=None)
    ambiguous = [change for change in changes if change.rivals]
    unchanged, undetectable = _not_changed(found)
    verdict: VerdictName
    if not found and not told:
        verdict = "unexplained" if interrupted else "not_excited"
        reason = f"{', '.join(left_out.touching) or 'no joint'}: too little motion clear of contacts in both sessions"
    elif worst is not None and worst.left > LEFT_OVER:
        verdict = "unexplained"
        reason = (
            f"{', '.join(worst.joints)}: the best explanation leaves {worst.left:.1f} times what the model leaves of "
            "the earlier session"
        )
    elif ambiguous:
        verdict = "ambiguous"
        reason = f"{ambiguous[0].words}; the same may come from {rivals_in_words(ambiguous[0].rivals)}"
    elif changes:
        verdict, reason = "explained", "; ".join(change.words for change in changes)
    elif not unchanged:
        verdict, reason = "not_excited", "these recordings would not have shown any change: move faster, and reverse"
    else:
        verdict, reason = "within_noise", "nothing has changed that these recordings would show"
        reason += f"; not looked at: {', '.join(left_out.touching)}" if left_out.touching else ""
    return Since(
        verdict=verdict,
        reason=reason,
        findings=findings,
        tried=(),
        where=(),
        parts={
            group.name: PartSummary(
                joints=group.joints,
                times_floor=group.before_left,
                left_times_floor=group.left,
                within_floor=not group.changed and group.left <= LEFT_OVER,
            )
            for group in found
        }
        | {name: part for one in told for name, part in one.parts.items()},
        changes=changes,
        unchanged=unchanged,
        undetectable=undetectable,
        interrupted=interrupted,
        notes=(
            *([temperature.NOTE] if any(BY_TEMPERATURE in change.rivals for change in changes) else ()),
            *left_out.notes(),
        ),
    )


def _rivals(found: Sequence[GroupFound], group: GroupFound, index: int, warmed: float) -> tuple[str, ...]:
    """What explains the same as a change: others of its group, and the temperature."""
    own = tuple(_place(group.quantities[i]) for i in group.rivals[index])
    return (*own, BY_TEMPERATURE) if temperature.explains(found, group, index, warmed) else own


def _change(group: GroupFound, index: int, first_seen: str, rivals: tuple[str, ...]) -> Change:
    quantity, fit = group.quantities[index], group.fit
    q = len(group.quantities)
    covariance = fit.covariance
    at, by = float(fit.point[index]), float(fit.point[q + index])
    before = _interval(quantity, at, float(covariance[index, index]))
    both = covariance[index, index] + covariance[q + index, q + index] + 2.0 * covariance[index, q + index]
    now = _interval(quantity, at + by, float(both))
    ratio = _ratio(quantity, at, by, covariance[np.ix_([index, q + index], [index, q + index])])
    probability, effect, joints = group.probability[index], quantity.effect, quantity.joints
    return Change(
        effect=effect,
        parameter=quantity.name,
        target=quantity.target,
        joints=joints,
        unit=quantity.unit,
        before=before,
        now=now,
        ratio=ratio,
        probability=probability,
        rivals=rivals,
        first_seen=first_seen,
        words=sentence(effect, joints, quantity.unit, before, now, ratio, first_seen, probability),
        remedy=LIBRARY[effect].story.remedy,
    )


def _interval(quantity: Quantity, z: float, variance: float) -> Valued:
    half = Z95 * float(np.sqrt(max(variance, 0.0)))
    least = RELATIVE_FLOOR if quantity.is_parameter else max(RELATIVE_FLOOR, Z95 * quantity.law_error) * abs(z)
    half = float(np.hypot(half, least))
    ends = [quantity.value(max(end, 0.0) if quantity.grows else end) for end in (z - half, z + half)]
    middle = quantity.value(max(z, 0.0) if quantity.grows else z)
    values = [float("nan") if end is None else end for end in (middle, *ends)]
    low, high = (values[2], values[1]) if quantity.effect == "tendon_elasticity" else (values[1], values[2])
    return Valued(value=values[0], ci95=(low, high))


def _ratio(quantity: Quantity, at: float, by: float, covariance: np.ndarray) -> Valued:
    """Now over before; of an effect only where the earlier session clearly has it."""
    if quantity.is_parameter:
        half = float(np.hypot(Z95 * np.sqrt(max(covariance[1, 1], 0.0)), RELATIVE_FLOOR))
        return Valued(value=float(np.exp(by)), ci95=(float(np.exp(by - half)), float(np.exp(by + half))))
    sigma = float(np.sqrt(max(covariance[0, 0], 0.0)))
    if quantity.signed or at < max(2.0 * Z95 * sigma, AS_GOOD_AS_NONE * (at + by)) or at + by <= 0.0:
        return UNKNOWN
    # of the logarithm of (at + by) / at
    slope = np.array([1.0 / (at + by) - 1.0 / at, 1.0 / (at + by)])
    half = Z95 * float(np.sqrt(max(slope @ covariance @ slope, 0.0) + quantity.law_error**2))
    centre = float(np.log((at + by) / at))
    if quantity.effect == "tendon_elasticity":
        centre = -centre
    return Valued(value=float(np.exp(centre)), ci95=(float(np.exp(centre - half)), float(np.exp(centre + half))))


def _finding(group: GroupFound, index: int, change: Change, seed: int) -> Finding:
    quantity = group.quantities[index]
    effect = LIBRARY[quantity.effect]
    name = quantity.parameter or effect.parameters[0].name
    unit = next(p.unit for p in effect.parameters if p.name == name)
    if not quantity.is_parameter:
        value, ci95 = change.now.value, change.now.ci95
    elif quantity.effect == "actuator_gain":
        value, ci95 = change.ratio.value, change.ratio.ci95
    else:  # beside what the earlier session had
        value = change.now.value - change.before.value
        ci95 = tuple((end - 1.0) * change.before.value for end in change.ratio.ci95)
    low, high = ci95
    if quantity.is_parameter:
        values = effect.neutral() | {name: value}
    else:
        q, point = len(group.quantities), group.fit.point
        values = dict(term_of(group.quantities, index, point[:q] + point[q : 2 * q]).values)
    without, with_it = group.held_squares
    known = without.size > 0
    story = effect.story
    return Finding(
        effect=quantity.effect,
        target=quantity.target,
        joints=quantity.joints,
        parameters={name: Estimate(value=value, unit=unit, ci95=(low, high))},
        values={key: float(v) for key, v in values.items()},
        evidence_nats=group.evidence[index],
        holdout_mse_before_rad2=float(without.mean()) if known else float("nan"),
        holdout_mse_after_rad2=float(with_it.mean()) if known else float("nan"),
        holdout_gain=1.0 - float(with_it.mean() / max(without.mean(), 1e-30)) if known else float("nan"),
        holdout_gain_ci95=block_gain(without, with_it, BLOCK_SAMPLES, seed) if known else (float("nan"), float("nan")),
        confusable_with=change.rivals,
        explanation=f"{change.words}. {story.what} Likely cause: {story.cause} What to do: {story.remedy}",
    )


def _not_changed(found: Sequence[GroupFound]) -> tuple[tuple[Unchanged, ...], tuple[Undetectable, ...]]:
    unchanged, undetectable = [], []
    for group in found:
        for index, least in group.seen_from.items():
            quantity = group.quantities[index]
            if index in group.changed:
                continue
            possible = group.probability.get(index, 0.0) > POSSIBLE
            about = {"effect": quantity.effect, "parameter": quantity.name, "joints": quantity.joints}
            if least > quantity.visible or not np.isfinite(least):
                why = "this motion would not have shown even a large change"
                undetectable.append(Undetectable(**about, why=why))
            elif possible:
                why = f"not decided: probability {group.probability[index]:.2f}, below {NAMED:g}"
                undetectable.append(Undetectable(**about, why=why))
            else:
                amount, ratio = quantity.value(least), None
                if amount is not None and quantity.nominal:  # a parameter, or a factor
                    amount, ratio = None, amount / quantity.nominal
                unchanged.append(Unchanged(**about, unit=quantity.unit, least_ratio=ratio, least=amount))
    return tuple(unchanged), tuple(undetectable)


def _place(quantity: Quantity) -> str:
    return f"{quantity.effect}:{quantity.target}"
