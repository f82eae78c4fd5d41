"""The diagnosis: part by part, from the residual to a named cause, or to the plain word that there is none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from twin_daemon.diagnosis.candidates import Hypothesis, hypotheses
from twin_daemon.diagnosis.cores import concurrently
from twin_daemon.diagnosis.gate import ADEQUATE, Gate, HeldOut
from twin_daemon.diagnosis.partfit import Fit, PartFit, descended, knob_interval, unit_sigmas
from twin_daemon.diagnosis.segments import segments
from twin_daemon.diagnosis.verdict import Diagnosis, Finding, FittedValue, Trial, VerdictName
from twin_daemon.diagnosis.where import where_it_fails
from twin_daemon.fitting.reduce import restricted
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.submodel import Part, parts, submodel, touching_parts
from twin_daemon.simulation.twin import TwinModel

QUIET_CHI_SQUARE = 1.6
"""The residual over its floor up to which there is nothing to explain."""

STRAINED_SIGMA = 4.0
"""A nuisance this far from its prior is no nuisance: something moves it."""

DECISIVE_NATS = 5.0
"""Evidence between two candidates below which the data do not choose (odds of 150 to 1)."""

_MOST_EFFECTS = 3
_REFITTED = 7
_ROUGH = 4  # iterations of every candidate's fit
_FINALISTS = 3
_FINE = 8  # iterations more for the best of them
_POSES = 400
_SUSPECT_SIGMA = 3.0

Stream = Callable[[str], None]
"""Called with one line whenever a candidate has been judged."""


@dataclass
class _Outcome:
    """What one part said. `left` is the adequacy on held-out motion after the accepted findings."""

    name: str
    joints: tuple[str, ...]
    chi_square: float
    strained: dict[str, float]
    accepted: list[tuple[PartFit, Fit, HeldOut, tuple[str, ...]]] = field(default_factory=list)
    tried: list[Trial] = field(default_factory=list)
    left: float = 0.0
    quiet: bool = False


def diagnose(
    twin: TwinModel,
    train: Sequence[Aligned],
    holdout: Sequence[Aligned],
    *,
    joints: Sequence[str] | None = None,
    seed: int = 0,
    stream: Stream | None = None,
    most_effects: int = _MOST_EFFECTS,
) -> Diagnosis:
    """Which physical effects the twin lacks, on the evidence of `train`, gated by `holdout`.

    Ctrl-C ends the search; what has been found until then is in the answer.
    """
    say = stream or (lambda _: None)
    moving = [n for i, n in enumerate(twin.joints) if any(r.moving[i] for r in train) and (not joints or n in joints)]
    if not moving:
        return _nothing_moves(joints)
    touches = _touches(twin, [*train, *holdout])
    outcomes: list[_Outcome] = []
    interrupted = False
    accepted_terms = twin.terms
    try:
        fits = []
        for part in parts(twin):
            own = [n for n in moving if n in part.joints]
            if own:
                fits.append((_part(twin, train, own, part, touches), part))
        fits.sort(key=lambda item: -item[0].base.chi_square)
        for fit, part in fits:
            if accepted_terms is not twin.terms:
                # an effect of the whole hand has been found in another part: look at this one with it
                fit = _part(twin.changed(accepted_terms), train, list(fit.joints), part, touches)
            outcome = _search(fit, part.name, holdout, seed, say, most_effects)
            outcomes.append(outcome)
            for _, found, _, _ in outcome.accepted:
                if found.hypothesis is not None and found.hypothesis.target == "hand":
                    accepted_terms = accepted_terms.with_effect(found.hypothesis.term(found.values))
    except KeyboardInterrupt:
        interrupted = True
    return _conclude(twin, train, outcomes, interrupted)


def _touches(twin: TwinModel, recordings: Sequence[Aligned]) -> set[frozenset[str]]:
    poses = [twin.measurement.invert(twin.joints, r.measured[:: max(1, len(r.measured) // _POSES)]) for r in recordings]
    return touching_parts(twin, parts(twin), np.concatenate(poses))


def _part(
    twin: TwinModel, recordings: Sequence[Aligned], own: list[str], part: Part, touches: set[frozenset[str]]
) -> PartFit:
    """The part's sub-model: its moving joints, what is coupled to them, and the parts that it touches."""
    touched = {name for pair in touches if part.name in pair for name in pair}
    beside = {n for p in parts(twin) if p.name in touched for n in p.joints}
    moving = {n for i, n in enumerate(twin.joints) if any(r.moving[i] for r in recordings)}
    # what it touches gives way, whether or not it was commanded
    keep = {*own, *beside, *(moving & set(part.trunk))}
    for row in twin.drive:
        coupled = {twin.joints[j] for j in np.flatnonzero(row)}
        if coupled & keep:
            keep |= coupled
    ordered = tuple(n for n in twin.joints if n in keep)
    small = submodel(twin, ordered, recordings[0].start_position, contacts=bool(touched))
    return PartFit(small, _pieces(small, recordings, own), own)


def _pieces(small: TwinModel, recordings: Sequence[Aligned], own: Sequence[str]) -> list[Aligned]:
    return [piece for r in recordings for piece in segments(restricted(r, small.joints), own)]


def _search(
    part: PartFit, name: str, holdout: Sequence[Aligned], seed: int, say: Stream, most_effects: int
) -> _Outcome:
    held = _pieces(part.twin, holdout, part.joints)
    strained = _strained(part)
    outcome = _Outcome(name, part.joints, part.base.chi_square, strained)
    gate = Gate(part, held, seed=seed)
    outcome.left = gate.judge(part.base).adequacy
    say(f"{name}: {part.base.chi_square:.1f} times the floor with the nominal parameters' uncertainty taken out")
    if part.base.chi_square <= QUIET_CHI_SQUARE and not strained:
        outcome.quiet = True
        return outcome
    for _ in range(most_effects):
        step = _step(part, gate, say, outcome)
        if step is None:
            break
        fit, judged, rivals = step
        outcome.accepted.append((part, fit, judged, rivals))
        outcome.left = judged.adequacy
        hypothesis = fit.hypothesis
        assert hypothesis is not None
        richer = part.twin.changed(part.twin.terms.with_effect(hypothesis.term(fit.values)))
        settled = PartFit(richer, part.recordings, part.joints)
        # beside the effect the nuisances have gone back to where they belong: judged once more as it stands
        gate = Gate(settled, held, seed=seed)
        outcome.left = min(outcome.left, gate.judge(settled.base).adequacy)
        outcome.strained = _strained(settled)
        if outcome.left <= ADEQUATE and not outcome.strained:
            break
        part = settled
    return outcome


def _strained(part: PartFit) -> dict[str, float]:
    """The nuisances that are too far from their priors to be nuisances, in sigma."""
    return {name: sigma for name, sigma in part.strained(part.base).items() if abs(sigma) > STRAINED_SIGMA}


def _step(part: PartFit, gate: Gate, say: Stream, outcome: _Outcome) -> tuple[Fit, HeldOut, tuple[str, ...]] | None:
    """One more effect for a part: the best candidate that passes the gate, and what it cannot be told from."""
    chosen, passed_over = _shortlist(part)
    for gain, hypothesis, _ in passed_over:
        outcome.tried.append(Trial(hypothesis.effect.key, hypothesis.target, gain / 2.0, None, None,
                                   "takes too little of the error away to be worth a fit"))  # fmt: skip
    rough = concurrently(lambda item: part.refit(item[1], item[2], _ROUGH), chosen)
    for (gain, hypothesis, _), fit in zip(chosen, rough, strict=True):
        if fit is None:
            outcome.tried.append(Trial(hypothesis.effect.key, hypothesis.target, gain / 2.0, None, None,
                                       "cannot stand beside the effects that the twin has"))  # fmt: skip
    roughly = sorted((fit for fit in rough if fit is not None), key=lambda fit: fit.cost)
    finalists = concurrently(lambda f: descended(f.hypothesis, f.problem, f.point, _FINE), roughly[:_FINALISTS])
    fits: list[tuple[float, Fit]] = []
    for fit in [*finalists, *roughly[_FINALISTS:]]:
        fits.append((part.evidence(fit), fit))
        assert fit.hypothesis is not None
        say(f"  {fit.hypothesis.name}: evidence {fits[-1][0]:.0f} nats, {fit.chi_square:.1f} times the floor")
    fits.sort(key=lambda item: -item[0])
    best: tuple[Fit, HeldOut] | None = None
    simpler: tuple[Fit, HeldOut] | None = None
    rivals: list[str] = []
    best_evidence = 0.0
    for evidence, fit in fits:
        judged = gate.judge(fit)
        hypothesis = fit.hypothesis
        assert hypothesis is not None
        mse = float(np.mean([(r**2).mean() for r in fit.problem.joint_residuals(fit.point[None])]))
        reason = None
        if evidence <= DECISIVE_NATS:
            reason = "adds less evidence than its parameters cost"
        elif not judged.passes:
            reason = f"does not help on held-out motion (gain {judged.gain:.0%}, interval reaches below 0)"
        elif best is None:
            best, best_evidence = (fit, judged), evidence
            continue
        elif simpler is None and judged.adequate and _is_contained(hypothesis, best[0].hypothesis):
            simpler = (fit, judged)
            continue
        elif best_evidence - evidence < DECISIVE_NATS and (judged.adequate or not best[1].adequate):
            rivals.append(hypothesis.name)
            reason = "the data do not tell it from the best candidate"
        else:
            reason = f"explains less: {best_evidence - evidence:.0f} nats behind"
        outcome.tried.append(Trial(hypothesis.effect.key, hypothesis.target, evidence, mse, judged.mse_after, reason))
    if best is None:
        return None
    if simpler is not None and best[0].hypothesis is not None:
        # both are right on held-out motion, and one is the other at a bound: the simpler is the answer
        return (*simpler, (*rivals, best[0].hypothesis.name))
    return (*best, tuple(rivals))


def _is_contained(simpler: Hypothesis, richer: Hypothesis | None) -> bool:
    return richer is not None and simpler.target == richer.target and simpler.effect.key in richer.effect.contains


Screened = tuple[float, Hypothesis, dict[str, float]]


def _shortlist(part: PartFit) -> tuple[list[Screened], list[Screened]]:
    """(worth a fit, not worth one): candidates with the cost that they could take away and where to start.

    What a nuisance stands in for is invisible beside it. Where nuisances alone reach the floor by straining, only
    the effects that they stand in for are asked; elsewhere these join the best of the screening, as does a weak
    servo, which friction hides best.
    """
    strained = {name for name, sigma in part.strained(part.base).items() if abs(sigma) > _SUSPECT_SIGMA}
    everything = hypotheses(part.twin, part.joints, whole_hand=True)
    owners = [h for h in everything if h.speaks_for(part.twin) & strained]
    asked = owners if owners and part.base.chi_square <= QUIET_CHI_SQUARE else everything
    screened = [(gain, h, start) for h, (gain, start) in zip(asked, concurrently(part.screen, asked), strict=True)]
    screened.sort(key=lambda item: -item[0])
    chosen = [
        item
        for rank, item in enumerate(screened)
        if (rank < _REFITTED and item[0] > DECISIVE_NATS) or item[1] in owners or item[1].effect.key == "actuator_gain"
    ]
    return chosen, [item for item in screened if item not in chosen]


# -- the answer --------------------------------------------------------------------------------------------


def _nothing_moves(joints: Sequence[str] | None) -> Diagnosis:
    which = ", ".join(joints) if joints else "no joint"
    reason = f"{which} moves by more than 0.05 rad: record a motion with steps, two speeds, small reversals and holds"
    return Diagnosis("not_excited", reason, (), (), (), {})


def _conclude(twin: TwinModel, train: Sequence[Aligned], outcomes: Sequence[_Outcome], interrupted: bool) -> Diagnosis:
    findings = [_finding(*item) for outcome in outcomes for item in outcome.accepted]
    findings.sort(key=lambda f: -f.evidence)
    loud = [o for o in outcomes if not o.quiet]
    unexplained = [o for o in loud if o.left > ADEQUATE]
    unsettled = [o for o in loud if o.left <= ADEQUATE and not o.accepted and o.chi_square > QUIET_CHI_SQUARE]
    ambiguous = [f for f in findings if f.confusable_with]
    verdict: VerdictName
    if interrupted and not outcomes:
        verdict, reason = "unexplained", "interrupted before any part of the hand was judged"
    elif not loud:
        verdict, reason = "within_noise", "what is left is what the sensors and the time step leave of a right model"
    elif unexplained:
        worst = max(unexplained, key=lambda o: o.left)
        verdict = "unexplained"
        reason = f"{worst.name}: the best of the library leaves {worst.left:.1f} times the floor on held-out motion"
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
    )


def _finding(part: PartFit, fit: Fit, judged: HeldOut, rivals: tuple[str, ...]) -> Finding:
    hypothesis = fit.hypothesis
    assert hypothesis is not None
    widths = dict(zip((k.name for k in fit.problem.knobs), unit_sigmas(fit), strict=True))
    parameters = {}
    for knob in fit.problem.knobs:
        if knob.prior is None:
            name = knob.name.rpartition(".")[2]
            value = fit.values[name]
            parameters[name] = FittedValue(value, knob.unit, knob_interval(fit, knob, widths[knob.name]))
    twin = part.twin
    driven: list[str] = []
    if hypothesis.target in twin.actuators:
        row = twin.drive[twin.actuators.index(hypothesis.target)]
        driven = [twin.joints[j] for j in np.flatnonzero(row)]
    elif hypothesis.target == "hand":
        driven = list(part.joints)
    own = [] if hypothesis.target == "hand" else [hypothesis.target]
    joints = (*own, *(joint for joint in driven if joint not in own))
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
        confusable_with=rivals,
        explanation=f"{effect.story.what} {effect.story.shows} Likely cause: {effect.story.cause} "
        f"What to do: {effect.story.remedy}",
    )
