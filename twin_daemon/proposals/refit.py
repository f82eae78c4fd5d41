"""The few values of a formula, fitted in roll-outs beside the nuisances: the law itself then, not its curve."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin_daemon.estimation.estimate import with_unit
from twin_daemon.estimation.thresholds import Z95
from twin_daemon.proposals.descent import Reached, gauss_newton
from twin_daemon.proposals.formula import Formula, dense, formulas, sharp_formulas
from twin_daemon.proposals.law_problem import LawProblem
from twin_daemon.proposals.search import FittedLaw, JointSearch
from twin_daemon.proposals.thresholds import (
    CLOSER,
    CLOSER_LOOKS,
    FORMULA_FLOOR,
    FORMULA_GAIN,
    FORMULA_MOVES,
    FORMULA_ROUNDS,
    FORMULAS_RACING,
    FORMULAS_TRIED,
    RACING_ROUNDS,
    SPOKEN_SHARE,
)


@dataclass(frozen=True, eq=False)
class RefittedLaw:
    """A law with its formula: values by name as (value, lower, upper) at 95 %; `curve` (k,) at `knots` (k,)."""

    law: FittedLaw
    formula: Formula | None
    values: dict[str, tuple[float, float, float]]
    knots: tuple[float, ...]
    curve: np.ndarray
    sigmas: np.ndarray

    @property
    def is_constant(self) -> bool:
        return self.formula is not None and self.formula.family.key == "constant"

    @property
    def text(self) -> str:
        """The formula in words and symbols, or the elements of a memory, or that it is a curve without one."""
        feature = self.law.feature
        if self.formula is not None:
            return self.formula.text(SYMBOLS.get(feature.over, feature.over))
        if feature.memory:
            strong = np.abs(self.curve) > SPOKEN_SHARE * np.abs(self.curve).max(initial=1e-12)
            pairs = zip(self.curve[strong], np.array(feature.knots)[strong], strict=True)
            over = MEMORY_UNITS[feature.memory]
            elements = [f"{with_unit(f'{size:.3g}', feature.unit)} over {length:.3g} {over}" for size, length in pairs]
            return f"{feature.memory}: {', '.join(elements)}"
        return f"a curve over {SYMBOLS.get(feature.over, feature.over)} without a simple formula"


MEMORY_UNITS = {"play": "rad", "relaxation": "s", "creep": "s", "lag": "s", "slew": "rad/s"}
SYMBOLS = {
    "position": "q",
    "velocity": "v",
    "acceleration": "a",
    "load": "|u|",
    "orientation": "g",
    "command_rate": "c'",
    "neighbour_velocity": "v_n",
    "time": "t",
    "heat": "h",
    "command": "c",
    "error": "e",
    "neighbour": "q_n",
}


class _FormulaProblem:
    """A law's problem over nuisances and the values of a formula, whose unit coordinate 0.5 is where they began."""

    def __init__(self, problem: LawProblem, formula: Formula) -> None:
        self._problem, self._formula = problem, formula
        self._x = np.array(problem.knots)
        self.scales = _scales(formula, self._x)

    def values(self, points: np.ndarray) -> np.ndarray:
        return self._formula.values + (points[:, self._problem.own :] - 0.5) * 2.0 * self.scales

    def law_points(self, points: np.ndarray) -> np.ndarray:
        """(B, p) of the law's own problem."""
        own = self._problem.own
        curves = [self._formula.family.shape(values, self._x) for values in self.values(points)]
        return np.stack([self._problem.point(p[:own], c) for p, c in zip(points, curves, strict=True)])

    def residuals(self, points: np.ndarray) -> np.ndarray:
        return self._problem.residuals(self.law_points(points))


def _scales(formula: Formula, x: np.ndarray) -> np.ndarray:
    """(q,) by how much each value changes the curve about as much as it is large: values have units of their own."""
    curve = formula.family.shape(formula.values, x)
    size = max(float(np.ptp(curve)), float(np.abs(curve).max()), 1e-9)
    found = np.maximum(np.abs(formula.values), 1e-6)
    for index, width in enumerate(1e-3 * found):
        moved = formula.values.copy()
        moved[index] += width
        changes = float(np.abs(formula.family.shape(moved, x) - curve).max()) / width
        if changes > 0.0:
            found[index] = size / changes
    return found


def refitted(search: JointSearch, law: FittedLaw) -> RefittedLaw:
    """The law by the best of some formulas, or by its curve where what that leaves less is worth its knots.

    The simplest memory is one element.
    """
    if law.feature.memory:
        law = max(law, _one_element(search, law), key=lambda one: one.nats)
    best: RefittedLaw | None = None
    for formula in _promising(search, law):
        found = _by_formula(search, law, formula)
        if best is None or found.law.nats > best.law.nats:
            best = found
    is_line = len(law.feature.knots) == 2 and not law.feature.memory
    if best is not None and (best.law.nats >= law.nats or is_line):
        return best
    return RefittedLaw(law, None, {}, law.feature.knots, law.coefficients, law.sigmas)


def _one_element(search: JointSearch, law: FittedLaw) -> FittedLaw:
    """The memory as one element, whose length is fitted as well: the best of some lengths, then of closer ones."""
    lengths, sizes = np.array(law.feature.knots), np.abs(law.coefficients)
    strongest = int(np.argmax(sizes))
    apart = float(np.diff(np.log(lengths)).min())
    tried: dict[float, tuple[LawProblem, Reached]] = {}
    best = float(lengths[strongest])
    for _ in range(CLOSER_LOOKS):
        for length in (best * np.exp(apart * np.array([-1.0, -0.5, 0.0, 0.5, 1.0]))).tolist():
            if length not in tried:
                problem = search.problem(replace(law.feature, knots=(length,)), law.problem.smoothness)
                start = problem.point(law.reached.point[: problem.own], law.coefficients[[strongest]])
                tried[length] = problem, gauss_newton(problem, start, problem.own, RACING_ROUNDS)
        best = min(tried, key=lambda length: tried[length][1].cost)
        apart *= CLOSER
    return search.judged(law.trial, *tried[best], freedom=2.0)


def _dense(search: JointSearch, law: FittedLaw) -> LawProblem:
    return search.problem(replace(law.feature, knots=dense(law.feature, search.reached(law.feature))), 0.0)


def _promising(search: JointSearch, law: FittedLaw) -> list[Formula]:
    """The formulas of which one roll-out each leaves least, their values priced."""
    candidates = formulas(law.feature, law.coefficients, law.sigmas)[:FORMULAS_RACING]
    candidates += sharp_formulas(law.feature, search.stiffness)
    if not candidates:
        return []
    problem = _dense(search, law)
    x, nuisances = np.array(problem.knots), law.reached.point[: problem.own]
    curves = [one.family.shape(one.values, x) for one in candidates]
    rows = problem.residuals(np.array([problem.point(nuisances, curve) for curve in curves]))
    left = (rows**2).sum(axis=1).tolist()
    prices = [search.price(cost, len(one.values)) for cost, one in zip(left, candidates, strict=True)]
    return [candidates[index] for index in np.argsort(prices, kind="stable")[:FORMULAS_TRIED]]


def _descended(problem: LawProblem, formula: Formula, nuisances: np.ndarray) -> tuple[_FormulaProblem, Reached]:
    """The formula's values fitted beside the nuisances, while that gains and where they come to the end of a range."""
    left, before = FORMULA_MOVES, np.inf
    while True:
        wrapped = _FormulaProblem(problem, formula)
        start = np.concatenate([nuisances, np.full(len(formula.values), 0.5)])
        reached = gauss_newton(wrapped, start, problem.own, FORMULA_ROUNDS)
        left -= 1
        at_end = np.abs(reached.point[problem.own :] - 0.5).max() > 0.5 - 1e-9
        if not left or (not at_end and reached.cost > (1.0 - FORMULA_GAIN) * before):
            return wrapped, reached
        before = reached.cost
        formula = replace(formula, values=wrapped.values(reached.point[None])[0])
        nuisances = reached.point[: problem.own]


def _by_formula(search: JointSearch, law: FittedLaw, formula: Formula) -> RefittedLaw:
    problem = _dense(search, law)
    own = problem.own
    wrapped, reached = _descended(problem, formula, law.reached.point[:own])
    values = wrapped.values(reached.point[None])[0]
    inflation = max(1.0, reached.cost / max(problem.effective_samples, 1.0))
    covariance = inflation * np.linalg.pinv(reached.slopes.T @ reached.slopes)
    sigmas = np.sqrt(np.maximum(np.diag(covariance)[own:], 0.0)) * 2.0 * wrapped.scales
    half = np.maximum(Z95 * sigmas, FORMULA_FLOOR * np.abs(values))
    named = {
        name: (float(v), float(v - h), float(v + h))
        for name, v, h in zip(formula.family.names, values, half, strict=True)
    }
    found = replace(formula, values=values)
    point = wrapped.law_points(reached.point[None])[0]
    # the rows and slopes stay those of the formula's few values
    judged = search.judged(law.trial, problem, Reached(point, reached.rows, reached.slopes), freedom=len(values))
    x = np.array(problem.knots)
    curve = formula.family.shape(values, x)
    moved = np.array([formula.family.shape(values + 1e-4 * step, x) for step in np.diag(wrapped.scales)])
    slopes = 2.0 * (moved - curve).T / 1e-4  # by unit coordinate
    band = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", slopes, covariance[own:, own:], slopes), 0.0))
    return RefittedLaw(judged, found, named, problem.knots, curve, band)
