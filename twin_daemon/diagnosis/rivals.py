"""Findings in turn with the best of itself and what it could not be told from, once all others are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

from twin_daemon.diagnosis.conclude import Accepted
from twin_daemon.diagnosis.fit import is_idle, stands_out
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.race import lost
from twin_daemon.diagnosis.validation import Validation
from twin_daemon.diagnosis.verdict import Trial
from twin_daemon.diagnosis.weighing import decisive, weight_of
from twin_daemon.executor import concurrently


def swap_rivals(
    first: PartFit,
    accepted: Sequence[Accepted],
    evaluations: int,
) -> list[Accepted]:
    """The findings, each in turn with the best of itself and its rivals, all fitted together on the first part.

    While something else is missing, a wrong law may look as good as the right one, because what is missing leaves more
    than what tells the two apart. Beside all the others they are compared again.

    A rival stays one where it is no further behind than is decisive for the best; of these the most probable one
    stands first, but for a law of which only its other parameters do anything, such as a spring without
    stiffness. A richer law of the same kind is not asked, as it can only seem better.
    """
    found = list(accepted)
    for index, item in enumerate(found):
        asked = [rival for rival in item.rivals if not rival.hypothesis.contains(item.hypothesis)]
        if not asked:
            continue
        choices = [item, *asked]
        beside = [[*found[:index], choice, *found[index + 1 :]] for choice in choices]
        # each begins where the nuisances were beside it: now they fit the effect that is to give way
        starts = list(zip(beside, choices, strict=True))
        fits = concurrently(lambda s: first.full_fit_together([a.fit for a in s[0]], evaluations, s[1].fit), starts)
        evidence = _not_below_limits(choices, [first.evidence_nats(joint[index]) for joint in fits])
        most = max(range(len(choices)), key=evidence.__getitem__)
        bar = evidence[most] - decisive(fits[most][index])
        tied = [i for i, nats in enumerate(evidence) if i == most or nats > bar]
        limits = {i for i, j in permutations(tied, 2) if choices[i].hypothesis.is_limit_of(choices[j].hypothesis)}
        beyond = decisive(fits[most][index])
        weights = _not_below_limits(choices, [weight_of(first, joint[index], beyond) for joint in fits])
        best = min(tied, key=lambda i: (is_idle(fits[i][index]), -weights[i], i in limits))
        close = tuple(choices[i] for i in tied if i != best)
        moved = weights[0] - item.weighed[item.hypothesis.name]  # all others as far behind it as they were
        weighed = {name: nats + moved for name, nats in item.weighed.items()}
        weighed |= {c.hypothesis.name: nats for c, nats in zip(choices, weights, strict=True)}
        richer = tuple(r for r in item.rivals if r not in asked) if best == 0 else ()
        found = [replace(a, fit=fit) for a, fit in zip(beside[best], fits[best], strict=True)]
        found[index] = replace(
            found[index],
            rivals=(*(replace(c, rivals=()) for c in close), *richer),
            weighed=weighed,
            decisive_nats=beyond,
        )
    return found


def without_idle(
    first: PartFit, validation: Validation, accepted: Sequence[Accepted], evaluations: int
) -> tuple[list[Accepted], list[Trial]]:
    """(the findings without those that may as well not be there beside the others, what is told of these).

    An effect that only stood for another one does nothing beside that. `first` is the part before any effect was found.
    """
    kept = [one for one in accepted if stands_out(one.fit)] or [accepted[-1]]
    if len(kept) == len(accepted):
        return list(accepted), []
    names = [one.hypothesis.name for one in kept]
    reason = f"may as well not be there beside {', '.join(names)}"
    idle = [lost(one.hypothesis, 0.0, reason) for one in accepted if one.hypothesis.name not in names]
    fits = first.together([one.fit for one in kept], evaluations)
    found = [replace(one, fit=fit) for one, fit in zip(kept, fits, strict=True)]
    found[0] = replace(found[0], part=first, judged=validation.judge(fits[0]))
    return found, idle


def _not_below_limits(choices: Sequence[Accepted], nats: Sequence[float]) -> list[float]:
    """The nats of each choice; of a law no less than those of what it becomes at a bound of its own."""
    found = list(nats)
    for limit, law in permutations(range(len(choices)), 2):
        if choices[limit].hypothesis.is_limit_of(choices[law].hypothesis):
            found[law] = max(found[law], found[limit])
    return found
