"""From what the parts of a hand have said to one verdict, and the findings with their evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from twin_daemon.comparison.conditions import ConditionError, errors_by_condition
from twin_daemon.diagnosis.candidates import Hypothesis
from twin_daemon.diagnosis.far_off import beyond_any_hand
from twin_daemon.diagnosis.fit import Fit, own_estimates
from twin_daemon.diagnosis.left_out import LeftOut
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.probability import Left, combined, posterior
from twin_daemon.diagnosis.thresholds import (
    DECISIVE_NATS,
    FORBIDDEN_SIGMA,
    MOST_NAMED,
    REFINEMENT,
    RELATIVE_ERROR,
    SURE,
    WORST_SHOWN,
)
from twin_daemon.diagnosis.validation import HeldOut
from twin_daemon.diagnosis.verdict import (
    Diagnosis,
    Failure,
    Finding,
    MotionError,
    MovedParameter,
    PartSummary,
    Trial,
    VerdictName,
)
from twin_daemon.effects import LIBRARY
from twin_daemon.estimation.thresholds import FLOOR_CHI_SQUARE
from twin_daemon.places import HAND
from twin_daemon.simulation.alignment import Aligned, predict
from twin_daemon.simulation.terms import EffectTerm
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Accepted:
    """An effect that passed held-out validation: its part, how it was judged, and what it cannot be told from.

    `weighed` has the evidence in nats of all that competed with it, by name, and `decisive_nats` how far behind
    something has to be to be ruled out.
    """

    part: PartFit
    fit: Fit
    judged: HeldOut
    rivals: tuple[Accepted, ...] = ()
    weighed: Mapping[str, float] = field(default_factory=dict)
    decisive_nats: float = DECISIVE_NATS

    @property
    def hypothesis(self) -> Hypothesis:
        assert self.fit.hypothesis is not None
        return self.fit.hypothesis

    @property
    def term(self) -> EffectTerm:
        """The effect at its place, with its values as fitted."""
        return self.hypothesis.term(self.fit.values)

    @property
    def joints(self) -> tuple[str, ...]:
        """What it acts at: its place, and the joints that this drives."""
        target = self.hypothesis.target
        if target == HAND:
            return tuple(self.part.joints)
        return tuple(dict.fromkeys((target, *self.part.twin.joints_of(target))))

    def posterior(self, beside: Sequence[Accepted] = ()) -> dict[str, float]:
        """Probabilities of what may be at this place among the causes, given that it is one of the library.

        What is `beside` it, and may be there instead of that, is not in its place as well.
        """
        there = {one.hypothesis.name for other in beside for one in (other, *other.rivals)} - {self.hypothesis.name}
        return posterior({n: nats for n, nats in self.weighed.items() if n not in there}, self.decisive_nats)


@dataclass
class Outcome:
    """What one part said. `left` is the adequacy on held-out motion after the accepted findings.

    Where they leave more than that of the fitted motion, it is what they leave there.
    """

    name: str
    joints: tuple[str, ...]
    chi_square: float
    deviating: dict[str, float]
    moved: tuple[MovedParameter, ...] = ()
    """The nominal parameters that came to lie elsewhere, beside what was found."""
    accepted: list[Accepted] = field(default_factory=list)
    tried: list[Trial] = field(default_factory=list)
    others: list[Accepted] = field(default_factory=list)
    """What helps as well, if less or not on held-out motion: beside a second effect one of these may be right."""
    neutral: Fit | None = None
    """A fit that is better by none of its effect: what is uncertain about the part was not at its best without it."""
    left: float = 0.0
    within_floor: bool = False
    unfinished: bool = False
    """Whether time was over before it had been searched to the end."""
    undetectable: list[str] = field(default_factory=list)
    """Of a part within the floor the effects that its motion would not have shown, where these are many."""

    @property
    def names(self) -> set[str]:
        """Of what was accepted."""
        return {one.hypothesis.name for one in self.accepted}

    @property
    def posteriors(self) -> list[dict[str, float]]:
        """For each that was accepted the probabilities of what may be at its place beside the others."""
        return [one.posterior([other for other in self.accepted if other is not one]) for one in self.accepted]

    @property
    def explains(self) -> bool:
        """Whether it leaves what a right model does, with no nuisance further off than any plausible hand's."""
        return self.left <= 1.0 and not beyond_any_hand(self.deviating)

    @property
    def what_is_left(self) -> Left:
        """What says how probable it is that the part lacks what is no law of the library."""
        left = self.left
        if not self.within_floor and not self.accepted:
            left = max(left, self.chi_square / FLOOR_CHI_SQUARE)
        sigma = max((abs(s) for s in self.deviating.values()), default=0.0)
        above = not self.within_floor and (self.chi_square > FLOOR_CHI_SQUARE or bool(self.deviating))
        return Left(max(left, sigma / FORBIDDEN_SIGMA), above or bool(self.accepted), bool(self.accepted))


def nothing_moves(joints: Sequence[str] | None) -> Diagnosis:
    which = ", ".join(joints) if joints else "no joint"
    reason = f"{which} moves by more than 0.05 rad: record a motion with steps, two speeds, small reversals and holds"
    return Diagnosis.without_findings("not_excited", reason)


def conclude(
    twin: TwinModel,
    train: Sequence[Aligned],
    outcomes: Sequence[Outcome],
    left_out: LeftOut,
    interrupted: bool,
    shared: Sequence[Finding] = (),
    shared_posteriors: Sequence[Mapping[str, float]] = (),
) -> Diagnosis:
    """`shared` are findings of several groups together, each with a distribution over what may be in its place."""
    causes = len(shared) + sum(len(o.accepted) for o in outcomes)
    unknowns = [o.what_is_left.unknown(causes) for o in outcomes]
    findings = [_beside_unknown(finding, outcomes, unknowns) for finding in shared]
    for o, unknown in zip(outcomes, unknowns, strict=True):
        findings += [_finding(*each, unknown) for each in zip(o.accepted, o.posteriors, strict=True)]
    findings = ranked(findings)
    # of what was not searched to the end nobody can say how probable a law is that is not in the library
    finished = not any(o.unfinished for o in outcomes)
    places = _causes(outcomes, shared_posteriors)
    probabilities = combined(places, unknowns) if finished else ()
    above = [o for o in outcomes if not o.within_floor]
    # of a part that only held-out motion puts above the floor a little more is no new law yet; beside a named one it is
    # where that is more probable than not
    both = [(o, unknown) for o, unknown in zip(outcomes, unknowns, strict=True) if not o.within_floor and o.left > 1.0]
    unexplained = [o for o, unknown in both if unknown > (0.5 if o.accepted else 1.0 - SURE)]
    forced = [(o, *worst) for o in above for worst in beyond_any_hand(o.deviating)]
    unsettled = [o for o in above if o.left <= 1.0 and not o.accepted and o.chi_square > FLOOR_CHI_SQUARE]
    ambiguous = [f for f in findings if f.confusable_with or (f.probability or 0.0) < SURE]
    unfinished = [o for o in above if o.unfinished]
    errors = errors_by_condition((recording, predict(twin, recording)) for recording in train)
    rms_rad = {error.joint: error.rmse_rad / error.times_average for error in errors}
    unseen = left_out.far_off(rms_rad, {joint for o in outcomes for joint in o.joints})
    verdict: VerdictName
    if interrupted and not outcomes:
        verdict, reason = "unexplained", "interrupted before any part of the hand was judged"
    elif not outcomes:
        verdict = "not_excited"
        which = ", ".join(left_out.touching)
        reason = f"{which}: touching something, or too short: record some seconds clear of contacts"
    elif all(o.within_floor and o.undetectable for o in outcomes):
        verdict, reason = "not_excited", _too_poor(outcomes[0])
    elif not above and not shared and unseen:
        verdict = "not_excited"
        which = ", ".join(f"{joint} ({1e3 * rms:.0f} mrad off)" for joint, rms in unseen.items())
        reason = f"{which}: touching something nearly all the time: record some seconds clear of contacts"
    elif not above and not shared:
        verdict, reason = "within_noise", "what is left is what the sensors and the time step leave of a right model"
    elif unfinished:
        verdict = "unexplained"
        reason = f"{', '.join(', '.join(o.joints) for o in unfinished)}: above the floor, and not searched to the end"
    elif unexplained:
        worst = max(unexplained, key=lambda o: o.left)
        verdict = "unexplained"
        reason = f"{worst.name}: the best of the library leaves {worst.left:.1f} times what a right model leaves"
    elif forced:
        worst, name, sigma = max(forced, key=lambda item: abs(item[2]))
        verdict = "unexplained"
        beside = "beside what was found" if worst.accepted else "no effect passes held-out validation, and"
        reason = f"{worst.name}: {beside}, {name} has to be {sigma:+.0f} sigma from the model's value"
    elif ambiguous:
        verdict = "ambiguous"
        first = ambiguous[0]
        rivals = [one.in_words for one in probabilities if first.name not in one.effects]
        others = [name.replace(":", " at ") for name in first.confusable_with] or rivals[:MOST_NAMED]
        reason = f"{first.effect} at {first.target} cannot be told from {', '.join(others) or 'chance'}"
    elif findings:
        verdict, reason = "explained", "; ".join(f"{f.effect} at {f.target}" for f in findings)
    elif unsettled:
        verdict = "unexplained"
        worst = unsettled[0]
        reason = f"{worst.name}: {worst.chi_square:.1f} times the floor, and no effect passes held-out validation"
    else:
        verdict, reason = "within_noise", "nominal parameters within their uncertainty explain the motion"
    return Diagnosis(
        verdict=verdict,
        reason=reason,
        findings=tuple(findings),
        probabilities=probabilities,
        causes=tuple(dict(one) for one in places),
        tried=tuple(t for o in outcomes for t in o.tried),
        where=_where_it_fails(errors),
        parts={
            o.name: PartSummary(
                joints=o.joints,
                times_floor=o.chi_square,
                left_times_floor=o.left,
                adequacy=o.what_is_left.adequacy,
                above=o.what_is_left.above,
                named=o.what_is_left.named,
                unknown=unknown,
                within_floor=o.within_floor,
            )
            for o, unknown in zip(outcomes, unknowns, strict=True)
        },
        moved_parameters=tuple(moved for o in outcomes for moved in o.moved),
        interrupted=interrupted,
        notes=left_out.notes(),
    )


def ranked(findings: Sequence[Finding]) -> list[Finding]:
    """By evidence; of those at the same joints what the model lacks comes before a number of its own that is off.

    A weaker servo with play is a joint with play first: no other value of the model's numbers would do. A torque limit
    is one of these, as the effect of a weaker servo holds it. What is sure comes before what is doubtful: the nats
    of a second effect are over what the first one leaves, with its own floor, and may be more. A number of the model
    comes first where all else takes so little there that it may be the form of a law; but what a form gets wrong no
    other law takes away to what a right one leaves.
    """
    numbers = [effect for effect in tuple(LIBRARY.values()) if effect.competes_with is not None]
    own = {key for effect in numbers for key in (effect.key, *effect.contains)}

    def key(finding: Finding) -> tuple[float, bool, float, float]:
        there = [other for other in findings if set(other.joints) & set(finding.joints)]
        beside = [other.evidence_nats for other in there]
        less = sorted(beside)[:-1]
        most_by_far = bool(less) and finding.evidence_nats == max(beside) and less[-1] < REFINEMENT * max(beside)
        is_nearly_all = most_by_far and not any(_takes_all(other) for other in there if other.effect not in own)
        doubt = max(SURE - (finding.probability or 0.0), 0.0)
        return -max(beside), finding.effect in own and not is_nearly_all, doubt, -finding.evidence_nats

    return sorted(findings, key=key)


def _takes_all(finding: Finding) -> bool:
    """Whether a finding leaves of held-out motion what a right law leaves of it."""
    return finding.holdout_mse_after_rad2 <= RELATIVE_ERROR * finding.holdout_mse_before_rad2


def _causes(outcomes: Sequence[Outcome], shared: Sequence[Mapping[str, float]]) -> list[Mapping[str, float]]:
    """One distribution for each place among the causes."""
    return [*shared, *(found for outcome in outcomes for found in outcome.posteriors)]


def _beside_unknown(finding: Finding, outcomes: Sequence[Outcome], unknowns: Sequence[float]) -> Finding:
    """A shared cause, no more probable than its worst group lets it be: all may feel a law that is not known."""
    felt = [u for o, u in zip(outcomes, unknowns, strict=True) if set(o.joints) & set(finding.joints)]
    known = 1.0 - max(felt, default=0.0)
    return finding.model_copy(update={"probability": known * (finding.probability or 0.0)})


def _too_poor(outcome: Outcome) -> str:
    effects = list(dict.fromkeys(name.partition(":")[0] for name in outcome.undetectable))
    some = ", ".join(effects[:MOST_NAMED]) + (
        f" and {len(effects) - MOST_NAMED} more" if len(effects) > MOST_NAMED else ""
    )
    return (
        f"{outcome.name}: the model is right for this motion, but it would be beside {some} as well: record steps, "
        "two speeds, small reversals and holds"
    )


def _finding(accepted: Accepted, among: Mapping[str, float], unknown: float) -> Finding:
    part, fit, judged, hypothesis = accepted.part, accepted.fit, accepted.judged, accepted.hypothesis
    effect = hypothesis.effect
    return Finding(
        effect=effect.key,
        target=hypothesis.target,
        joints=accepted.joints,
        parameters=own_estimates(fit),
        values=hypothesis.term(fit.values).values,
        moved=fit.moved,
        evidence_nats=part.evidence_nats(fit),
        holdout_mse_before_rad2=judged.mse_before,
        holdout_mse_after_rad2=judged.mse_after,
        holdout_gain=judged.gain,
        holdout_gain_ci95=judged.gain_ci95,
        holdout_motions=tuple(
            MotionError(
                name=motion.name,
                mse_before_rad2=motion.mse_before,
                mse_after_rad2=motion.mse_after,
                gain_ci95=motion.gain_ci95,
                left=motion.adequacy,
            )
            for motion in judged.motions
        ),
        confusable_with=tuple(rival.hypothesis.name for rival in accepted.rivals),
        rivals=tuple(rival.term for rival in accepted.rivals),
        probability=(1.0 - unknown) * among[hypothesis.name],
        explanation=effect.story.explanation,
    )


def _where_it_fails(errors: Sequence[ConditionError]) -> tuple[Failure, ...]:
    """Joints and what they were doing where the errors are largest, worst first."""
    return tuple(
        Failure(
            joint=error.joint,
            condition=error.condition,
            rmse_rad=error.rmse_rad,
            bias_rad=error.bias_rad,
            times_average=error.times_average,
            seconds=error.seconds,
        )
        for error in errors[:WORST_SHOWN]
    )
