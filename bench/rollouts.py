"""The one roll-out function against a bare loop of mj_step, and against `mujoco.rollout`, on as many threads."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
from mujoco import rollout

from bench.frame import Row, ratio_row
from twin_daemon.hand import load_hand
from twin_daemon.plant.motions import rich
from twin_daemon.processor_time import thread_count
from twin_daemon.signals.commands import CommandSignal
from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.submodel import submodel
from twin_daemon.simulation.twin import TwinModel

_CANDIDATES = 16
_SECONDS = 6.0
_FINGER = ("rh_FFJ1", "rh_FFJ2", "rh_FFJ3", "rh_FFJ4")


def rollouts(quick: bool, seed: int) -> Sequence[Row]:
    """Simulated steps a second, ours over the loop's."""
    hand = load_hand()
    twin = TwinModel.load(hand)
    finger = submodel(twin, _FINGER, np.zeros(len(twin.joints)))
    rows = []
    for label, model in (("whole hand, 24 joints", twin), ("one finger, 4 joints", finger)):
        commands = CommandSignal.from_trajectory(rich(hand, (), _SECONDS, seed))
        steps = int(_SECONDS / model.model.opt.timestep)
        controls = model.controls(
            commands.names, commands.sample(np.arange(steps) * model.model.opt.timestep), np.zeros(len(model.actuators))
        )
        models = [_candidate(model.model, i) for i in range(_CANDIDATES)]
        begin = models[0].qpos0[None]
        ways = {
            "ours": lambda models=models, controls=controls, begin=begin: roll_out(models, controls[None], begin)[
                :, 1:
            ],
            "a loop of mj_step": lambda models=models, controls=controls: _loop(models, controls),
            "mujoco.rollout": lambda models=models, controls=controls: _library(models, controls),
        }
        rates = {way: [] for way in ways}
        for _ in range(1 if quick else 5):
            positions = {}
            for way, simulate in ways.items():
                began = time.perf_counter()
                positions[way] = simulate()
                rates[way].append(_CANDIDATES * steps / (time.perf_counter() - began))
            for way in ways:
                assert np.array_equal(positions["ours"], positions[way]), f"{way} does not roll out the same"
        for way in ("a loop of mj_step", "mujoco.rollout"):
            what = f"{_CANDIDATES} candidates, {label}, against {way}"
            rows.append(ratio_row(what, rates["ours"], rates[way], unit="steps/s", least=0.9))
    return rows


def _candidate(model: mujoco.MjModel, number: int) -> mujoco.MjModel:
    changed = mujoco.MjModel.__copy__(model)
    changed.dof_damping[:] *= 1.0 + 0.01 * number
    return changed


def _loop(models: Sequence[mujoco.MjModel], controls: np.ndarray) -> np.ndarray:
    """(B, T, nq) positions by nothing but mj_step, candidates shared out over the threads."""
    out = np.empty((len(models), len(controls), models[0].nq))

    def simulate(index: int) -> None:
        data = mujoco.MjData(models[index])
        for step, row in enumerate(controls):
            data.ctrl[:] = row
            mujoco.mj_step(models[index], data)
            out[index, step] = data.qpos

    with ThreadPoolExecutor(thread_count()) as pool:
        list(pool.map(simulate, range(len(models))))
    return out


def _library(models: Sequence[mujoco.MjModel], controls: np.ndarray) -> np.ndarray:
    """(B, T, nq) positions by MuJoCo's own threaded roll-out."""
    start = mujoco.MjData(models[0])
    signature = mujoco.mjtState.mjSTATE_FULLPHYSICS.value
    state = np.empty(mujoco.mj_stateSize(models[0], signature))
    mujoco.mj_getState(models[0], start, state, signature)
    with rollout.Rollout(nthread=thread_count()) as pool:
        datas = [mujoco.MjData(models[0]) for _ in range(thread_count())]
        states, _ = pool.rollout(
            list(models), datas, np.tile(state, (len(models), 1)), np.tile(controls, (len(models), 1, 1))
        )
    return states[:, :, 1 : 1 + models[0].nq]
