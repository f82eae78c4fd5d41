"""mujoco.sysid (Google DeepMind) on what `twin calibrate` fits: the same recording, parameters, bounds and start."""

from __future__ import annotations

import contextlib
import io
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from bench.frame import LeftOut
from bench.objective import Objective
from twin_daemon.estimation.subproblems import reduced_problems
from twin_daemon.estimation.variables import Variable
from twin_daemon.estimation.windows import excerpts
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class SysidRun:
    """What one run found, judged as every other model is. Errors in rad^2; `unbounded` counts infinite intervals."""

    after_rad2: float
    held_rad2: float | None
    wall_s: float
    roll_outs: int
    intervals: int
    unbounded: int


def run_sysid(objective: Objective, *, tuned: bool, most_iterations: int = 200) -> SysidRun:
    """The toolbox with its default settings on the nominal model; or tuned, as somebody would who knows both.

    Tuned, the best of what was tried: the sub-model without what does not move, residuals in rad instead of shares of
    a signal's norm (what is judged is rad), and scaled parameters. A free delay of the sensors, a start off the
    bounds and longer finite differences made it no better.
    """
    sysid = _sysid()
    twin, aligned = objective.twin, objective.aligned[0]
    if tuned:
        (sub,) = reduced_problems(
            twin, excerpts(objective.aligned), objective.variables, objective.joints, separable=False
        )
        twin, aligned = sub.problem.twin, sub.problem.recordings[0]
    sequences = _sequences(sysid, twin, aligned, objective.joints)
    parameters = sysid.ParameterDict()
    for variable in objective.variables:
        parameters.add(
            sysid.Parameter(
                variable.name, variable.start, variable.lower, variable.upper, modifier=_modifier(twin, variable)
            )
        )
    options: dict[str, Any] = {}
    transform = None
    if tuned:
        transform = sysid.SignalTransform(normalize=False)
        options = {"x_scale": "jac"}
    count = 0
    residual = sysid.build_residual_fn(models_sequences=[sequences], modify_residual=transform and transform.apply)

    def counted(x: np.ndarray, params: Any, **more: Any) -> Any:
        nonlocal count
        count += 1 if x.ndim == 1 else x.shape[1]
        return residual(x, params, **more)

    began = time.monotonic()
    with contextlib.redirect_stdout(io.StringIO()):  # its optimiser prints every iteration
        found, result = sysid.optimize(parameters, counted, max_iters=most_iterations, **options)
    wall_s = time.monotonic() - began
    _, half_widths = sysid.calculate_intervals(residual(found.as_vector(), found)[0], result.jac)
    values = {name: float(found[v.name].value[0]) for v in objective.variables for name in v.parameters_moved}
    after, held = objective.judged(objective.twin.changed(objective.twin.terms.with_parameters(values)))
    unbounded = int((~np.isfinite(half_widths)).sum())
    return SysidRun(after, held, wall_s, count, len(half_widths), unbounded)


def _sysid() -> Any:
    try:
        from mujoco import sysid
        from mujoco.sysid import optimize  # noqa: F401 - without its extra the package is there and empty
    except ImportError:
        raise LeftOut("mujoco.sysid is not installed; it comes with the extra `bench`") from None
    return sysid


def _sequences(sysid: Any, twin: TwinModel, aligned: Aligned, joints: tuple[str, ...]) -> Any:
    """The twin's MJCF with a sensor at each joint that counts, and the recording without its held-out samples."""
    spec = twin.spec.copy()
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    for name in joints:
        sensor = spec.add_sensor(name=name, type=mujoco.mjtSensor.mjSENS_JOINTPOS)
        sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_JOINT, twin.hand.description.joints[name].joint
    model = spec.compile()
    columns = [twin.joints.index(name) for name in joints]
    known = np.isfinite(aligned.measured[:, columns]).all(axis=1)
    measured = sysid.TimeSeries(
        aligned.time_s[known],
        aligned.measured[known][:, columns],
        sysid.TimeSeries.compute_all_sensor_mapping(model),
    )
    grid = np.arange(0.0, aligned.time_s[-1] + 2 * model.opt.timestep, model.opt.timestep)
    control = sysid.TimeSeries(grid, aligned.controls(twin, grid), sysid.TimeSeries.compute_all_control_mapping(model))
    start = sysid.create_initial_state(model, *aligned.start_state(twin), np.zeros(model.na))
    return sysid.ModelSequences(twin.hand.name, spec, aligned.recording.name, start, control, measured)


def _modifier(twin: TwinModel, variable: Variable) -> Callable[[Any, Any], None]:
    targets = [twin.parameter(name) for name in variable.parameters_moved]

    def modify(spec: Any, parameter: Any) -> None:
        for target in targets:
            target.kind.edit(getattr(spec, target.kind.element)(target.element), float(parameter.value[0]))

    return modify
