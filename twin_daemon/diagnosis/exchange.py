"""Once several effects have been found: whether what was a tie for one of them still is, beside the others.

While something else is missing, a wrong law may look as good as the right one, because what is missing leaves more than
what tells the two apart. Beside all the others they are compared again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from twin_daemon.diagnosis.conclude import Accepted
from twin_daemon.diagnosis.fit import Fit
from twin_daemon.diagnosis.intervals import is_idle
from twin_daemon.diagnosis.partfit import PartFit
from twin_daemon.executor import concurrently


def exchanged(
    first: PartFit, accepted: Sequence[Accepted], evaluations: int, decisive: Callable[[Fit], float]
) -> list[Accepted]:
    """The findings, each in turn with the best of itself and its rivals, all fitted together on the first part.

    A rival stays one where it is no further behind than `decisive` nats for the best; of these the one with the most
    evidence stands first, but for a law of which only its other parameters do anything, such as a spring without
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
        fits = concurrently(lambda s: first.finely_together([a.fit for a in s[0]], evaluations, s[1].fit), starts)
        evidence = [first.evidence(joint[index]) for joint in fits]
        most = max(range(len(choices)), key=evidence.__getitem__)
        bar = evidence[most] - decisive(fits[most][index])
        tied = [i for i, nats in enumerate(evidence) if i == most or nats > bar]
        best = min(tied, key=lambda i: (is_idle(fits[i][index]), -evidence[i]))
        close = tuple(choices[i] for i in tied if i != best)
        richer = tuple(r for r in item.rivals if r not in asked) if best == 0 else ()
        found = [replace(a, fit=fit) for a, fit in zip(beside[best], fits[best], strict=True)]
        found[index] = replace(found[index], rivals=(*(replace(c, rivals=()) for c in close), *richer))
    return found
