"""From what the parts of a hand have said to one verdict, and the findings with their evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from twin_daemon.diagnosis.candidates import Hypothesis
from twin_daemon.diagnosis.fit import Fit
from twin_daemon.diagnosis.gate import HeldOut
from twin_daemon.diagnosis.intervals import own_estimates
from twin_daemon.diagnosis.partfit import FORBIDDEN_SIGMA, QUIET_CHI_SQUARE, PartFit
from twin_daemon.diagnosis.verdict import Diagnosis, Finding, FittedValue, Trial, VerdictName
from twin_daemon.diagnosis.where import where_it_fails
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel

_NAMED = 6  # effects that a motion could not have shown, in a reason


@dataclass(frozen=True)
class Accepted:
    """An effect that passed the gate: the part it was found in, how it was judged, and what it cannot be told from."""

    part: PartFit
    fit: Fit
    judged: HeldOut
    rivals: tuple[Accepted, ...] = ()

    @property
    def hypothesis(self) -> Hypothesis:
        assert self.fit.hypothesis is not None
        return self.fit.hypothesis


@dataclass
class Outcome:
    """What one part said. `left` is the adequacy on held-out motion after the accepted findings."""

    name: str
    joints: tuple[str, ...]
    chi_square: float
    strained: dict[str, float]
    accepted: list[Accepted] = field(default_factory=list)
    tried: list[Trial] = field(default_factory=list)
    left: float = 0.0
    quiet: bool = False
    unseen: list[str] = field(default_factory=list)
    """Of a quiet part the effects that its motion would not have shown, where these are many."""


def forced_nuisances(outcome: Outcome) -> list[tuple[str, float]]:
    """The nuisances that are further off than any plausible hand."""
    return [(name, sigma) for name, sigma in outcome.strained.items() if abs(sigma) > FORBIDDEN_SIGMA]


def nothing_moves(joints: Sequence[str] | None) -> Diagnosis:
    which = ", ".join(joints) if joints else "no joint"
    reason = f"{which} moves by more than 0.05 rad: record a motion with steps, two speeds, small reversals and holds"
    return Diagnosis("not_excited", reason, (), (), (), {})


def conclude(
    twin: TwinModel,
    train: Sequence[Aligned],
    outcomes: Sequence[Outcome],
    touching: Sequence[str],
    interrupted: bool,
) -> Diagnosis:
    findings = [_finding(item) for outcome in outcomes for item in outcome.accepted]
    findings.sort(key=lambda f: -f.evidence)
    loud = [o for o in outcomes if not o.quiet]
    unexplained = [o for o in loud if o.left > 1.0]
    forced = [(o, *worst) for o in loud for worst in forced_nuisances(o)]
    unsettled = [o for o in loud if o.left <= 1.0 and not o.accepted and o.chi_square > QUIET_CHI_SQUARE]
    ambiguous = [f for f in findings if f.confusable_with]
    verdict: VerdictName
    if interrupted and not outcomes:
        verdict, reason = "unexplained", "interrupted before any part of the hand was judged"
    elif not outcomes:
        verdict = "not_excited"
        reason = f"{', '.join(touching)}: touching something, or too short: record some seconds clear of contacts"
    elif all(o.quiet and o.unseen for o in outcomes):
        verdict, reason = "not_excited", _too_poor(outcomes[0])
    elif not loud:
        verdict, reason = "within_noise", "what is left is what the sensors and the time step leave of a right model"
    elif unexplained:
        worst = max(unexplained, key=lambda o: o.left)
        verdict = "unexplained"
        reason = f"{worst.name}: the best of the library leaves {worst.left:.1f} times what a right model leaves"
    elif forced:
        worst, name, sigma = max(forced, key=lambda item: abs(item[2]))
        verdict = "unexplained"
        beside = "beside what was found" if worst.accepted else "no effect passes the gate, and"
        reason = f"{worst.name}: {beside}, {name} has to be {sigma:+.0f} sigma from the model's value"
    elif ambiguous:
        verdict = "ambiguous"
        first = ambiguous[0]
        reason = f"{first.effect} at {first.target} cannot be told from {', '.join(first.confusable_with)}"
    elif findings:
        verdict, reason = "explained", "; ".join(f"{f.effect} at {f.target}" for f in findings)
    elif unsettled:
        verdict = "unexplained"
        reason = f"{unsettled[0].name}: {unsettled[0].chi_square:.1f} times the floor, and no effect passes the gate"
    else:
        verdict, reason = "within_noise", "nominal parameters within their uncertainty explain the motion"
    return Diagnosis(
        verdict=verdict,
        reason=reason,
        findings=tuple(findings),
        tried=tuple(t for o in outcomes for t in o.tried),
        where=tuple(where_it_fails(twin, train)),
        parts={
            o.name: {"joints": o.joints, "times_floor": o.chi_square, "left_times_floor": o.left, "quiet": o.quiet}
            for o in outcomes
        },
        moved_parameters=tuple(
            {"parameter": name, "sigma": sigma} for o in outcomes for name, sigma in o.strained.items()
        ),
        interrupted=interrupted,
        notes=[f"{name} was left out: it touches something nearly all the time" for name in touching],
    )


def _too_poor(outcome: Outcome) -> str:
    effects = list(dict.fromkeys(name.partition(":")[0] for name in outcome.unseen))
    some = ", ".join(effects[:_NAMED]) + (f" and {len(effects) - _NAMED} more" if len(effects) > _NAMED else "")
    return (
        f"{outcome.name}: the model is right for this motion, but it would be beside {some} as well: record steps, "
        "two speeds, small reversals and holds"
    )


def _finding(accepted: Accepted) -> Finding:
    part, fit, judged, hypothesis = accepted.part, accepted.fit, accepted.judged, accepted.hypothesis
    parameters = {name: FittedValue(one.value, one.unit, one.ci95) for name, one in own_estimates(fit).items()}
    twin = part.twin
    if hypothesis.target == "hand":
        joints = tuple(part.joints)
    else:
        joints = tuple(dict.fromkeys((hypothesis.target, *twin.joints_of(hypothesis.target))))
    effect = hypothesis.effect
    return Finding(
        effect=effect.key,
        target=hypothesis.target,
        joints=joints,
        parameters=parameters,
        evidence=part.evidence(fit),
        holdout_mse_before=judged.mse_before,
        holdout_mse_after=judged.mse_after,
        holdout_gain=judged.gain,
        holdout_gain_ci95=judged.gain_ci95,
        confusable_with=tuple(rival.hypothesis.name for rival in accepted.rivals),
        explanation=f"{effect.story.what} {effect.story.shows} Likely cause: {effect.story.cause} "
        f"What to do: {effect.story.remedy}",
    )
