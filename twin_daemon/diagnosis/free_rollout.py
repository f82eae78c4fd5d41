"""Errors of one free roll-out of the whole hand over each recording, as `twin compare` and versions have them.

A finding is validated in short pieces of its own part, each begun where the measurement is, with everything uncertain
as fitted: that says whether the law is right. A free roll-out begins once, and what is wrong adds up: that says what
somebody who uses the twin gets. Each finding has both, by two names.
"""

from __future__ import annotations

from collections.abc import Sequence

from twin_daemon.comparison.compare import compare_recording, mean_over_moving, pooled
from twin_daemon.diagnosis.verdict import Diagnosis, Finding
from twin_daemon.errors import BadInput
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel


def mean_error(twin: TwinModel, recordings: Sequence[Aligned], joints: Sequence[str] = ()) -> float | None:
    """Mean squared error (rad^2) of the twin over the joints that move, or over some of them; None for no data."""
    whole, some = free_errors(twin, recordings, joints)
    return some if joints else whole


def free_errors(
    twin: TwinModel, recordings: Sequence[Aligned], joints: Sequence[str]
) -> tuple[float | None, float | None]:
    """Mean squared errors (rad^2) over (all joints that move, those of some); None for no data."""
    if not recordings:
        return None, None
    found = pooled([compare_recording(twin, r) for r in recordings])
    return mean_over_moving(found), mean_over_moving(found, joints)


def with_finding(twin: TwinModel, finding: Finding) -> TwinModel:
    """The twin with what was found, and with its own parameters where they came to lie beside it."""
    return twin.changed(twin.terms.with_effect(finding.term).with_parameters(finding.moved))


def with_free_errors(twin: TwinModel, holdout: Sequence[Aligned], found: Diagnosis) -> Diagnosis:
    """The diagnosis of a twin with each finding's free roll-outs on held-out motion: this finding alone, as added."""
    return found.model_copy(update={"findings": tuple(_free(twin, holdout, finding) for finding in found.findings)})


def _free(twin: TwinModel, holdout: Sequence[Aligned], finding: Finding) -> Finding:
    try:
        changed = with_finding(twin, finding)
    except BadInput:  # it stands only beside the others
        return finding
    before, own_before = free_errors(twin, holdout, finding.joints)
    after, own_after = free_errors(changed, holdout, finding.joints)
    return finding.model_copy(
        update={
            "free_holdout_mse_before_rad2": before,
            "free_holdout_mse_after_rad2": after,
            "free_holdout_joints_mse_before_rad2": own_before,
            "free_holdout_joints_mse_after_rad2": own_after,
        }
    )
