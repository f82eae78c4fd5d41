"""Laws of one joint that act together: found one after another, each then fitted anew beside the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from twin_daemon.proposals.law_problem import GivenLaw
from twin_daemon.proposals.refit import RefittedLaw, refitted
from twin_daemon.proposals.search import FittedLaw, JointSearch
from twin_daemon.proposals.thresholds import UNDECIDED_NATS

Refused = Callable[[JointSearch, RefittedLaw], str]
"""Why a law is not proposed; empty where it is."""


@dataclass(frozen=True, eq=False)
class FoundLaw:
    """A law that is worth proposing, the search that it was judged in, and how probable its port and variables are."""

    search: JointSearch
    law: RefittedLaw
    probability: float

    @property
    def given(self) -> GivenLaw:
        """As it acts beside others."""
        return GivenLaw(self.law.law.feature, self.law.law.coefficients)


def by_description(
    search: JointSearch, laws: Sequence[FittedLaw], refused: Refused
) -> tuple[RefittedLaw | None, list[FittedLaw], str]:
    """(the law with the shortest description, None where none is worth its values; it and those that are no more
    refused than it is, by their evidence; why it is refused).

    A curve of many knots pays for all of them, where its formula may have two values and may be sharper than knots. One
    that is refused is taken only where all are. Of laws that evidence does not tell apart the one that leaves least of
    held-out motion is taken, but a constant before all, as it is a line over any variable.
    """
    described = [refitted(search, law) for law in laws if law.nats > 0.0]
    if not described:
        return None, list(laws), f"the best law ({laws[0].feature.name}) is not worth its values"
    whys = {id(one): refused(search, one) for one in described}
    left = [one for one in described if not whys[id(one)]] or described
    most = max(one.law.nats for one in left)
    undecided = [one for one in left if one.law.nats > most - UNDECIDED_NATS]
    best = min(undecided, key=lambda one: (not one.is_constant, one.law.mse_after))
    others = [one.law for one in left if one is not best]
    return best, [best.law, *sorted(others, key=lambda law: -law.nats)], whys[id(best)]


def fitted_together(found: Sequence[FoundLaw], refused: Refused) -> list[FoundLaw]:
    """Each law once more beside the others, the first one first: alone it took what is theirs.

    One that is not worth proposing beside the others goes.
    """
    kept = list(found)
    for one in found if len(found) > 1 else []:
        others = [other for other in kept if other is not one]
        place = kept.index(one)
        again = _beside(one, others, refused)
        if again is None:
            kept = others
        else:
            kept[place] = again
    return kept


def _beside(one: FoundLaw, others: Sequence[FoundLaw], refused: Refused) -> FoundLaw | None:
    """The law of the same port and variables beside others; None where it is not worth proposing there."""
    search = replace(one.search, given=tuple(other.given for other in others))
    law, _, why = by_description(search, search.leading(search.trials(one.law.law.feature.name)), refused)
    return None if law is None or why else FoundLaw(search, law, one.probability)
