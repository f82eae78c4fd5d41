"""A calibration run: the hand driven along a trajectory through the gate, and all of it recorded."""

from __future__ import annotations

import contextlib
import time
from datetime import UTC, datetime
from pathlib import Path

from twin_daemon.cli.commanding import accepted, body_of, follow_motion, gate_connection
from twin_daemon.cli.console import people, plain_text
from twin_daemon.errors import NoAnswer, Refused, TwinError
from twin_daemon.resources import state_dir
from twin_daemon.workflows.progress import progress_console

_LISTEN_S = 5.0
_AFTER_S = 0.5
_SPARE_S = 30.0


def drive(
    reference: str, hand: str | None, model: Path | None, namespace: str | None, endpoint: str | None, name: str
) -> Path:
    """Rehearses, arms, drives, records and disarms; the recording of it.

    Raises Refused where the gate refuses or ends it; the hand then rests, and what was recorded is kept.
    """
    from bridges.zenoh.listening import listening
    from twin_daemon.services.recorder import Recorder
    from twin_daemon.services.stop import on_termination
    from twin_daemon.signals.trajectory import load_trajectory

    console = people("-")
    with on_termination() as stop, gate_connection(hand, model, namespace, endpoint, name) as connection:
        plan = load_trajectory(reference, connection.hand).by_command(connection.hand)
        body, ask = body_of(plan), connection.commander.ask
        tried = accepted(ask("trajectory", **body, dry_run=True))["rehearsal"]
        console.print(f"rehearsed on the twin: {tried['duration_s']:.1f} s, hand clear of itself")
        folder = state_dir() / "recordings"
        folder.mkdir(parents=True, exist_ok=True)
        path = (
            folder
            / f"run-{connection.hand.description.namespace.replace('/', '-')}-{datetime.now(UTC):%Y%m%dT%H%M%S}Z.mcap"
        )
        ended: TwinError | None = None
        with Recorder(listening(connection.session), connection.hand.description, path) as recorder:
            began_s = time.monotonic()
            while not recorder.done.messages["joint_states"]:
                if time.monotonic() > began_s + _LISTEN_S or stop.is_set():
                    raise NoAnswer("the hand is silent", todo="Is it running? Nothing has been moved")
                recorder.work(0.1, stop)
            accepted(ask("arm", reason=f"calibration run {plan.name}", lease_s=tried["duration_s"] + _SPARE_S))
            try:
                answer = accepted(ask("trajectory", **body))
                with progress_console().status("driving") as line:
                    follow_motion(
                        connection,
                        answer,
                        stop,
                        turn=lambda seconds: recorder.work(seconds, stop),
                        report=lambda at, of: line.update(f"driving {plan.name}: {at:.1f} of {of:.1f} s"),
                    )
                recorder.work(_AFTER_S, stop)
            except (Refused, NoAnswer) as error:
                ended = error
            with contextlib.suppress(NoAnswer):
                ask("disarm")
    if ended is not None:
        raise type(ended)(f"{ended.what}; what was recorded is kept in {path}", todo=ended.todo)
    console.print(plain_text(f"recorded {path}"), soft_wrap=True)
    return path
