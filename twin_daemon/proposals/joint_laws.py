"""The laws of one joint: found one after another, each then fitted anew beside the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin_daemon.proposals.law_problem import GivenLaw
from twin_daemon.proposals.proposal import Rival
from twin_daemon.proposals.refit import RefittedLaw, refitted
from twin_daemon.proposals.search import FittedLaw, JointSearch, Trial
from twin_daemon.proposals.thresholds import LEAST_GAIN, MOST_SURE, MOST_TERMS, UNDECIDED_NATS

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


def laws_of_joint(search: JointSearch, refused: Refused) -> tuple[list[FoundLaw], str, list[Rival]]:
    """(the laws of a joint; why there is none; what else was tried for the first).

    While more of the held-out error is left than a law has to take that is proposed, a further one is looked for beside
    those that are found, up to three. A first one that is refused is kept for one such look: what is missing beside it
    may be why.
    """
    laws: list[FoundLaw] = []
    tried: list[Rival] = []
    refusal = ""
    while len(laws) < MOST_TERMS and not (laws and _accounts_for_it(laws)):
        trials = search.trials()
        leading = search.leading(trials)
        tried = tried or _tried(search.joint, trials, leading)
        law, leading, why = _by_description(search, leading, refused)
        if not laws:
            refusal = why
        # what is left over the variable of a law that is known is the shape of its curve
        if law is None or (laws and why) or law.law.feature.name in {one.law.law.feature.name for one in laws}:
            break
        laws.append(FoundLaw(search, law, _probability(leading)))
        search = replace(search, given=tuple(one.given for one in laws))
    if refusal and len(laws) < 2:
        return [], refusal, tried
    return _fitted_together(laws, refused), refusal or "no law of them holds beside the others", tried


def _accounts_for_it(laws: Sequence[FoundLaw]) -> bool:
    """Whether no further law could take as much of the held-out error as one has to that is proposed."""
    return laws[-1].law.law.mse_after < LEAST_GAIN * laws[0].law.law.mse_before


def _by_description(
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


def _fitted_together(found: Sequence[FoundLaw], refused: Refused) -> list[FoundLaw]:
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
    law, _, why = _by_description(search, search.leading(search.trials(one.law.law.feature.name)), refused)
    return None if law is None or why else FoundLaw(search, law, one.probability)


def _probability(laws: Sequence[FittedLaw]) -> float:
    """Of the best port and variables, among all laws that were fitted and none at all."""
    best = laws[0]
    nats = np.array([law.nats for law in laws] + [0.0])
    shares = np.exp(nats - nats.max())
    own = [law.feature.port == best.feature.port and law.feature.variables == best.feature.variables for law in laws]
    return MOST_SURE * float(shares[:-1][own].sum() / shares.sum())


def _tried(joint: str, trials: Sequence[Trial], laws: Sequence[FittedLaw]) -> list[Rival]:
    fitted = {law.feature.name: law for law in laws}
    rows, said = [], {laws[0].feature.name}
    for trial in trials:
        if trial.feature.name in said:
            continue
        said.add(trial.feature.name)
        law = fitted.get(trial.feature.name)
        why = "other laws promise more" if law is None else f"{laws[0].nats - law.nats:.0f} nats behind the best"
        rows.append(
            Rival(
                joint=joint,
                port=trial.feature.port,
                variables=trial.feature.variables,
                linear_gain=trial.share,
                holdout_gain=None if law is None else law.gain,
                lost_because=why,
            )
        )
    return rows
