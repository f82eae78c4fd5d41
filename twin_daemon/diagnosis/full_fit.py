"""A candidate fitted to the end: from where it has been begun, and from what it may have left behind on the way."""

from __future__ import annotations

import numpy as np

from twin_daemon.diagnosis.candidates import Hypothesis
from twin_daemon.diagnosis.fit import Fit, as_fit, own_columns
from twin_daemon.diagnosis.further_starts import begun_ends, box_moved, nominal_again, other_ends, refined
from twin_daemon.diagnosis.thresholds import GONE_FAR, RACE_ROLLOUTS, SCREENED_S
from twin_daemon.estimation.posterior import Posterior
from twin_daemon.estimation.solvers.trust_region import Derivative, Descent, descend, differenced, searched
from twin_daemon.estimation.variables import over_some
from twin_daemon.estimation.windows import spread


def fitted_to_the_end(
    hypothesis: Hypothesis, problem: Posterior, point: np.ndarray, evaluations: int
) -> tuple[Posterior, Descent]:
    """(the problem as it came to be, where the fit ends) on all motion.

    With the time step's error taken where it has come to; once more from where that is, if it has gone far, or to the
    end of what is near; and once more with what may only have made up for other values on the way put back: what began
    at an end of its range, where a law is simpler, what has come to an end of it, where another law begins at the
    other, and nuisances that are far off. What is put back has to be better on some of the motion first. What refines
    the effect is then moved where that pays the price of its values (Bayesian information criterion). In the end all
    derivatives are taken anew.
    """
    fit = _descended(hypothesis, problem, point, evaluations)
    while (begins := box_moved(fit)) is not None:
        again = _descended(hypothesis, *begins, evaluations)
        if again.cost > GONE_FAR * fit.cost:
            break
        fit, problem = again, begins[0]
    for put_back in (begun_ends, other_ends, nominal_again):
        point = put_back(fit)
        if not np.array_equal(point, fit.point):
            promising = _on_some_motion(fit, point)
            if promising is not None:
                again = _descended(hypothesis, problem, promising, evaluations)
                fit = min(fit, again, key=lambda one: one.cost)
    if (begins := refined(fit)) is not None:
        again = _descended(hypothesis, *begins, evaluations)
        more = len(again.point) - len(fit.point)
        if again.cost + more * np.log(fit.problem.effective_samples) < fit.cost:
            fit = again
    rows = fit.problem.residuals(fit.point[None])[0]
    own, slopes = own_columns(fit.problem), fit.slopes.copy()
    others = [i for i in range(len(fit.point)) if i not in own]
    slopes[:, others] = differenced(fit.problem, fit.point, rows, others)
    reached = Descent(fit.point, rows, slopes, fit.cost)
    return fit.problem, searched(fit.problem, reached, own)


def _descended(hypothesis: Hypothesis, problem: Posterior, point: np.ndarray, evaluations: int) -> Fit:
    derivative = Derivative(problem, own_columns(problem), across=True)
    for _ in range(2):
        problem = problem.corrected(problem.corrections_at(point))
        derivative = derivative.of(problem)  # what the time step gets wrong hardly hangs on the values
        found = descend(problem, point, derivative, evaluations=evaluations)
        point = found.point
        if found.rows @ found.rows > GONE_FAR * found.began:
            break
    return as_fit(hypothesis, problem, found)  # pyright: ignore[reportPossiblyUnboundVariable]


def _on_some_motion(fit: Fit, point: np.ndarray) -> np.ndarray | None:
    """Where a descent from a point (p,) ends on some of the motion; None where it cannot begin or the fit ends better.

    Both go down from there with the fit's own derivatives, so that this costs few roll-outs.
    """
    whole = fit.problem
    kept = spread(whole.recordings, SCREENED_S)
    if len(kept) == len(whole.recordings):
        return point if whole.is_possible(point) else None
    places = [next(i for i, r in enumerate(whole.recordings) if r is piece) for piece in kept]
    problem = whole.over(
        kept, over_some(whole.variables, whole.recordings, kept), [whole.corrections[i] for i in places]
    )
    blocks = whole.blocks()
    slopes = np.concatenate([*(fit.slopes[slice(*blocks[i])] for i in places), fit.slopes[blocks[-1][1] :]])
    own = own_columns(problem)
    here, there = (
        descend(problem, begin, Derivative(problem, own, slopes), evaluations=count)
        for begin, count in ((fit.point, RACE_ROLLOUTS[0]), (point, RACE_ROLLOUTS[-1]))
    )
    return there.point if there.rows @ there.rows < here.rows @ here.rows else None
