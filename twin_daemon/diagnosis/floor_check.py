"""Which groups of joints are at the floor of their sensors, and at which something is missing."""

from __future__ import annotations

from collections.abc import Sequence, Set

from twin_daemon.diagnosis.conclude import Outcome
from twin_daemon.diagnosis.far_off import plainly_above
from twin_daemon.diagnosis.group import look
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.part_search import begun_outcome
from twin_daemon.diagnosis.power import undetectable
from twin_daemon.diagnosis.screening import Screening
from twin_daemon.diagnosis.validation import Validation
from twin_daemon.estimation.partition import Reduced
from twin_daemon.executor import concurrently
from twin_daemon.processes import Say


def above_floor(
    looked_at: Sequence[tuple[Reduced, PartFit]],
    outcomes: list[Outcome],
    seed: int,
    say: Say,
    *,
    seen: bool = False,
    anew: bool = False,
    late: Set[str] = frozenset(),
) -> list[tuple[Reduced, PartFit]]:
    """The groups at which something is missing; what the others say is added to `outcomes`.

    `seen` says that a group has moved richly enough for the robot to be called sound; otherwise these have to. Where
    those that are returned will be looked at `anew`, one that leaves more than right models do is among them. Of joints
    whose commands are known to come `late` it is asked whether an effect explains that, however little they leave.
    """
    found = []
    ordered = sorted(looked_at, key=lambda item: float(item[1].times_floor.max()))
    asked = [(reduced, part) for reduced, part in ordered if _may_be_sound(part, anew=anew)]
    lefts = concurrently(lambda item: _held_out(*item, seed), asked)
    left = {part.joints: value for (_, part), value in zip(asked, lefts, strict=True)}
    for reduced, part in ordered:
        rich = seen or any(o.within_floor and not o.undetectable for o in outcomes)
        held_out = left.get(part.joints)
        outcome = within_floor(part, reduced, seed, say, seen=rich, anew=anew, late=late, held_out=held_out)
        if outcome is None:
            found.append((reduced, part))
        else:
            outcomes.append(outcome)
    return found


def _may_be_sound(part: PartFit, *, anew: bool) -> bool:
    return not plainly_above(part) and not (anew and part.worth_a_look)


def _held_out(reduced: Reduced, part: PartFit, seed: int) -> float:
    """What a group leaves of held-out motion, in what a right model may leave."""
    return Validation(part, reduced.holdout, seed=seed).judge(part.base).adequacy


def within_floor(
    part: PartFit,
    reduced: Reduced,
    seed: int,
    say: Say,
    *,
    seen: bool,
    anew: bool = False,
    late: Set[str] = frozenset(),
    held_out: float | None = None,
) -> Outcome | None:
    """What a group says at which nothing is missing; None where something is, or where it is to be looked at `anew`.

    `seen` says that another one has moved richly enough for the robot to be called sound, `held_out` what it leaves of
    held-out motion where that is known.
    """
    outcome = begun_outcome(reduced, part)
    said = f"{', '.join(part.joints)}: {part.times_floor.max():.1f} times the floor, nominal values being uncertain"
    if not _may_be_sound(part, anew=anew):
        say(said)
        return None
    outcome.left = _held_out(reduced, part, seed) if held_out is None else held_out
    if part.plainly_sound and (outcome.left > 1.0 or not seen):
        # what it might have shown, or shows on held-out motion, is said of a group with all that is uncertain fitted
        return within_floor(look(reduced)[1], reduced, seed, say, seen=seen, late=late)
    outcome.undetectable = undetectable(part) if outcome.left > 1.0 or not seen else []
    say(said)
    if (part.worth_a_look or not late.isdisjoint(part.joints)) and Screening(part).promising():
        return None
    # what only held-out motion shows is looked for where the other motion can show it
    sound = outcome.left <= 1.0 or outcome.undetectable
    if sound or by_parameters(reduced, Validation(part, reduced.holdout, seed=seed), seed):
        outcome.within_floor = True
        return outcome
    return None


def by_parameters(reduced: Reduced, validation: Validation, seed: int) -> bool:
    """Whether parameters within their uncertainty explain the held-out motion as well: fitted to the end, or to all.

    A short recording leaves them loose: what they then get wrong on other motion is no effect.
    """
    for recordings in (reduced.train, [*reduced.train, *reduced.holdout]):
        part = PartFit(reduced.twin, recordings, reduced.joints, thoroughly=True)
        left = Validation(part, reduced.holdout, seed=seed, first=validation).judge(part.base).adequacy
        if left <= 1.0 and not plainly_above(part):
            return True
    return False
