"""What a chart draws of one joint: position, velocity or effort, differentiated, filtered, over time or frequency.

Filters have no phase: what they leave is neither late nor early, so that residuals stay comparable.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import signal
from starlette.requests import Request

from twin_daemon.comparison.compare import Comparison
from twin_daemon.comparison.dependence import servo_load
from twin_daemon.errors import BadInput
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.web.queries import number

Quantity = Literal["position", "velocity", "effort"]
_UNITS: dict[Quantity, tuple[str, str]] = {
    "position": ("rad", "rad/s"),
    "velocity": ("rad/s", "rad/s²"),
    "effort": ("N m", "N m/s"),
}
_ORDER = 2  # of the Butterworth filter, which runs forth and back
_SETTLES_S = 1.5  # times its period: so much beyond either end of what is shown is filtered as well
_HIGHEST = 0.9  # of half the sampling rate
_SEGMENT_S = 8.0  # of a spectrum
_MOST_LINES = 600


@dataclass(frozen=True)
class Shape:
    """What is drawn: a quantity, its derivative or not, below `lowpass_hz` (0: all of it)."""

    quantity: Quantity = "position"
    derivative: bool = False
    lowpass_hz: float = 0.0

    @property
    def unit(self) -> str:
        return _UNITS[self.quantity][self.derivative]

    @property
    def plain(self) -> bool:
        """Whether positions are drawn as they are."""
        return self == Shape()

    @classmethod
    def of(cls, request: Request) -> Shape:
        """As the page asks for it. Raises BadInput."""
        text = request.query_params.get("quantity", "position")
        known: dict[str, Quantity] = {one: one for one in _UNITS}
        quantity = known.get(text)
        if quantity is None:
            raise BadInput(f"no quantity '{text:.40}'", allowed=", ".join(_UNITS))
        lowpass_hz = number(request, "lowpass_hz", 0.0)
        if lowpass_hz < 0.0:
            raise BadInput(f"a low-pass filter at {lowpass_hz:g} Hz", allowed="0 (none) or more")
        return cls(quantity, request.query_params.get("derivative") == "1", lowpass_hz)


@dataclass(frozen=True)
class Drawn:
    """Curves (k,) of one joint; NaN where nothing says it. An effort that nobody recorded is that of the servo."""

    measured: np.ndarray
    command: np.ndarray
    twins: dict[str, np.ndarray]


def drawn(
    shape: Shape,
    aligned: Aligned,
    column: int,
    chosen: slice,
    command: Callable[[np.ndarray], np.ndarray] | None,
    twins: Mapping[str, tuple[TwinModel, Comparison]],
) -> Drawn:
    """The curves of a joint's column over samples `chosen`. `command` gives rad at times (k,); without it there is
    none. Raises BadInput for a filter that the sampling rate does not allow."""
    time_s = aligned.time_s
    rate_hz = 1.0 / float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0
    if shape.lowpass_hz >= _HIGHEST * rate_hz / 2.0:
        raise BadInput(
            f"a low-pass filter at {shape.lowpass_hz:g} Hz", allowed=f"below {_HIGHEST * rate_hz / 2.0:.3g} Hz here"
        )
    pad = 2 + (round(_SETTLES_S / shape.lowpass_hz * rate_hz) if shape.lowpass_hz else 0)
    wide = slice(max(chosen.start - pad, 0), min(chosen.stop + pad, len(time_s)))
    own = slice(chosen.start - wide.start, chosen.stop - wide.start)
    around_s = time_s[wide]

    def shaped(values: np.ndarray, order: int) -> np.ndarray:
        for _ in range(order + shape.derivative):
            values = np.gradient(values, around_s) if len(values) > 1 else np.zeros_like(values)
        return _below(values, shape.lowpass_hz, rate_hz)[own]

    slopes = 1 if shape.quantity == "velocity" else 0
    nothing = np.full(chosen.stop - chosen.start, np.nan)
    if shape.quantity == "effort":
        sensed = _recorded(aligned, column, "effort")
        if sensed is None and twins:
            twin, found = next(iter(twins.values()))
            sensed = servo_load(twin, found, column)
        torques = {name: servo_load(twin, _predicted(found), column) for name, (twin, found) in twins.items()}
        known = {name: nothing if one is None else shaped(one[wide], 0) for name, one in torques.items()}
        return Drawn(nothing if sensed is None else shaped(sensed[wide], 0), nothing, known)
    sensed = _recorded(aligned, column, "velocity") if shape.quantity == "velocity" else None
    measured = shaped(aligned.measured[wide, column], slopes) if sensed is None else shaped(sensed[wide], 0)
    predicted = {name: shaped(found.predicted[wide, column], slopes) for name, (_, found) in twins.items()}
    told = nothing if command is None else command(around_s)
    return Drawn(measured, shaped(told, slopes) if np.isfinite(told).any() else nothing, predicted)


def spectrum(values: np.ndarray, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """(f (k,) Hz, amplitude density (k,) in the unit over root Hz) of values (n,), by Welch's method; gaps are bridged.

    Of what a chart has no room for, the strongest line of each stretch of frequencies is kept.
    """
    length = min(len(values), max(round(_SEGMENT_S * rate_hz), 8))
    frequency, power = signal.welch(_bridged(values), rate_hz, nperseg=length, detrend="linear")
    frequency, density = frequency[1:], np.sqrt(power[1:])
    if len(frequency) <= _MOST_LINES:
        return frequency, density
    place = np.unique(np.geomspace(1, len(frequency), _MOST_LINES).astype(int)) - 1
    return frequency[place], np.maximum.reduceat(density, place)


def _predicted(found: Comparison) -> Comparison:
    """The comparison as if the hand had done what was predicted."""
    return replace(found, aligned=replace(found.aligned, measured=found.predicted))


def _recorded(aligned: Aligned, column: int, name: Literal["velocity", "effort"]) -> np.ndarray | None:
    """(n,) what the recording holds of it; None where that is nothing."""
    values, joint = getattr(aligned.recording, name), aligned.joints[column]
    if values is None or joint not in aligned.recording.joints:
        return None
    found = values[:, aligned.recording.joints.index(joint)]
    return found if np.isfinite(found).any() else None


def _bridged(values: np.ndarray) -> np.ndarray:
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.nan_to_num(values)
    at = np.arange(len(values))
    return np.interp(at, at[known], values[known])


def _below(values: np.ndarray, lowpass_hz: float, rate_hz: float) -> np.ndarray:
    """The values (n,) without what is faster, neither late nor early; what was not known stays so."""
    known = np.isfinite(values)
    if not lowpass_hz or not known.any() or len(values) < 4 * _ORDER:
        return values
    sections = signal.butter(_ORDER, lowpass_hz, fs=rate_hz, output="sos")
    smooth = signal.sosfiltfilt(sections, _bridged(values), padlen=min(len(values) - 1, round(rate_hz / lowpass_hz)))
    return np.where(known, smooth, np.nan)
