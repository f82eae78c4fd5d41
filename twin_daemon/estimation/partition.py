"""What one part of a hand is judged by: the smallest model that moves it, and the motion in which it is on its own."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin_daemon.estimation.floor import floor_variance
from twin_daemon.estimation.start_errors import with_start_errors
from twin_daemon.estimation.thresholds import (
    CONTACT_EVERY_S,
    CONTACT_MARGIN_M,
    LEAST_CLEAR_S,
    LEFT_OUT_FLOORS,
    MOST_LINK_COMBINATIONS,
    MOST_PART_S,
)
from twin_daemon.estimation.windows import length_s, noise_travel, segments, spread
from twin_daemon.executor import concurrently_here
from twin_daemon.simulation.alignment import MOVING_RAD, Aligned, moving_joints
from twin_daemon.simulation.contacts import touching_times
from twin_daemon.simulation.link_masses import LinkPaths
from twin_daemon.simulation.prescribed import Motion, Needed, measured_motion, reaction
from twin_daemon.simulation.reactions import LinkLoads, Reaction
from twin_daemon.simulation.submodel import Part, parts, submodel, with_coupled
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Reduced:
    """One part: its own joints that are judged, its sub-model, and the pieces of both sets of recordings."""

    name: str
    joints: tuple[str, ...]
    twin: TwinModel
    train: tuple[Aligned, ...]
    holdout: tuple[Aligned, ...]

    def with_start_errors(self) -> Reduced:
        """The same with what the uncertain starts of its pieces do to it."""
        train, holdout = (with_start_errors(self.twin, pieces, self.joints) for pieces in (self.train, self.holdout))
        return replace(self, train=tuple(train), holdout=tuple(holdout))


class Reduction:
    """Cuts recordings to parts. When what touches what is looked up once, whatever terms the twin gets later."""

    def __init__(
        self, twin: TwinModel, train: Sequence[Aligned], holdout: Sequence[Aligned], *, bodies: bool = False
    ) -> None:
        """With `bodies` each body of a part keeps its own mass: for who changes it."""
        self._train, self._holdout = train, holdout
        self._bodies = bodies
        self._branches = parts(twin)
        both = (_touching(twin, self._branches, r) for r in (*train, *holdout))
        self._touching, self._touching_for_sure = zip(*both, strict=True)
        self._motions: list[Motion] | None = None
        self._whole: list[Needed] = []
        self._paths: list[LinkPaths] | None = None
        self._loads: dict[tuple[str, ...], list[LinkLoads]] = {}
        seen = np.concatenate([_poses(twin, r) for r in train])
        known = np.isfinite(seen).any(axis=0)
        # what is left out is welded where it mostly is
        self._usual = np.where(known, np.nanmedian(np.where(known, seen, 0.0), axis=0), train[0].start_position)
        self.moving = moving_joints(train)
        self._least = [noise_travel(r) for r in (*train, *holdout)]
        self._stirring = np.any([_stirring(r, w) for r, w in zip((*train, *holdout), self._least, strict=True)], axis=0)

    def of(
        self,
        twin: TwinModel,
        part: Part,
        joints: Sequence[str],
        *,
        least_s: float = LEAST_CLEAR_S,
        like: Reduced | None = None,
        start_errors: bool = True,
    ) -> Reduced | None:
        """The part with its moving trunk, over the motion in which it touches nothing; None where that is too short.

        What uncertain starts do is taken from one cut `like` it, whose twin only has other values, where one is given.
        Without `start_errors` it is left out, for who asks first whether anything is left at all.

        What the joints outside do to it while they move comes as torques along the measured motion.

        What a contact does hangs on surfaces and shapes that no model of a hand has right, so that it says little
        about the part.
        """
        small = submodel(twin, self._with_trunk(twin, part, joints), self._usual, bodies=self._bodies)
        recordings = (*self._train, *self._holdout)
        outside = self._stir_outside(twin, small.joints)
        if outside and self._motions is None:
            self._smoothed(twin)
        cuts: list[Aligned] = []
        for index, recording in enumerate(recordings):
            cut = restricted(recording, small)
            if outside and self._motions is not None:
                cut = replace(cut, reaction=reaction(self._needed(twin)[index], small))
            cuts.append(cut)
        if self._paths is not None:
            cuts = self._with_links(twin, cuts, joints, small)
        touched = [self._touched(masks, joints) for masks in self._touching]
        kept = [recordings[0].joints.index(name) for name in small.joints]
        each = zip(cuts, self._least, touched, strict=True)
        pieces = [segments(cut, joints, when, least[kept]) for cut, least, when in each]
        count = len(self._train)
        train = spread([p for found in pieces[:count] for p in found], MOST_PART_S)
        holdout = spread([p for found in pieces[count:] for p in found], MOST_PART_S)
        enough_held = not self._holdout or length_s(holdout) > 0.5 * least_s
        clear = length_s(train) > least_s and enough_held
        if not clear:
            return None
        reduced = Reduced(part.name, tuple(joints), small, tuple(train), tuple(holdout))
        if like is not None:
            known = (tuple(map(_as_uncertain, *cut)) for cut in ((train, like.train), (holdout, like.holdout)))
            return replace(reduced, train=next(known), holdout=next(known))
        return reduced.with_start_errors() if start_errors else reduced

    def each(self, twin: TwinModel, groups: Sequence[tuple[Part, Sequence[str]]]) -> list[Reduced | None]:
        """Some parts of a twin, as `of` cuts them."""
        moves = any(self._stir_outside(twin, self._with_trunk(twin, *group)) for group in groups)
        if moves and self._motions is None:
            self._smoothed(twin)  # once, for all processes
        return concurrently_here(lambda group: self.of(twin, *group), groups)

    def _with_trunk(self, twin: TwinModel, part: Part, joints: Sequence[str]) -> tuple[str, ...]:
        return with_coupled(twin, {*joints, *(set(self.moving) & set(part.trunk))})

    def _stir_outside(self, twin: TwinModel, joints: Sequence[str]) -> bool:
        """Whether any joint but these moves."""
        return bool((self._stirring & ~np.isin(twin.joints, joints)).any())

    def together(self, twin: TwinModel, groups: Sequence[Reduced], *, start_errors: bool = True) -> Reduced | None:
        """Groups as one part of a twin, which may be another than they were cut from."""
        own = {joint for group in groups for joint in group.joints}
        joints = tuple(joint for joint in twin.joints if joint in own)
        return self.of(twin, Part(groups[0].name, joints, ()), joints, start_errors=start_errors)

    def anew(self, twin: TwinModel, group: Reduced) -> Reduced | None:
        """One group of a twin that only has other values than the one that it was cut from."""
        return self.of(twin, Part(group.name, group.joints, ()), group.joints, like=group)

    def following(self, twin: TwinModel) -> Reduction:
        """The same with the measured motion smoothed by a twin that follows it better."""
        other = copy.copy(self)
        other._motions, other._whole, other._paths = None, [], None
        if self._motions is not None:
            other._smoothed(twin)
        return other if self._paths is None else other.with_link_masses(twin)

    def with_link_masses(self, twin: TwinModel) -> Reduction:
        """The same with what uncertain masses of links do to a part: as torques by sigma, in its recordings."""
        if self._paths is not None:
            return self
        other = copy.copy(self)
        if other._motions is None:
            other._smoothed(twin)
        other._paths, other._loads = [LinkPaths.along(twin, motion) for motion in other._motions or ()], {}
        return other

    def delayed(self, known: Mapping[str, tuple[float, float]]) -> Reduction:
        """The same where the commands of a recording, by its sha256, take effect so much later (s), with a sigma (s).

        Those of other recordings come later by as much on average, and are known no better than before.
        """
        other = copy.copy(self)
        mean_s = float(np.mean([delay_s for delay_s, _ in known.values()])) if known else 0.0

        def later(recording: Aligned) -> Aligned:
            delay_s, sigma_s = known.get(recording.recording.sha256, (mean_s, recording.onset_sigma_s))
            return replace(recording, onset_s=recording.onset_s + delay_s, onset_sigma_s=sigma_s)

        other._train, other._holdout = ([later(r) for r in some] for some in (self._train, self._holdout))
        return other

    @property
    def carries(self) -> bool:
        """Whether any part that was cut feels joints outside it that move."""
        return self._motions is not None

    def _with_links(
        self, twin: TwinModel, cuts: Sequence[Aligned], joints: Sequence[str], small: TwinModel
    ) -> list[Aligned]:
        if tuple(joints) not in self._loads:  # the same whatever effect the twin gets later
            share = twin.hand.description.nominal_uncertainty.mass
            torques = [paths.torques(joints, share) for paths in self._paths or ()]
            floor = floor_variance(cuts[: len(self._train)], joints)
            least = np.array([small.scale(joint).kp for joint in joints]) * np.sqrt(floor)
            chosen = combinations(torques, np.maximum(least, 1e-12))
            pairs = zip(self._paths or (), torques, strict=True)
            self._loads[tuple(joints)] = [LinkLoads(p.time_s, tuple(joints), t @ chosen) for p, t in pairs]
        loads = self._loads[tuple(joints)]
        if not loads[0].torque.size:
            return list(cuts)
        both = zip(cuts, loads, strict=True)
        return [replace(cut, reaction=replace(cut.reaction or Reaction(None), links=load)) for cut, load in both]

    def _smoothed(self, twin: TwinModel) -> Reduction:
        """The same with the measured motion and what the whole needs for it, for all parts."""

        def needed(recording: Aligned) -> Needed:
            return Needed(twin, measured_motion(twin, recording, self._stirring)).computed()

        self._whole = concurrently_here(needed, (*self._train, *self._holdout))
        self._motions = [one.motion for one in self._whole]
        return self

    def _needed(self, twin: TwinModel) -> list[Needed]:
        """What the whole twin needs to move as in each recording; kept for the twin that was asked for last."""
        whole = self._whole  # threads ask for different twins
        if not whole or whole[0].twin is not twin:
            whole = self._whole = [Needed(twin, motion) for motion in self._motions or ()]
        return whole

    def where_near(self) -> Reduction:
        """The same with the motion in which a part only comes near something, and touches nothing."""
        other = copy.copy(self)
        other._touching = self._touching_for_sure
        return other

    def share_touching(self, joints: Sequence[str]) -> float:
        """The share of the fitted motion that is left out, as branches with some of the joints touch something."""
        found = [self._touched(masks, joints) for masks in self._touching[: len(self._train)]]
        masks = [mask for mask in found if mask is not None]
        return float(np.concatenate(masks).mean()) if masks else 0.0

    def clear_s(self, joints: Sequence[str]) -> float:
        """How long (s) the fitted motion is that is not left out."""
        return (1.0 - self.share_touching(joints)) * sum(float(np.ptp(r.time_s)) for r in self._train)

    def _touched(self, masks: Mapping[str, np.ndarray], joints: Sequence[str]) -> np.ndarray | None:
        """(n,) bool: when any branch that has some of the joints touches something."""
        found = [masks[b.name] for b in self._branches if b.name in masks and set(joints) & set(b.joints)]
        return np.any(found, axis=0) if found else None


def combinations(torques: Sequence[np.ndarray], least: np.ndarray) -> np.ndarray:
    """(p, q) the combinations of p parameters that show, from their torques (m, k, p) a recording.

    Many masses give nearly the same torque: the principal components of what they do to a servo are kept.

    `least` (k,) N m is a joint's torque that bends its servo by one standard deviation of its floor.
    """
    seen = [torque / least[None, :, None] for torque in torques]
    count = sum(len(one) for one in seen)
    power = sum(np.einsum("mkp,mkq->pq", one, one) for one in seen) / max(count, 1)
    sizes, ways = np.linalg.eigh(power)
    left = np.cumsum(sizes)  # ascending: what is left out if all up to here are
    first = int(np.searchsorted(left, LEFT_OUT_FLOORS, side="right"))
    return ways[:, max(first, ways.shape[1] - MOST_LINK_COMBINATIONS) :][:, ::-1]


def restricted(aligned: Aligned, small: TwinModel) -> Aligned:
    """The same recording with only the joints that a part has, and the commands that reach it."""
    columns = [aligned.joints.index(name) for name in small.joints]
    mapping, _ = small.command_map(aligned.signal.names)
    reaching = np.flatnonzero(mapping.any(axis=0))
    return replace(
        aligned,
        joints=small.joints,
        signal=aligned.signal.only(reaching) if reaching.size else aligned.signal,
        measured=aligned.measured[:, columns],
        unhidden=None if aligned.unhidden is None else aligned.unhidden[:, columns],
        start_position=aligned.start_position[columns],
        start_velocity=aligned.start_velocity[columns],
        start_sigma=None if aligned.start_sigma is None else aligned.start_sigma[:, columns],
    )


def _as_uncertain(piece: Aligned, like: Aligned) -> Aligned:
    return replace(piece, start_response=like.start_response)


def _stirring(recording: Aligned, least: np.ndarray) -> np.ndarray:
    """(j,) bool: the joints that move by more than their noise; a soft one that is held gives way to its neighbours.

    `least` (j,) is what `noise_travel` says of the recording.
    """
    return recording.travel > np.minimum(least, MOVING_RAD)


def _poses(twin: TwinModel, recording: Aligned) -> np.ndarray:
    return twin.measurement.invert(twin.joints, recording.states)


def _touching(
    twin: TwinModel, found: Sequence[Part], recording: Aligned
) -> tuple[Mapping[str, np.ndarray], Mapping[str, np.ndarray]]:
    """(n,) bool by part: when it is near something, and when it touches something.

    The trunk is left out: what its branches do to each other does not move it.
    """
    stride = max(1, round(CONTACT_EVERY_S / float(np.median(np.diff(recording.time_s)))))
    masks = touching_times(twin, found, _poses(twin, recording)[::stride], CONTACT_MARGIN_M)
    count = len(recording.time_s)
    branches = [name for name in masks if name != "trunk"]
    near, touched = ({name: np.repeat(masks[name][i], stride)[:count] for name in branches} for i in range(2))
    return near, touched
