"""The residual's JSON as joint states, for those who write it down or pass it on."""

from __future__ import annotations

import json

import numpy as np

from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample, MalformedPayload

_MAX_STAMP_NS = 2**31 * 1_000_000_000


def residual_sample(payload: bytes) -> JointSample:
    """The residual as joint states: `position` (k,) is measured minus predicted, rad; NaN where it is not known."""
    if len(payload) > cdr.MAX_BYTES:
        raise MalformedPayload("too_large", f"{len(payload)} bytes, at most {cdr.MAX_BYTES} are read")
    try:
        read = json.loads(payload)
        stamp_ns, values = read["stamp_ns"], read["residual_rad"]
        names = tuple(values)
        position = np.array([np.nan if value is None else float(value) for value in values.values()])
    except Exception as error:  # foreign bytes break a reader in every way there is
        raise MalformedPayload("malformed", f"not a residual: {error!r:.200}") from None
    if type(stamp_ns) is not int or not 0 <= stamp_ns < _MAX_STAMP_NS or not names:
        raise MalformedPayload("malformed", "a residual without joints or with a stamp that does not fit into ROS")
    return JointSample(stamp_ns, names, position)


def known_residual(payload: bytes) -> JointSample:
    """The same without the joints that have no residual."""
    sample = residual_sample(payload)
    known = np.isfinite(sample.position)
    names = tuple(name for name, is_known in zip(sample.names, known, strict=True) if is_known)
    return JointSample(sample.stamp_ns, names, sample.position[known])
