"""Findings as a diagnosis would write them."""

from __future__ import annotations

from twin_daemon.diagnosis.verdict import Finding
from twin_daemon.estimation.estimate import Estimate


def finding(effect: str, target: str, joints: tuple[str, ...], rivals: str, **parameters: Estimate) -> Finding:
    """A finding that cannot be told from `rivals`; its held-out error falls to a fiftieth."""
    return Finding(
        effect=effect,
        target=target,
        joints=joints,
        parameters=parameters,
        evidence_nats=4321.0,
        holdout_mse_before_rad2=1e-3,
        holdout_mse_after_rad2=2e-5,
        holdout_gain=0.98,
        holdout_gain_ci95=(0.97, 0.99),
        confusable_with=(rivals,),
        explanation="The joint resists in proportion to its speed.",
    )
