"""What the commands that reach the hand share: who asks, the way to the gate, and what its replies mean."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_daemon.cli.leases import kept_lease, lease_file
from twin_daemon.cli.run import load_named
from twin_daemon.errors import Refused
from twin_daemon.resources import state_dir

if TYPE_CHECKING:
    import zenoh

    from bridges.zenoh.commander import Commander
    from twin_daemon.hand import Hand
    from twin_daemon.services.stop import Stoppable
    from twin_daemon.signals.trajectory import Trajectory

_POLL_S = 0.1
_PATIENCE_S = 5.0


@dataclass(frozen=True)
class GateConnection:
    """An open way to the gate of one hand."""

    hand: Hand
    session: zenoh.Session
    commander: Commander


@contextlib.contextmanager
def gate_connection(
    hand: str | None,
    model: Path | None,
    namespace: str | None,
    endpoint: str | None,
    name: str,
    *,
    with_lease: bool = False,
) -> Iterator[GateConnection]:
    """Connects to the daemon in the name of an identity, and with the lease of an earlier 'twin command arm' where that
    is asked for. Raises NoAnswer, and BadInput for keys that are not there."""
    from bridges.zenoh.client import connect
    from bridges.zenoh.commander import Commander
    from bridges.zenoh.session import choose_endpoint
    from twin_daemon.security.identity import keys_file, load_keyring

    chosen = load_named(hand, model, namespace)
    address = choose_endpoint(endpoint)
    path = keys_file(state_dir())
    keyring = load_keyring(path)
    with connect(address, _PATIENCE_S, name) as session:
        commander = Commander(session, chosen.description, keyring, name)
        if with_lease:
            commander.lease = kept_lease(lease_file(chosen.description.namespace, name))
        yield GateConnection(chosen, session, commander)


def accepted(answer: dict[str, Any]) -> dict[str, Any]:
    """The reply, if it is no refusal. Raises Refused."""
    if answer["accepted"]:
        return answer
    raise Refused(str(answer["why"]), allowed=answer["allowed"], todo=f"So {answer['consequence']}")


def body_of(plan: Trajectory) -> dict[str, Any]:
    """A trajectory as a request carries it."""
    return {
        "name": plan.name,
        "joints": list(plan.joints),
        "times_s": plan.times_s.tolist(),
        "positions": plan.positions.tolist(),
    }


def follow_motion(
    connection: GateConnection,
    answer: dict[str, Any],
    stop: Stoppable,
    turn: Callable[[float], None] = time.sleep,
    report: Callable[[float, float], None] = lambda _done, _of: None,
) -> dict[str, Any]:
    """Stays until an accepted motion has ended, and keeps saying that somebody is there; the last status.

    `turn` passes the time between two looks. When `stop` is set the motion is ended. Raises Refused where the gate
    ended the motion before its end.
    """
    from twin_daemon.services.guard import Guard

    guard = Guard(logging.getLogger("twin.command"))
    status = answer["gate"]
    with connection.commander.beating(guard):
        while status["moving"]:
            if stop.is_set():
                connection.commander.ask("disarm")
                raise Refused(
                    "interrupted: the motion has been ended", todo="The hand holds where it is; it is disarmed"
                )
            turn(_POLL_S)
            status = connection.commander.status()
            if status["duration_s"] is not None:
                report(status["elapsed_s"], status["duration_s"])
    if status["ended"] != "done":
        raise Refused(
            f"the motion has been ended: {status['ended']}", todo="The hand holds where it is; it is disarmed"
        )
    return status
