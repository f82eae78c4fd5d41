"""Two sessions fitted at once: what they share moves both, a change moves the later one only.

Gauss-Newton in roll-outs under Gaussian priors; the evidence is Laplace's. With two values of the prior's width for a
change, one for what sessions differ by anyway and one for what has changed, it is a spike and a slab (Mitchell and
Beauchamp 1988; George and McCulloch 1993).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from twin_daemon.changes.quantities import Quantity, with_companions
from twin_daemon.changes.sessions import Session
from twin_daemon.changes.thresholds import ABSENT, DRAWN, NEARBY, ROUNDS, SETTLED_NATS
from twin_daemon.estimation.solvers.trust_region import bounded_step
from twin_daemon.estimation.thresholds import GOOD_AGREEMENT, LEAST_AGREEMENT, SHRINK, SMALLEST_RADIUS, Z95


@dataclass(frozen=True)
class Fit:
    """Where both sessions are: `point` (2 q + o,) are the shared amounts, the changes, and the delays of both.

    `rows` (m,) and `slopes` (m, 2 q + o) are of both sessions; `sigmas` are the priors' and `changed` the slabs.
    """

    pair: Pair
    point: np.ndarray
    rows: np.ndarray
    slopes: np.ndarray
    changed: frozenset[int]

    @property
    def precision(self) -> np.ndarray:
        """(p, p) of the posterior."""
        return self.slopes.T @ self.slopes + np.diag(1.0 / self.pair.sigmas(self.changed) ** 2)

    @property
    def covariance(self) -> np.ndarray:
        return np.linalg.inv(self.precision)

    @property
    def cost(self) -> float:
        pulls = (self.point - self.pair.means) / self.pair.sigmas(self.changed)
        return float(self.rows @ self.rows + pulls @ pulls)

    @property
    def by_session(self) -> tuple[np.ndarray, np.ndarray]:
        """The rows of the earlier session, none where a version stands for it, and those of the later one."""
        size = self.pair.rows_before
        return self.rows[:size], self.rows[size:]

    @property
    def strain(self) -> float:
        """The cost of the later session, with that of values that go far for it, over the earlier's, both by sample.

        Of a version that stands for the earlier one over what its noise is taken for.
        """
        before, now = self.by_session
        earlier = float(before @ before)
        later = (self.cost - earlier) / len(now)
        return later / max(earlier / len(before), 1e-30) if len(before) else later

    @property
    def by_chance(self) -> tuple[float, float]:
        """(what the later session costs where nothing has changed, how much more it may cost by chance: 95 %).

        As the earlier one says; rows count as many samples as they are independent. Nothing where a version stands for
        it.
        """
        before, now = self.by_session
        earlier = float(before @ before)
        if earlier <= 0.0:
            return 0.0, 0.0
        expected = earlier * len(now) / len(before)
        return expected, Z95 * expected * float(np.sqrt(2.0 / earlier + 2.0 / expected))

    @property
    def asks_for_an_effect(self) -> bool:
        """Whether the later session is off, so that something may have appeared in it.

        An effect always takes a little of what the model gets wrong away. Where the earlier session, which shows
        nothing of it, is as far off, that is no evidence of it.
        """
        expected, more = self.by_chance
        return self.strain * expected > expected + more if expected > 0.0 else True

    @property
    def log_evidence(self) -> float:
        """Nats, up to what all fits of a pair share."""
        sigmas = self.pair.sigmas(self.changed)
        return -0.5 * self.cost - float(np.log(sigmas).sum()) - 0.5 * float(np.linalg.slogdet(self.precision)[1])

    def expected(self, changed: Collection[int]) -> tuple[np.ndarray, float]:
        """((p,) point, log evidence in nats) that other changes would reach, to first order from here."""
        sigmas = self.pair.sigmas(frozenset(changed))
        weights = 1.0 / sigmas**2
        precision = self.slopes.T @ self.slopes + np.diag(weights)
        pull = self.slopes.T @ self.rows + weights * (self.point - self.pair.means)
        step = -np.linalg.solve(precision, pull)
        gone = self.point + step
        cost = float(((self.rows + self.slopes @ step) ** 2).sum() + (((gone - self.pair.means) / sigmas) ** 2).sum())
        return gone, -0.5 * cost - float(np.log(sigmas).sum()) - 0.5 * float(np.linalg.slogdet(precision)[1])

    def said_of(self, index: int) -> tuple[float, float]:
        """(mean, variance) of what the recordings alone say of a change; the variance is infinite where nothing."""
        sigma2 = float(self.pair.sigmas(self.changed)[self.pair.count + index] ** 2)
        place = self.pair.count + index
        variance = float(self.covariance[place, place])
        information = 1.0 / variance - 1.0 / sigma2
        if information < 1e-9 / sigma2:
            return 0.0, float("inf")
        return float(self.expected(self.changed)[0][place] / variance / information), 1.0 / information


class Pair:
    """An earlier session, or what a version says in its place (None), and a later one, of one group of joints."""

    def __init__(self, before: Session | None, now: Session, means: np.ndarray, shared: np.ndarray) -> None:
        """`means` and `shared` (q,) are the belief about the shared amounts: centres and sigmas."""
        self.before, self.now = before, now
        self.count = len(now.quantities)
        self._delays = [*(before.onset_sigmas if before else ()), *now.onset_sigmas]
        self.means = np.concatenate([means, np.zeros(self.count + len(self._delays))])
        self._shared = shared
        self._spikes = np.array([q.spike for q in now.quantities])
        self._slabs = np.array([q.slab for q in now.quantities])

    def sigmas(self, changed: Collection[int]) -> np.ndarray:
        """(p,) of the priors, where some quantities have changed.

        An effect that is neither in the models nor has changed is not there.
        """
        every = self.now.quantities
        changed = with_companions(every, changed)
        is_slab = np.isin(np.arange(self.count), list(changed))
        there = np.array(
            [not (q.grows or q.beside) or i in self.now.active or i in changed for i, q in enumerate(every)]
        )
        shared = np.where(there, self._shared, ABSENT)
        return np.concatenate(
            [shared, np.where(is_slab, self._slabs, np.where(there, self._spikes, ABSENT)), self._delays]
        )

    @property
    def start(self) -> np.ndarray:
        return self.means.copy()

    @property
    def _never_less(self) -> list[int]:
        """Effects in the models of which there is none or some."""
        return [i for i in sorted(self.now.active) if self.now.quantities[i].grows]

    def with_active(self, active: Collection[int]) -> Pair:
        """The same with these effects in the models of both sessions."""
        before = self.before.with_active(active) if self.before else None
        return Pair(before, self.now.with_active(active), self.means[: self.count], self._shared)

    def with_quantity(self, index: int, quantity: Quantity) -> Pair:
        """The same with another law at the place of one quantity."""
        before = self.before.with_quantity(index, quantity) if self.before else None
        return Pair(before, self.now.with_quantity(index, quantity), self.means[: self.count], self._shared)

    def is_present(self, index: int) -> bool:
        """Whether the model of the earlier session has it."""
        quantity = self.now.quantities[index]
        return quantity.is_parameter or quantity.signed or index in self.now.active

    def baseline_only(self) -> Pair:
        """The earlier session alone, as a pair that has no later one to explain."""
        assert self.before is not None
        return _Alone(self.before, self.now, self.means[: self.count], self._shared)

    def points(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The points of the two sessions."""
        shared, change = point[: self.count], point[self.count : 2 * self.count]
        held = len(self.before.onset_sigmas) if self.before else 0
        delays = point[2 * self.count :]
        return np.concatenate([shared, delays[:held]]), np.concatenate([shared + change, delays[held:]])

    def rows(self, point: np.ndarray) -> np.ndarray:
        """(m,) residuals of both in standard deviations."""
        before, now = self.points(point)
        return np.concatenate([*([self.before.rows(before)] if self.before else []), self.now.rows(now)])

    @property
    def rows_before(self) -> int:
        """How many rows are the earlier session's."""
        return len(self.before.weights) if self.before else 0

    def slopes(self, point: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(m, p) derivative of these rows (m,)."""
        before, now = self.points(point)
        q, size = self.count, self.rows_before
        held = len(before) - q if self.before else 0
        out = np.zeros((len(rows), len(point)))
        if self.before:
            found = self.before.slopes(before, rows[:size])
            out[:size, :q], out[:size, 2 * q : 2 * q + held] = found[:, :q], found[:, q:]
        found = self.now.slopes(now, rows[size:])
        out[size:, :q] = out[size:, q : 2 * q] = found[:, :q]
        out[size:, 2 * q + held :] = found[:, q:]
        return out

    def fit(self, changed: Collection[int], begun: Fit | None = None, rounds: int = ROUNDS, radius: float = 1.0) -> Fit:
        """Both sessions fitted where these quantities may have changed, from where another fit has ended.

        `radius` is how far the first step goes at most, in sigmas of the priors.
        """
        changed = frozenset(changed)
        active = self.now.active
        if begun is None or begun.pair.now.active != active:
            point = self._within(self.start if begun is None else begun.point)
            rows = self.rows(point)
            slopes = self.slopes(point, rows)
        else:
            point, rows, slopes = begun.point, begun.rows, begun.slopes
        fit = Fit(self, point, rows, slopes, changed)
        for _ in range(rounds):
            found, radius = self._stepped(fit, radius)
            if found is None:
                break
            gained = fit.cost - found.cost
            fit = Fit(self, found.point, found.rows, self.slopes(found.point, found.rows), changed)
            if gained < 2.0 * SETTLED_NATS:
                break
        return fit

    def roughness(self, fit: Fit) -> float:
        """Nats by which the evidence scatters between points that are as good as the same, about a fit.

        What sticks and slips makes corners in the cost, and two descents that end on either side of one differ by it.
        """
        along = np.linalg.cholesky(fit.covariance)
        draws = NEARBY * np.random.default_rng(0).standard_normal((int(DRAWN), len(fit.point)))
        points = [self._within(fit.point + along @ draw) for draw in draws]
        costs = [Fit(self, point, self.rows(point), fit.slopes, fit.changed).cost for point in points]
        return 0.5 * float(np.sqrt(np.mean((np.array(costs) - fit.cost) ** 2)))

    def _stepped(self, fit: Fit, radius: float) -> tuple[Fit | None, float]:
        """(where the next step of a descent ends that gains anything, if one does; the radius of the next one).

        Steps are Gauss-Newton's within a box of so many sigmas of the priors: friction makes the cost rough, and a
        valley, such as of all torques together, is long and bent.
        """
        scale = self.sigmas(fit.changed)
        slopes = np.concatenate([fit.slopes * scale, np.eye(len(scale))])
        rows = np.concatenate([fit.rows, (fit.point - self.means) / scale])
        low = np.full(len(scale), -np.inf)
        low[self._never_less] = -fit.point[self._never_less] / scale[self._never_less]
        while radius > SMALLEST_RADIUS:
            step, expected = bounded_step(slopes, rows, (low, np.full(len(scale), np.inf)), radius)
            point = self._within(fit.point + scale * step)
            trial = Fit(self, point, self.rows(point), fit.slopes, fit.changed)
            gained = fit.cost - trial.cost
            if gained > GOOD_AGREEMENT * expected:
                return trial, 2.0 * radius
            if not gained >= LEAST_AGREEMENT * expected:
                radius = SHRINK * min(radius, float(np.abs(step).max(initial=0.0)))
            if gained > 0.0:
                return trial, radius
            if expected < 2.0 * SETTLED_NATS:
                break
        return None, radius

    def _within(self, point: np.ndarray) -> np.ndarray:
        """A point at which no effect in the models is below none, in either session."""
        point = point.copy()
        for index in self._never_less:
            point[index] = max(point[index], 0.0)
            point[self.count + index] = max(point[self.count + index], -point[index])
        return point


class _Alone(Pair):
    """The earlier session alone; of the later one only its shape."""

    def rows(self, point: np.ndarray) -> np.ndarray:
        assert self.before is not None
        return self.before.rows(self.points(point)[0])

    def slopes(self, point: np.ndarray, rows: np.ndarray) -> np.ndarray:
        assert self.before is not None
        before = self.points(point)[0]
        found, q = self.before.slopes(before, rows), self.count
        out = np.zeros((len(rows), len(point)))
        out[:, :q], out[:, 2 * q : 2 * q + len(before) - q] = found[:, :q], found[:, q:]
        return out

    def with_active(self, active: Collection[int]) -> Pair:
        return super().with_active(active).baseline_only()

    def with_quantity(self, index: int, quantity: Quantity) -> Pair:
        return super().with_quantity(index, quantity).baseline_only()
