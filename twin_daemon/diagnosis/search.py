"""The diagnosis: part by part, from the residual to a named cause, or to the plain word that there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin_daemon.diagnosis.all_servos import of_all_servos
from twin_daemon.diagnosis.conclude import Outcome, conclude, nothing_moves
from twin_daemon.diagnosis.far_off import deviating
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.part_search import PartSearch, Progress, begun_outcome
from twin_daemon.diagnosis.power import undetectable
from twin_daemon.diagnosis.screening import Screening
from twin_daemon.diagnosis.selection import Say
from twin_daemon.diagnosis.shared import Shared, SharedSearch, at_nominal, look
from twin_daemon.diagnosis.shared_cause import SharedCause, shared_causes
from twin_daemon.diagnosis.thresholds import CLOSER_LOOK, DEVIATING_SIGMA, GONE_FAR, MOST_EFFECTS, OF_ALL_LEFT
from twin_daemon.diagnosis.validation import Validation
from twin_daemon.diagnosis.verdict import Diagnosis, Finding
from twin_daemon.effects import LIBRARY
from twin_daemon.estimation.nuisances import NOMINAL_KINDS, factors
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.estimation.thresholds import FLOOR_CHI_SQUARE
from twin_daemon.executor import OutOfTime, TimeLimit, concurrently
from twin_daemon.places import ROBOT
from twin_daemon.simulation.alignment import Aligned, moving_joints
from twin_daemon.simulation.submodel import drive_groups, linked
from twin_daemon.simulation.terms import EffectTerm
from twin_daemon.simulation.twin import TwinModel

_DELAY = "delay"  # what is uncertain about the time of all commands of a recording


def diagnose(
    twin: TwinModel,
    train: Sequence[Aligned],
    holdout: Sequence[Aligned],
    *,
    joints: Sequence[str] | None = None,
    seed: int = 0,
    stream: Say | None = None,
    most_effects: int = MOST_EFFECTS,
    limit: TimeLimit | None = None,
) -> Diagnosis:
    """Which physical effects the twin lacks, on the evidence of `train`, validated by `holdout`.

    Ctrl-C and the end of the time limit end the search; what has been found until then is in the answer.
    """
    limit = limit or TimeLimit()
    say = stream or (lambda _: None)
    moving = [name for name in moving_joints(train) if not joints or name in joints]
    if not moving:
        return nothing_moves(joints)
    reduction = Reduction(twin, train, holdout)
    outcomes: list[Outcome] = []
    findings: list[Finding] = []
    touching: list[str] = []
    above: list[tuple[Reduced, PartFit]] = []
    causes: list[Mapping[str, float]] = []
    shared: Shared | None = None
    interrupted = False
    try:
        chosen = [(g, [n for n in moving if n in g.joints]) for g in drive_groups(twin)]
        cut = [(g.name, reduction.of(twin, g, own)) for g, own in chosen if own]
        touching = [name for name, reduced in cut if reduced is None]
        begun = concurrently(at_nominal, [reduced for _, reduced in cut if reduced is not None])
        shared = _of_all(twin, reduction, begun, limit, seed, say)
        looked_at = [] if shared else concurrently(_looked_at, begun)
        above = _above(looked_at, outcomes, seed, say)
        if above and (_heavier(twin) or reduction.carries):
            reduction, again = _closer(twin, reduction, looked_at, above)
            above = _above(again, outcomes, seed, say)
        else:
            above = [look(reduced) if part.nominal else (reduced, part) for reduced, part in above]
        if len(above) > 1:
            shared = _shared(twin, reduction, above, len(looked_at), limit, seed, say)
        elif not above and shared is None:
            shared = _common(twin, reduction, looked_at, limit, seed, say)
        groups = [reduced for reduced, _ in begun]
        while shared is not None:
            theirs = {part.joints for _, part in shared.looked_at}
            outcomes = [outcome for outcome in outcomes if outcome.joints not in theirs]
            for reduced, part in shared.looked_at:
                outcomes.append(replace(begun_outcome(reduced, part), within_floor=True))
            groups = [group for group in groups if group.joints not in theirs]
            finding, above = _everywhere(shared.finding, groups, outcomes, seed, say)
            findings.append(finding)
            causes.append(shared.posterior)
            if finding.target != ROBOT:
                break
            # beside what all have some may have something of their own, which several feel
            twin = twin.changed(shared.terms)
            looked_at = [*shared.looked_at, *above]
            reduction, again = _closer(twin, reduction, looked_at, above)
            above = _above(again, outcomes, seed, say)
            groups = [_with_everywhere(group, finding) for group in groups]
            shared = _shared(twin, reduction, above, len(begun), limit, seed, say) if len(above) > 1 else None
        hunt = _Hunt(twin, reduction, _as_fitted(twin, looked_at), seed, say, most_effects, limit, outcomes, touching)
        for unit in _units(twin, above):
            hunt.search(unit)
        if not findings and (once := _said_once(groups, outcomes, seed, say)):
            finding, outcomes = once
            findings.append(finding)
            causes.append({finding.name: finding.probability or 0.0})
    except (KeyboardInterrupt, OutOfTime):
        interrupted = True
    judged = {joint for outcome in outcomes for joint in outcome.joints}
    for reduced, part in above:
        if not judged & set(reduced.joints):
            outcomes.append(replace(begun_outcome(reduced, part), unfinished=True))
    interrupted = interrupted or any(outcome.unfinished for outcome in outcomes)
    return conclude(twin, train, outcomes, touching, interrupted, findings, causes)


def _looked_at(begun: tuple[Reduced, PartFit]) -> tuple[Reduced, PartFit]:
    """A group with what is uncertain about it fitted, unless it is at the floor of its sensors as it is."""
    return begun if begun[1].plainly_sound else look(*begun)


def _heavier(twin: TwinModel) -> bool:
    """Whether links may be heavier or lighter than the model has them."""
    return twin.hand.description.nominal_uncertainty.mass > 0.0


def _closer(
    twin: TwinModel,
    reduction: Reduction,
    looked_at: Sequence[tuple[Reduced, PartFit]],
    above: Sequence[tuple[Reduced, PartFit]],
) -> tuple[Reduction, list[tuple[Reduced, PartFit]]]:
    """(the reduction with the others moving as they were fitted and with what costs most, that links may be heavier;
    the groups above the floor fitted anew on that).
    """
    reduction = reduction.following(_with_values(twin, _as_fitted(twin, looked_at)))
    reduction = reduction.with_link_masses(twin) if _heavier(twin) else reduction
    again = [reduction.together(twin, [reduced]) for reduced, _ in above]
    return reduction, concurrently(look, [reduced for reduced in again if reduced is not None])


def _as_fitted(twin: TwinModel, looked_at: Sequence[tuple[Reduced, PartFit]]) -> dict[str, float]:
    """What the groups' nuisances have come to, whatever they stand for: parameters of a twin, absolute, by name."""
    found: dict[str, float] = {}
    for _, part in looked_at:
        fitted = zip(part.base.problem.variables, part.base.point, strict=True)
        known = {v.name: v.value(float(unit)) for v, unit in fitted}
        found.update(factors(part.base.problem.variables, known))
    return {name: factor * twin.parameter(name).read(twin.model) for name, factor in found.items()}


def _with_values(twin: TwinModel, values: Mapping[str, float]) -> TwinModel:
    """A twin with parameters where fits have taken them: it moves more like the robot.

    Accelerations of the measured motion are for the most part those of a prediction. One with half of a joint's
    inertia puts a load on that joint itself that nothing explains.
    """
    within = {}
    for name, value in values.items():
        kind = twin.parameter(name).kind
        # a fit beside something that is missing goes anywhere, but not beyond what a model can have
        within[name] = float(np.clip(value, kind.lower, kind.upper))
    return twin.changed(twin.terms.with_parameters(within))


def _above(
    looked_at: Sequence[tuple[Reduced, PartFit]], outcomes: list[Outcome], seed: int, say: Say, *, seen: bool = False
) -> list[tuple[Reduced, PartFit]]:
    """The groups at which something is missing; what the others say is added to `outcomes`.

    `seen` says that a group has moved richly enough for the robot to be called sound; otherwise these have to.
    """
    found = []
    for reduced, part in sorted(looked_at, key=lambda item: float(item[1].times_floor.max())):
        rich = seen or any(o.within_floor and not o.undetectable for o in outcomes)
        outcome = _within_floor(part, reduced, seed, say, seen=rich)
        if outcome is None:
            found.append((reduced, part))
        else:
            outcomes.append(outcome)
    return found


def _of_all(
    twin: TwinModel,
    reduction: Reduction,
    begun: Sequence[tuple[Reduced, PartFit]],
    limit: TimeLimit,
    seed: int,
    say: Say,
) -> Shared | None:
    """One cause that all servos or joints have, before anything else is fitted; None where it is not as clear as that.

    A late bus is felt by every group, and what is uncertain about each would be fitted in vain.
    """
    if 2 * sum(not part.within_floor for _, part in begun) <= len(begun):
        return None
    search = SharedSearch(twin, reduction, begun)
    chosen = search.above(CLOSER_LOOK)
    if len(chosen) < 2 or 2 * len(chosen) <= len(begun):
        return None
    above = [begun[i] for i in chosen]
    joints = [reduced.joints for reduced, _ in above]
    causes = [cause for cause in shared_causes(twin, joints, everywhere=True) if cause.target == ROBOT]
    found = search.only(chosen).best(causes, limit, seed, most_left=OF_ALL_LEFT)
    if found is not None:
        say(f"{found.finding.name} explains {len(found.looked_at)} of {len(above)} groups above the floor")
    return found


def _shared(
    twin: TwinModel,
    reduction: Reduction,
    above: Sequence[tuple[Reduced, PartFit]],
    groups: int,
    limit: TimeLimit,
    seed: int,
    say: Say,
) -> Shared | None:
    """One cause behind all groups above the floor: cheaper than one each, so it is tried first."""
    joints = [reduced.joints for reduced, _ in above]
    causes = shared_causes(twin, joints, everywhere=2 * len(above) > groups)
    found = SharedSearch(twin, reduction, above).best(causes, limit, seed)
    if found is not None:
        say(f"{found.finding.name} explains {len(found.looked_at)} of {len(above)} groups above the floor")
    return found


def _common(
    twin: TwinModel,
    reduction: Reduction,
    looked_at: Sequence[tuple[Reduced, PartFit]],
    limit: TimeLimit,
    seed: int,
    say: Say,
) -> Shared | None:
    """A cause of all servos or joints that no group alone would speak of; None where there is none.

    One gain may be three sigma off. Eleven that are three sigma off the same way are a supply that sags: under what is
    known of nominal values their mean has a sigma of one over the root of eleven. A weak servo without gravity looks
    like one with more to move, and a late bus like damping, so that whatever is off asks for all of them.
    """
    if not any(_off_the_same_way(looked_at, kind) for kind in (*NOMINAL_KINDS, _DELAY)):
        return None
    causes = [SharedCause(effect, ROBOT) for effect in LIBRARY.values() if effect.shared in ("servos", "joints")]
    shared = SharedSearch(twin, reduction, looked_at).best(causes, limit, seed)
    if shared is None:
        return None
    say(f"{shared.finding.name}: nominal values of all groups are off the same way")
    return shared


def _off_the_same_way(looked_at: Sequence[tuple[Reduced, PartFit]], kind: str) -> bool:
    """Whether the nominal values of a kind ("kp", "damping", ...) are off by more than each on its own may be."""
    found = [sigma for _, part in looked_at for name, sigma in part.base.deviations.items() if kind in name.split(".")]
    return len(found) > 1 and abs(sum(found)) > DEVIATING_SIGMA * len(found) ** 0.5


def _with_everywhere(group: Reduced, finding: Finding) -> Reduced:
    term = EffectTerm(effect=finding.effect, target=ROBOT, values=finding.values)
    return replace(group, twin=group.twin.changed(group.twin.terms.with_effect(term)))


def _everywhere(
    finding: Finding, groups: Sequence[Reduced], outcomes: list[Outcome], seed: int, say: Say
) -> tuple[Finding, list[tuple[Reduced, PartFit]]]:
    """(a cause with all groups that have it, the groups at which something is missing beside it).

    A cause that all servos or joints have is theirs, too, at which it hardly shows, or beside which they have one of
    their own. What their nominal values stood in for is taken back in `outcomes`.
    """
    if finding.target != ROBOT:
        return finding, []
    changed = [_with_everywhere(group, finding) for group in groups]
    known = {outcome.joints: place for place, outcome in enumerate(outcomes)}
    theirs: list[str] = []
    above: list[tuple[Reduced, PartFit]] = []
    for reduced, part in concurrently(look, changed):
        outcome = _within_floor(part, reduced, seed, say, seen=True)
        if outcome is None and part.joints in known:
            continue  # sound without it, and not with it
        theirs += part.joints
        if outcome is None:
            above.append((reduced, part))
        elif part.joints in known:
            outcomes[known[part.joints]] = outcome
        else:
            outcomes.append(outcome)
    return finding.model_copy(update={"joints": (*finding.joints, *theirs)}), above


def _said_once(
    groups: Sequence[Reduced], outcomes: Sequence[Outcome], seed: int, say: Say
) -> tuple[Finding, list[Outcome]] | None:
    """(a cause that was found at one servo after another and that all others have as well, the outcomes without it)."""
    found = of_all_servos(outcomes)
    if found is None:
        return None
    finding, left = found[0], list(found[1])
    rest = [group for group in groups if not set(group.joints) <= set(finding.joints)]
    everywhere, above = _everywhere(finding, rest, left, seed, say)
    # what is above the floor with it would have to be searched again: one at each servo says no less
    if above or any(not set(group.joints) <= set(everywhere.joints) for group in rest):
        return None
    say(f"{finding.name}: found at one servo after another, with one value for all")
    return everywhere, left


def _units(twin: TwinModel, above: Sequence[tuple[Reduced, PartFit]]) -> list[list[tuple[Reduced, PartFit]]]:
    """The groups that are searched together: what happens at one joint is felt by those that carry it."""
    units = [[above[i] for i in members] for members in linked(twin, [r.joints for r, _ in above])]
    return sorted(units, key=lambda unit: -max(float(part.times_floor.max()) for _, part in unit))


@dataclass(frozen=True)
class _Hunt:
    """The search for effects at groups above the floor. What they say is added to `outcomes` as it is known."""

    twin: TwinModel
    reduction: Reduction
    fitted: Mapping[str, float]
    seed: int
    say: Say
    most_effects: int
    limit: TimeLimit
    outcomes: list[Outcome]
    touching: list[str]

    def search(self, unit: Sequence[tuple[Reduced, PartFit]]) -> None:
        """Searches groups that feel each other one after another, the worst first.

        What is found at the worst one often is all: its neighbours were told a wrong motion of it, or a wrong load. So
        they are looked at anew with it. Where no effect of one group explains it, all that are left are searched as
        one.
        """
        twin, left = self.twin, list(unit)
        while len(left) > 1:
            left.sort(key=lambda item: -float(item[1].times_floor.max()))
            reduced, part = left[0]
            outcome = self._searched(twin, part, reduced)
            if not outcome.accepted or not outcome.explains:
                break
            self.outcomes.append(outcome)
            twin = _with_found(twin, outcome)
            left = self._above(twin, [reduced for reduced, _ in left[1:]])
        if len(left) == 1:
            reduced, part = left[0]
            self.outcomes.append(self._searched(twin, part, reduced))
        elif left:
            whole = self.reduction.together(twin, [reduced for reduced, _ in left])
            if whole is None:
                self.touching.append(left[0][0].name)
            else:
                reduced, part = look(whole)
                self.outcomes.append(self._searched(twin, part, reduced))

    def _above(self, twin: TwinModel, groups: Sequence[Reduced]) -> list[tuple[Reduced, PartFit]]:
        """Those groups that are above the floor with what the twin now has."""
        reduction = self.reduction.following(self._as_fitted(twin))
        again = [reduction.together(twin, [group]) for group in groups]
        looked_at = concurrently(look, [reduced for reduced in again if reduced is not None])
        return _above(looked_at, self.outcomes, self.seed, self.say, seen=True)

    def _as_fitted(self, twin: TwinModel, *outcomes: Outcome) -> TwinModel:
        """A twin with effects, and what the nuisances have come to beside what was found, or where nothing was."""
        values = dict(self.fitted)
        for outcome in (*self.outcomes, *outcomes):
            for found in outcome.accepted:
                values.update(found.fit.moved)
        return _with_values(twin, values)

    def _searched(self, twin: TwinModel, part: PartFit, reduced: Reduced) -> Outcome:
        search = PartSearch(part, reduced, self.seed, self.say, self.most_effects, self.limit)
        begun = search.begun()
        nearer = self._nearer(twin, begun, reduced)
        if nearer is not None:
            self.say("  once more, the whole robot moving as what was found says")
            search, begun = replace(search, part=nearer[1], reduced=nearer[0]), None
        outcome = search.outcome(begun)
        sound = part.within_floor and not (outcome.accepted or outcome.deviating or outcome.unfinished)
        if sound and outcome.left > 1.0:
            # it was looked at again for what the fitted motion leaves, and nothing takes that away
            outcome.within_floor = _by_parameters(reduced, search.validation, self.seed)
        return outcome

    def _nearer(self, twin: TwinModel, begun: Progress, reduced: Reduced) -> tuple[Reduced, PartFit] | None:
        """A part on the motion that follows from its first effect, where with that it leaves less of it; else None.

        The measured motion of a joint that lacks much was smoothed by a wrong prediction: what its neighbours do to it
        came out wrong, and no law explains that.
        """
        first = begun.outcome
        if not (first.accepted and self.reduction.carries) or first.unfinished:
            return None
        if bool((begun.left <= FLOOR_CHI_SQUARE).all()) and not first.deviating:
            return None
        reduction = self.reduction.following(self._as_fitted(_with_found(twin, first), first))
        again = reduction.together(twin, [reduced])
        if again is None:
            return None
        terms = _with_found(again.twin, first)
        fits = [found.fit for found in first.accepted]
        beside = PartFit(terms, again.train, again.joints, after=fits[-1], found=fits)
        return look(again) if beside.base.cost < GONE_FAR * begun.part.base.cost else None


def _with_found(twin: TwinModel, outcome: Outcome) -> TwinModel:
    """A twin with the effects that were found at a part."""
    terms = twin.terms
    for found in outcome.accepted:
        terms = terms.with_effect(found.hypothesis.term(found.fit.values))
    return twin.changed(terms)


def _within_floor(part: PartFit, reduced: Reduced, seed: int, say: Say, *, seen: bool) -> Outcome | None:
    """What a group says at which nothing is missing; None where something is.

    `seen` says that another one has moved richly enough for the robot to be called sound.
    """
    outcome = begun_outcome(reduced, part)
    said = f"{', '.join(part.joints)}: {part.times_floor.max():.1f} times the floor, nominal values being uncertain"
    if not part.within_floor or outcome.deviating:
        say(said)
        return None
    validation = Validation(part, reduced.holdout, seed=seed)
    outcome.left = validation.judge(part.base).adequacy
    if part.plainly_sound and (outcome.left > 1.0 or not seen):
        # what it might have shown, or shows on held-out motion, is said of a group with all that is uncertain fitted
        return _within_floor(look(reduced)[1], reduced, seed, say, seen=seen)
    outcome.undetectable = undetectable(part) if outcome.left > 1.0 or not seen else []
    say(said)
    if part.worth_a_look and Screening(part).promising():
        return None
    # what only held-out motion shows is looked for where the other motion can show it
    if outcome.left <= 1.0 or outcome.undetectable or _by_parameters(reduced, validation, seed):
        outcome.within_floor = True
        return outcome
    return None


def _by_parameters(reduced: Reduced, validation: Validation, seed: int) -> bool:
    """Whether parameters within their uncertainty explain the held-out motion as well: fitted to the end, or to all.

    A short recording leaves them loose: what they then get wrong on other motion is no effect.
    """
    for recordings in (reduced.train, [*reduced.train, *reduced.holdout]):
        part = PartFit(reduced.twin, recordings, reduced.joints, thoroughly=True)
        left = Validation(part, reduced.holdout, seed=seed, first=validation).judge(part.base).adequacy
        if part.within_floor and left <= 1.0 and not deviating(part):
            return True
    return False
