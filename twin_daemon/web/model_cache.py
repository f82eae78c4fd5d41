"""What has been opened, kept for the next question: twins of versions, recordings, and what a twin predicts of one."""

from __future__ import annotations

import contextlib
import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from twin_daemon.comparison.compare import Comparison, compare_recording, shifted
from twin_daemon.errors import BadInput
from twin_daemon.hand import Hand
from twin_daemon.recordings import load_joint_map, load_offered
from twin_daemon.recordings.rosbag2 import message_types
from twin_daemon.signals.trajectory import load_trajectory
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import VersionStore

_BELOW_THE_DAEMON = 10  # nice
_MOST_RECORDINGS = 3
_MOST_COMPARISONS = 8  # three versions and three candidates of what is open, and two of another recording
_MOST_TWINS = 8
Value = TypeVar("Value")


class ModelCache:
    """Each thing is made once, however many ask; the oldest leave. One roll-out at a time, at low priority."""

    def __init__(self, hand: Hand, store: VersionStore, trajectory: str | None = None, joint_map: Path | None = None):
        self.hand = hand
        self.store = store
        self._trajectory = load_trajectory(trajectory, hand) if trajectory else None
        self._names = load_joint_map(joint_map) if joint_map else None
        self.nominal = TwinModel.load(hand)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="twin-workbench-roll-out", initializer=_step_back)
        self._worker.submit(message_types)  # the first bag would wait for them
        self._lock = threading.Lock()
        self._recordings: OrderedDict[Hashable, Future[Aligned]] = OrderedDict()
        self._comparisons: OrderedDict[Hashable, Future[Comparison]] = OrderedDict()
        self._lagging: OrderedDict[Hashable, Future[Comparison]] = OrderedDict()
        self._moving: OrderedDict[Hashable, Future[np.ndarray]] = OrderedDict()
        self._twins: OrderedDict[Hashable, Future[TwinModel]] = OrderedDict()

    def version_id(self, reference: str) -> str:
        """The id behind a name. Raises BadInput for one that is not there."""
        return self.store.resolve(reference).id

    def twin(self, version_id: str) -> TwinModel:
        """The twin of a version's id. Raises BadInput."""
        return self._once(self._twins, version_id, lambda: self._built(version_id), _MOST_TWINS)

    def recording(self, path: Path) -> Aligned:
        """A recording with its commands. Raises BadInput, again at every question until the file is another one."""
        return self._once(self._recordings, _state_of(path), lambda: self._read(path), _MOST_RECORDINGS)

    def moving(self, path: Path) -> np.ndarray:
        """(j,) bool: the joints that move in a recording. Raises BadInput."""
        return self._once(self._moving, _state_of(path), lambda: self.recording(path).moving, _MOST_RECORDINGS)

    def comparison(
        self,
        path: Path,
        version_id: str,
        onset_s: float | None = None,
        changed: TwinModel | None = None,
        lag_s: float = 0.0,
    ) -> Comparison | None:
        """The recording against the twin of a version; None while that is being computed. Raises BadInput.

        `onset_s` is when the commands begin, where somebody knows better than the estimate; `changed` is the twin of
        the version with something more. With `lag_s` what is predicted is moved to later times.
        """
        key = (*_state_of(path), version_id, onset_s, changed and changed.terms.model_dump_json())

        def compared() -> Comparison:
            aligned = self.recording(path)
            if onset_s is not None and aligned.onset_free:
                aligned = replace(aligned, onset_s=onset_s, onset_free=False)
            return compare_recording(changed or self.twin(version_id), aligned)

        with self._lock:
            future = self._comparisons.get(key)
            if future is None:
                future = self._worker.submit(compared)
                self._keep(self._comparisons, key, future, _MOST_COMPARISONS)
            self._comparisons.move_to_end(key)
        if not future.done():
            return None
        found = future.result()
        if not lag_s:
            return found
        return self._once(self._lagging, (*key, lag_s), lambda: shifted(found, lag_s), _MOST_COMPARISONS)

    def screen(self, path: Path, sha256: str) -> Aligned:
        """A recording that is not offered yet, read as any of a stranger; `sha256` is of its bytes. Raises BadInput
        where it is none of this hand's."""
        return self._read(path, sha256)

    def adopt(self, aligned: Aligned, path: Path, told: os.stat_result) -> None:
        """Takes what was screened for the recording at `path`, to which the same file was linked: it is not read
        twice. `told` is of the file that was read; whatever else is found there is read anew."""
        future: Future[Aligned] = Future()
        future.set_result(replace(aligned, recording=aligned.recording.linked(path)))
        with self._lock:
            self._keep(self._recordings, _state(path, told), future, _MOST_RECORDINGS)

    def warm(self, path: Path) -> None:
        """Reads a recording before anybody asks for it."""

        def read() -> None:
            with contextlib.suppress(BadInput):  # it is said to whoever opens it
                self.moving(path)

        self._worker.submit(read)

    def close(self) -> None:
        """Nothing more is computed; what computes now hears of nothing, and nobody waits for it."""
        self._worker.shutdown(wait=False, cancel_futures=True)

    def _built(self, version_id: str) -> TwinModel:
        return self.nominal.changed(Terms.model_validate(self.store.get(version_id).terms))

    def _read(self, path: Path, sha256: str | None = None) -> Aligned:
        recording = load_offered(path, self._names, sha256)
        return align(self.nominal, recording, self._trajectory if recording.commands is None else None)

    def _once(
        self, kept: OrderedDict[Hashable, Future[Any]], key: Hashable, make: Callable[[], Value], most: int
    ) -> Value:
        with self._lock:
            future: Future[Value] | None = kept.get(key)
            mine = future is None
            if future is None:
                future = Future()
                self._keep(kept, key, future, most)
            kept.move_to_end(key)
        if mine:
            try:
                future.set_result(make())
            except BaseException as error:
                with self._lock:
                    kept.pop(key, None)
                future.set_exception(error)
        return future.result()

    @staticmethod
    def _keep(kept: OrderedDict[Hashable, Future[Any]], key: Hashable, future: Future[Any], most: int) -> None:
        kept[key] = future
        for old in list(kept)[:-most]:
            if kept[old].done():
                del kept[old]


def _state_of(path: Path) -> tuple[str, int, int]:
    try:
        told = path.lstat()
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", where=path) from None
    return _state(path, told)


def _state(path: Path, told: os.stat_result) -> tuple[str, int, int]:
    return str(path), told.st_size, told.st_mtime_ns


def _step_back() -> None:
    """Linux gives each thread a priority of its own: the live stream of this process keeps its."""
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _BELOW_THE_DAEMON)
