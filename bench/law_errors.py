"""How far each law of the library is off the same law written apart, at the same values and nothing else wrong.

    python -m bench.law_errors [--seeds 90000 90002 90004 90006] [--laws load_friction backlash] [--page FILE]

Robots are drawn at random and exactly known, sensors are ideal. A plant runs with a law of `bench.random_robots` at a
finer time step, the twin at the model's own with the library's law at the plant's values. What is left is the law's
error and the time step's, which is told beside it by the same robot without any law. Left out are laws of which a
plant does not say all values: a ripple's phase, a tilt's way, where on its link a load hangs.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.random_robots.cases import Plan, build
from bench.random_robots.laws import LIBRARY as WRITTEN_APART
from bench.random_robots.laws import Law
from bench.random_robots.laws.friction import Coulomb
from bench.random_robots.laws.transmission import ServoPlay
from bench.random_robots.plants import SETTLE_S, Unstable, arriving, at_samples, steps_of
from bench.random_robots.robots import Robot
from bench.random_robots.strength import rms
from twin_daemon.effects import LIBRARY
from twin_daemon.hand import load_hand
from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.workflows.session import silence_mujoco

SEEDS = (90000, 90002, 90004, 90006)
_LEFT_OUT = {"torque_ripple", "gravity_tilt", "payload"}
# what a form of a law is by the library's other values
_BESIDE: dict[type[Law], dict[str, float]] = {ServoPlay: {"braked": 1.0}, Coulomb: {"sticking": 0.0}}


@dataclass(frozen=True)
class LawError:
    """Of a law at one robot, mrad (mm) rms at its joint: what it does, what the library's law is off, what a model
    without any law is off by its time step, and what the sensors would leave."""

    form: str
    key: str
    seed: int
    step_s: float
    does: float
    off: float
    step: float
    sensors: float


def law_error(law: type[Law], seed: int) -> LawError:
    """Raises Unstable where no robot of this seed can have the law."""
    case = build(Plan(seed, "single", (law,)), "exact")
    robot, hidden, targets = case.robot, case.hidden[0].law, case.targets("fit")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.xml"
        path.write_text(robot.xml)
        twin = TwinModel.load(load_hand(model=path))
    effect = LIBRARY[hidden.key]
    place = robot.joints[hidden.site.joint]
    if effect.acts_on in ("actuator", "tendon"):
        place = twin.actuators[hidden.site.servo]
    # what a plant does not have is not there, but for what a law needs at all
    values = {p.name: p.default if p.log else p.neutral for p in effect.parameters}
    values |= hidden.values() | _BESIDE.get(law, {})
    changed = twin.changed(Terms(effects=(EffectTerm(effect=hidden.key, target=place, values=values),)))
    sound, plant = case.plant.run(targets), case.plant.run(targets, [hidden])
    column = hidden.site.joint
    gaps = (plant - sound, _moved(changed, robot, targets) - plant, _moved(twin, robot, targets) - sound)
    does, off, step = (1e3 * float(rms(gap)[column]) for gap in gaps)
    sensors = 1e3 * float(robot.floor()[column])
    return LawError(law.__name__, hidden.key, seed, robot.step_s, does, off, step, sensors)


def _moved(twin: TwinModel, robot: Robot, targets: np.ndarray) -> np.ndarray:
    """(n, j) what ideal sensors would read of the twin, for commands (n, a): settled first, its bus as late."""
    step_s = float(twin.model.opt.timestep)
    controls = arriving(robot, targets, step_s, steps_of(robot, targets, step_s))
    rest = {
        robot.joints[joint]: target / len(servo.joints)
        for servo, target in zip(robot.servos, targets[0], strict=True)
        for joint in servo.joints
    }
    start = twin.initial_qpos(np.array([rest[name] for name in twin.joints]), controls[0])
    angles = roll_out([twin.model], controls[None], start[None])[0][1:, twin.qpos_adr]
    read = twin.measurement.apply(twin.joints, angles)[round(SETTLE_S / step_s) :]
    order = [twin.joints.index(name) for name in robot.joints]
    return at_samples(robot, len(targets), read[:, order], step_s)


def page(errors: Sequence[LawError]) -> str:
    """A Markdown table, a row for each law and robot."""
    rows = [
        "| law | seed | time step | does | off | share | step alone | sensors |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for e in errors:
        what = e.key if e.form.lower() in e.key.replace("_", "") else f"{e.key} ({e.form})"
        rows.append(
            f"| {what} | {e.seed} | {1e3 * e.step_s:g} ms | {e.does:.2f} | {e.off:.2f} | {e.off / e.does:.0%} | "
            f"{e.step:.2f} | {e.sensors:.2f} |"
        )
    return "\n".join(rows) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS))
    parser.add_argument("--laws", nargs="+", help="keys of the library; all of them by default")
    parser.add_argument("--page", type=Path, help="Markdown file for the table")
    given = parser.parse_args()
    silence_mujoco()
    found: list[LawError] = []
    laws = [law for forms in WRITTEN_APART for law in forms if law.key not in _LEFT_OUT]
    for law in [law for law in laws if not given.laws or law.key in given.laws]:
        for seed in given.seeds:
            try:
                found.append(law_error(law, seed))
            except Unstable as why:
                print(f"{law.key} {seed}: left out, {why}")
                continue
            print(page(found[-1:]).splitlines()[-1], flush=True)
    if given.page:
        given.page.write_text(page(found))


if __name__ == "__main__":
    main()
