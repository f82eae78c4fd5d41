"""One session of a group of joints as a function: amounts of its quantities in, residuals out."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twin_daemon.changes.quantities import Quantity, term_of, with_companions
from twin_daemon.changes.thresholds import EFFECT_STEP, ONSET_STEP_S, PARAMETER_STEP
from twin_daemon.estimation.nuisances import nuisance_variables
from twin_daemon.estimation.posterior import Correction, Posterior, correlation_s
from twin_daemon.estimation.thresholds import LEAST_CORRELATION_S, NUISANCE_REACH
from twin_daemon.estimation.uncertainty import correlation_time
from twin_daemon.estimation.variables import OnsetVariable, ParameterVariable, Variable
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel


@dataclass
class Session:
    """Pieces of a session's recordings, on a group's own model.

    A point is (q + o,): the amount z of each quantity, then the delay (s) of each recording's commands. Effects that
    are not in `active` count in proportion to their amounts, by a column that `look_at` differences once.
    """

    twin: TwinModel
    pieces: tuple[Aligned, ...]
    joints: tuple[str, ...]
    quantities: tuple[Quantity, ...]
    floor: np.ndarray
    corrections: Sequence[Correction]
    active: frozenset[int] = frozenset()
    columns: dict[int, np.ndarray] = field(default_factory=dict)
    weights: np.ndarray = field(init=False)
    _problems: dict[tuple, Posterior] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        found = nuisance_variables(self.twin, self.pieces, self.joints)
        self.onsets = tuple(v for v in found if isinstance(v, OnsetVariable))
        self._factors = tuple(_factor(q) for q in self.quantities if q.is_parameter)
        self._parameters = [i for i, q in enumerate(self.quantities) if q.is_parameter]
        self._effects = [i for i, q in enumerate(self.quantities) if not q.is_parameter]
        self._sizes = [piece.measured.shape[0] for piece in self.pieces]
        self.weigh(self.floor, correlation_s(self.twin, self.joints))

    @property
    def start(self) -> np.ndarray:
        """(q + o,): where the model is."""
        return np.zeros(len(self.quantities) + len(self.onsets))

    @property
    def onset_sigmas(self) -> list[float]:
        """Seconds: sigma of each delay."""
        return [v.prior.sigma for v in self.onsets if v.prior is not None]

    @property
    def floor_cost(self) -> float:
        """What a right model leaves of the squared rows as they are weighed at first."""
        return float(sum(size * len(self.joints) for size in self._sizes) / self._repeated)

    def weigh(self, variance: np.ndarray, correlated_s: float) -> None:
        """Takes residuals as noise of a variance (k,) rad^2 that repeats itself over some seconds."""
        found = []
        period = float(np.median([np.median(np.diff(piece.time_s)) for piece in self.pieces]))
        self._repeated = max(1.0, correlated_s / period)
        for piece in self.pieces:
            repeated = max(1.0, correlated_s / float(np.median(np.diff(piece.time_s))))
            found.append(np.repeat(1.0 / np.sqrt(variance * repeated)[None], len(piece.time_s), axis=0).ravel())
        self.weights = np.concatenate(found)

    def with_active(self, active: Collection[int]) -> Session:
        """The same with these effects in the model itself; columns of the others are kept."""
        active = with_companions(self.quantities, active)
        other = replace(self, active=active, columns=dict(self.columns))
        other.weights = self.weights
        return other

    def with_quantity(self, index: int, quantity: Quantity) -> Session:
        """The same with another law at the place of one quantity, not looked at yet."""
        others = tuple(quantity if i == index else one for i, one in enumerate(self.quantities))
        columns = {i: column for i, column in self.columns.items() if i != index}
        other = replace(self, quantities=others, columns=columns)
        other.weights = self.weights
        return other

    # -- residuals -----------------------------------------------------------------------------------------

    def gaps(self, points: np.ndarray) -> np.ndarray:
        """(B, m) rad: measured minus predicted of all pieces and joints, for points (B, q + o)."""
        amounts = {tuple(p[i] if i in self.active else 0.0 for i in self._effects) for p in points}
        out = np.empty((len(points), sum(self._sizes) * len(self.joints)))
        for amount in amounts:
            rows = [
                row
                for row, p in enumerate(points)
                if tuple(p[i] if i in self.active else 0.0 for i in self._effects) == amount
            ]
            problem = self._problem(dict(zip(self._effects, amount, strict=True)))
            found = problem.joint_residuals(np.array([self._units(points[row]) for row in rows]))
            out[rows] = np.concatenate([gap.reshape(len(rows), -1) for gap in found], axis=1)
        for index, column in self.columns.items():
            if index not in self.active:
                out += np.outer(points[:, index], column)
        return out

    def _units(self, point: np.ndarray) -> np.ndarray:
        """(p,) a point's parameters and delays as coordinates of the roll-outs' problem."""
        factors, delays = np.exp(point[self._parameters]), point[len(self.quantities) :]
        both = ((self._factors, factors), (self.onsets, delays))
        return np.array([v.coordinate(float(x)) for group, values in both for v, x in zip(group, values, strict=True)])

    def rows(self, point: np.ndarray) -> np.ndarray:
        """(m,) residuals in standard deviations at a point."""
        return self.gaps(point[None])[0] * self.weights

    def slopes(self, point: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(m, q + o) derivative of these residuals (m,) at a point."""
        count = len(self.quantities)
        out = np.zeros((len(rows), len(point)))
        for index, column in self.columns.items():
            if index not in self.active:
                out[:, index] = column * self.weights
        moved = [*self._parameters, *sorted(self.active), *range(count, len(point))]
        steps = np.array([self._step(index) for index in moved])
        trials = np.repeat(point[None], len(moved), axis=0)
        trials[np.arange(len(moved)), moved] += steps
        out[:, moved] = ((self.gaps(trials) * self.weights - rows) / steps[:, None]).T
        return out

    def _step(self, index: int) -> float:
        if index >= len(self.quantities):
            return float(ONSET_STEP_S)
        return float(PARAMETER_STEP if self.quantities[index].is_parameter else EFFECT_STEP)

    def look_at(self, point: np.ndarray, index: int) -> None:
        """Differences the column of an effect of typical size at a point; of no use where it diverges."""
        plain = np.where(np.isin(np.arange(len(point)), self._effects), 0.0, point)
        plain[list(self.active)] = point[list(self.active)]
        with_it = plain.copy()
        with_it[index] = 1.0
        bare = replace(self, columns={})
        there = replace(self, columns={}, active=self.active | self._with_it(index))
        self.columns[index] = there.gaps(with_it[None])[0] - bare.gaps(plain[None])[0]

    def _with_it(self, index: int) -> frozenset[int]:
        """A quantity with what is said beside it, or with what it is said beside."""
        owner = [i for i, q in enumerate(self.quantities) if q.name == self.quantities[index].beside]
        return with_companions(self.quantities, {index, *owner})

    # -- what is left --------------------------------------------------------------------------------------

    def gaps_by_piece(self, point: np.ndarray) -> list[np.ndarray]:
        """(n, k) rad of each piece: measured minus predicted at a point."""
        rows = self.gaps(point[None])[0].reshape(-1, len(self.joints))
        return np.split(rows, np.cumsum(self._sizes)[:-1])

    def spread(self, point: np.ndarray) -> tuple[np.ndarray, float]:
        """((k,) rad^2 mean square of each joint's residual, seconds over which it repeats itself) at a point."""
        squares, count, times = 0.0, 0, []
        for piece, gap in zip(self.pieces, self.gaps_by_piece(point), strict=True):
            squares, count = squares + (gap**2).sum(axis=0), count + len(gap)
            period = float(np.median(np.diff(piece.time_s)))
            times += [correlation_time(gap[:, k]) * period for k in range(gap.shape[1])]
        return np.maximum(squares / count, self.floor), float(max(np.median(times), LEAST_CORRELATION_S))

    def _problem(self, amounts: dict[int, float]) -> Posterior:
        key = tuple((i, amounts[i]) for i in sorted(self.active))
        if key not in self._problems:
            terms = self.twin.terms
            for index, _ in key:
                if not self.quantities[index].beside:
                    terms = terms.with_effect(term_of(self.quantities, index, amounts))
            if len(self._problems) > 8:
                self._problems.clear()
            twin = self.twin.changed(terms) if key else self.twin
            variables: tuple[Variable, ...] = (*self._factors, *self.onsets)
            self._problems[key] = Posterior(
                twin, self.pieces, variables, self.joints, self.floor, corrections=self.corrections
            )
        return self._problems[key]


def _factor(quantity: Quantity) -> ParameterVariable:
    return ParameterVariable(
        name=quantity.name,
        unit="of the model's",
        lower=1.0 / NUISANCE_REACH,
        upper=NUISANCE_REACH,
        start=1.0,
        log=True,
        parameters=(quantity.name,),
        factor=True,
        joints=quantity.joints,
    )
