"""The next experiment: of a small family of motions, the one that tells the candidates apart best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from twin_daemon.diagnosis.refit import refit_effect
from twin_daemon.diagnosis.thresholds import (
    EXPERIMENT_RATE_HZ,
    FASTEST_RAD_S,
    FEW_COMMANDS,
    MOST_RIVALS,
    RANGE_MARGIN,
    SETTLE_S,
    SPEED_SHARE,
    TELLING,
    WIDEST_RAD,
)
from twin_daemon.diagnosis.verdict import Diagnosis, Experiment, Finding
from twin_daemon.effects import LIBRARY
from twin_daemon.errors import BadInput
from twin_daemon.estimation.floor import floor_variance
from twin_daemon.executor import concurrently
from twin_daemon.hand.description import Hand
from twin_daemon.places import ROBOT
from twin_daemon.signals.commands import CommandSignal
from twin_daemon.signals.trajectory import Trajectory, allowed_range, load_trajectory, save_trajectory
from twin_daemon.simulation.alignment import Aligned, resample
from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

Waypoints = list[tuple[float, float]]
"""(share of the range, seconds to get there), from the share at which the motion starts."""


def steps() -> Waypoints:
    """Large and small steps, each held until all is at rest."""
    moves = (0.6, 0.2, 0.8, 0.7, 0.4, 0.5, 0.1, 0.9, 0.3)
    return [point for share in moves for point in ((share, 0.0), (share, 0.7))]


def two_speeds() -> Waypoints:
    """The same way there and back, slowly and fast."""
    return [(0.9, 4.0), (0.9, 0.4), (0.1, 4.0), (0.1, 0.4), (0.9, 0.6), (0.9, 0.4), (0.1, 0.6), (0.1, 0.4)]


def small_reversals() -> Waypoints:
    """There and back by little, slowly, at three angles that are reached from either side."""
    points: Waypoints = []
    for middle in (0.3, 0.8, 0.5):
        points += [(middle, 0.6), (middle, 0.4)]
        for size in (0.04, 0.08):
            points += [(middle + size, 0.5), (middle - size, 0.8), (middle, 0.5)]
    return points


def holds() -> Waypoints:
    """Five angles, each reached from below and from above, and held."""
    way = (0.1, 0.3, 0.5, 0.7, 0.95, 0.7, 0.5, 0.3, 0.1)
    return [point for share in way for point in ((share, 0.5), (share, 0.8))]


def everything() -> Waypoints:
    """A little of all of them, where it is not known what to look for."""
    return [*steps()[:8], *two_speeds()[:6], *small_reversals()[:8], *holds()[4:12]]


def a_little() -> Waypoints:
    """The same in a few seconds, where a whole hand has to be gone through."""
    return [*steps()[:4], (0.9, 1.5), (0.2, 0.4), *small_reversals()[:5]]


FAMILY: dict[str, Callable[[], Waypoints]] = {
    "steps": steps,
    "two speeds": two_speeds,
    "small reversals": small_reversals,
    "holds": holds,
    "everything": everything,
}


def next_experiment(
    twin: TwinModel,
    train: Sequence[Aligned],
    found: Diagnosis,
    folder: Path,
    joints: Sequence[str] | None = None,
) -> Experiment | None:
    """The trajectory that would settle an ambiguous verdict, or show something where nothing was excited.

    Written into `folder` and read back, so that it is known to run. None for the other verdicts.
    """
    if found.verdict == "not_excited":
        return _general(twin.hand, _commands(twin, joints or twin.joints), folder)
    doubtful = next((f for f in found.findings if f.confusable_with), None)
    if found.verdict != "ambiguous" or doubtful is None:
        return None
    return _separating(twin, train, found, doubtful, folder)


def _separating(
    twin: TwinModel, train: Sequence[Aligned], found: Diagnosis, doubtful: Finding, folder: Path
) -> Experiment | None:
    base = twin.terms
    for other in found.findings:
        if other is not doubtful:
            base = base.with_effect(other.term)
    fitted = {f"{term.effect}:{term.target}": term for term in doubtful.rivals}
    candidates = {doubtful.name: base.with_effect(doubtful.term)}
    for name in doubtful.confusable_with[:MOST_RIVALS]:
        term = fitted.get(name) or _refitted(twin.changed(base), train, name)
        if term is not None:
            candidates[name] = base.with_effect(term)
    commands = _commands(twin, doubtful.joints)
    if doubtful.target == ROBOT:
        commands = commands[:FEW_COMMANDS]  # what all servos have alike shows at a few of them
    if len(candidates) < 2 or not commands:
        return None
    motions = {name: motion(twin.hand, commands, make(), name) for name, make in FAMILY.items()}
    moved = {joint for command in commands for joint in twin.joints_of(command)}
    measured = [name for name in doubtful.joints if name in moved]  # a pair's command stands among them
    apart = concurrently(lambda m: expected_difference(twin, candidates, m, measured), motions.values())
    differences = dict(zip(motions, apart, strict=True))
    best = max(differences, key=lambda name: differences[name])
    title = f"{doubtful.effect}_or_{'_or_'.join(n.partition(':')[0] for n in list(candidates)[1:])}"
    path, reference = _written(motions[best], f"{title}_at_{doubtful.target}", folder, twin.hand)
    noise_rad = float(np.sqrt(floor_variance(train, measured or [train[0].joints[0]]).mean()))
    over = differences[best] / noise_rad
    return Experiment(
        path=str(path),
        trajectory=reference,
        expected_difference_rad=differences[best],
        separates=tuple(candidates),
        motion=best,
        considered=differences,
        why=f"{best} on {', '.join(commands)}: there the candidates' predictions differ by "
        f"{1e3 * differences[best]:.1f} mrad rms, {over:.0f} times what a right model leaves"
        + ("" if over > TELLING else "; that is little, so a known load or another pose may be needed"),
    )


def _refitted(twin: TwinModel, train: Sequence[Aligned], name: str) -> EffectTerm | None:
    """What may be there instead, fitted to the recordings; None where it cannot act."""
    key, _, target = name.partition(":")
    try:
        return refit_effect(twin, train, LIBRARY[key], [target], {}).terms[0]
    except BadInput:
        return None


def _general(hand: Hand, commands: Sequence[str], folder: Path) -> Experiment | None:
    if not commands:
        return None
    name = "rich_" + (commands[0] if len(commands) == 1 else "motion")
    waypoints = everything() if len(commands) <= FEW_COMMANDS else a_little()
    path, reference = _written(motion(hand, commands, waypoints, name), name, folder, hand)
    return Experiment(
        path=str(path),
        trajectory=reference,
        expected_difference_rad=None,
        separates=(),
        motion="everything",
        why=f"steps, two speeds, small reversals and holds on {', '.join(commands[:FEW_COMMANDS])}"
        + (f" and {len(commands) - FEW_COMMANDS} more, one after another" if len(commands) > FEW_COMMANDS else ""),
    )


def _commands(twin: TwinModel, joints: Sequence[str]) -> list[str]:
    """The commands that move these joints and that the hand knows."""
    wanted = {joint for name in joints for joint in twin.joints_of(name)}
    return [n for n in twin.actuators if n in twin.hand.description.commands and wanted & set(twin.joints_of(n))]


def motion(hand: Hand, commands: Sequence[str], waypoints: Waypoints, name: str) -> Trajectory:
    """The waypoints on each command in turn, inside its range and below its velocity limit; the others hold."""
    ranges = [_range(hand, command) for command in commands]
    here = np.array([low + 0.1 * (high - low) for low, high in ranges])
    times, poses = [0.0, 0.5], [here.copy(), here.copy()]
    for column, (command, (low, high)) in enumerate(zip(commands, ranges, strict=True)):
        slowest = 1.0 / (SPEED_SHARE * min(hand.velocity_limit_rad_s(command), FASTEST_RAD_S))
        for share, seconds in [*waypoints, (0.1, 0.6)]:
            target = low + min(max(share, 0.0), 1.0) * (high - low)
            duration = max(seconds, abs(target - here[column]) * slowest, 1.0 / EXPERIMENT_RATE_HZ)
            here[column] = target
            times.append(times[-1] + duration)
            poses.append(here.copy())
    times.append(times[-1] + 0.5)
    poses.append(here.copy())
    return Trajectory(name.replace(" ", "_"), tuple(commands), np.array(times), np.stack(poses))


def _range(hand: Hand, command: str) -> tuple[float, float]:
    """The range of a command with a margin, at most 2 rad about its middle."""
    low, high = allowed_range(command, hand)
    low, high = max(low, -np.pi), min(high, 2.0 * np.pi)
    middle, half = (low + high) / 2.0, min((high - low) / 2.0, WIDEST_RAD / 2.0) * (1.0 - 2.0 * RANGE_MARGIN)
    return middle - half, middle + half


def expected_difference(
    twin: TwinModel, candidates: dict[str, Terms], trajectory: Trajectory, joints: Sequence[str]
) -> float:
    """The rms difference (rad) of the two candidates that are closest, on the joint where they differ most."""
    read = [predicted(twin.changed(terms), trajectory, joints) for terms in candidates.values()]
    apart = [np.sqrt(np.mean((a - b) ** 2, axis=0)).max() for a, b in combinations(read, 2)]
    return float(np.nan_to_num(min(apart), nan=0.0))


def predicted(twin: TwinModel, trajectory: Trajectory, joints: Sequence[str]) -> np.ndarray:
    """Readings (n, k) of some joints under a trajectory that starts from rest, at 125 Hz."""
    signal = CommandSignal.from_trajectory(trajectory)
    step_s = float(twin.model.opt.timestep)
    grid = np.arange(int(np.ceil((trajectory.duration_s + SETTLE_S) / step_s)) + 1) * step_s
    home = twin.model.qpos0[twin.qpos_adr]
    controls = twin.controls(signal.names, signal.sample(grid - SETTLE_S), twin.drive @ home)
    start = np.linalg.pinv(twin.drive) @ controls[0]
    driven = np.any(twin.drive, axis=0)
    qpos = twin.initial_qpos(np.where(driven, start, home), controls[0])
    positions = roll_out([twin.model], controls[None], qpos[None])
    time_s = SETTLE_S + np.arange(int(trajectory.duration_s * EXPERIMENT_RATE_HZ)) / EXPERIMENT_RATE_HZ
    read = twin.measurement.apply(twin.joints, resample(positions[:, :, twin.qpos_adr], step_s, time_s)[0])
    return read[:, [twin.joints.index(joint) for joint in joints]]


def _written(trajectory: Trajectory, name: str, folder: Path, hand: Hand) -> tuple[Path, str]:
    """The trajectory in a file of its own, read back as the commands will read it."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.yaml"
    named = Trajectory(name, trajectory.joints, trajectory.times_s, trajectory.positions)
    save_trajectory(path, named)
    reference = f"{path}:{name}"
    load_trajectory(reference, hand)
    return path, reference
