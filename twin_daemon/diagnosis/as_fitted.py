"""The robot moving as it was fitted: what the measured motion of the others does to a group is computed from that."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from twin_daemon.diagnosis.group import look
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.estimation.nuisances import factors
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.executor import concurrently_here
from twin_daemon.simulation.twin import TwinModel


def links_uncertain(twin: TwinModel) -> bool:
    """Whether links may be heavier or lighter than the model has them."""
    return twin.hand.description.nominal_uncertainty.mass > 0.0


def with_uncertain_links(twin: TwinModel, reduction: Reduction) -> Reduction:
    """The reduction in which links may be heavier or lighter, where they may."""
    return reduction.with_link_masses(twin) if links_uncertain(twin) else reduction


def closer(
    twin: TwinModel,
    reduction: Reduction,
    looked_at: Sequence[tuple[Reduced, PartFit]],
    above: Sequence[tuple[Reduced, PartFit]],
) -> tuple[Reduction, list[tuple[Reduced, PartFit]]]:
    """(the reduction with the others moving as they were fitted and with what costs most, that links may be heavier;
    the groups above the floor fitted anew on that).
    """
    reduction = reduction.following(with_values(twin, as_fitted(twin, looked_at)))
    reduction = with_uncertain_links(twin, reduction)
    return reduction, looked_at_again(twin, reduction, [reduced for reduced, _ in above])


def looked_at_again(
    twin: TwinModel,
    reduction: Reduction,
    groups: Sequence[Reduced],
    how: Callable[[Reduced], tuple[Reduced, PartFit]] = look,
) -> list[tuple[Reduced, PartFit]]:
    """Groups cut anew from a reduction, each with its fit; without those that touch something nearly all the time."""

    def again(group: Reduced) -> tuple[Reduced, PartFit] | None:
        reduced = reduction.together(twin, [group])
        return None if reduced is None else how(reduced)

    return [found for found in concurrently_here(again, groups) if found is not None]


def as_fitted(twin: TwinModel, looked_at: Sequence[tuple[Reduced, PartFit]]) -> dict[str, float]:
    """What the groups' nuisances have come to, whatever they stand for: parameters of a twin, absolute, by name."""
    found: dict[str, float] = {}
    for _, part in looked_at:
        fitted = zip(part.base.problem.variables, part.base.point, strict=True)
        known = {v.name: v.value(float(unit)) for v, unit in fitted}
        found.update(factors(part.base.problem.variables, known))
    return {name: factor * twin.parameter(name).read(twin.base_model) for name, factor in found.items()}


def with_values(twin: TwinModel, values: Mapping[str, float]) -> TwinModel:
    """A twin with parameters where fits have taken them: it moves more like the robot.

    Accelerations of the measured motion are for the most part those of a prediction. One with half of a joint's
    inertia puts a load on that joint itself that nothing explains.
    """
    within = {}
    for name, value in values.items():
        # a fit beside something that is missing goes anywhere, but not beyond what a model can have
        within[name] = float(np.clip(value, *twin.parameter(name).limits))
    return twin.changed(twin.terms.with_parameters(within))
