"""`twin gate`: the way to the hand, in a process of its own."""

from __future__ import annotations

import contextlib
import gc
import json
import logging
import math
import os
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin_daemon.cli.options import Config, Endpoint, HandName, Model, Namespace, Seconds, VersionRef
from twin_daemon.cli.run import AUDIT, hand_folder, load_named, machine_keyring
from twin_daemon.errors import BadInput, TwinError
from twin_daemon.resources import SWITCH_S
from twin_daemon.workflows.session import silence_mujoco

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from twin_daemon.services.stop import StopSignal

log = logging.getLogger("twin.gate")

LATCH, LOCK = "stopped.json", "gate.lock"
_SOON_S = 0.02
_HANGS_S = 1.5  # the gate's thread comes round twice a second where nothing moves
_LOCK_S = 5.0  # the gate of a daemon that was killed needs so long to bring the hand to rest and end


def command(
    config: Config = None,
    hand: HandName = None,
    model: Model = None,
    version: VersionRef = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    seconds: Seconds = None,
    with_daemon: Annotated[bool, typer.Option("--with-daemon", hidden=True, help="As a child of 'twin run'.")] = False,
) -> int:
    """The gate alone: the only way to the hand, and the router that all others meet at.

    'twin run' starts one by itself; as a service it is a unit of its own, and 'twin run --gate-apart' joins it.
    """
    from twin_daemon.services.stop import on_termination

    with on_termination() as stop:
        if not with_daemon:
            return _serve(stop, config, hand, model, version, namespace, endpoint, seconds, lambda: None)
        try:
            _end_with_parent(stop)
            return _serve(stop, config, hand, model, version, namespace, endpoint, seconds, _say_ready)
        except TwinError as error:
            told = {"what": error.what, "where": error.where, "allowed": error.allowed, "todo": error.todo}
            print(json.dumps(told | {"exit_code": error.exit_code}), flush=True)
            return error.exit_code


def _say_ready() -> None:
    print(json.dumps({"ready": True}), flush=True)


def _end_with_parent(stop: StopSignal) -> None:
    """Standard input ends with whoever started this process, however that one dies."""

    def watch() -> None:
        with contextlib.suppress(OSError):
            while os.read(0, 1024):
                pass
        stop.set()

    threading.Thread(target=watch, name="twin-parent", daemon=True).start()


def _serve(
    stop: StopSignal,
    config: Path | None,
    hand: str | None,
    model: Path | None,
    version: str | None,
    namespace: str | None,
    endpoint: str | None,
    seconds: float | None,
    ready: Callable[[], None],
) -> int:
    from bridges.zenoh.access import access_of
    from bridges.zenoh.gate_link import STATUS_S, GateEnd
    from bridges.zenoh.gatekeeper import Gatekeeper
    from bridges.zenoh.hand_subscriber import HandSubscriber
    from bridges.zenoh.ros_keys import RosKeys
    from bridges.zenoh.session import choose_endpoint, open_daemon, someone_serves
    from twin_daemon.daemon.configuration import load_config
    from twin_daemon.daemon.gate_intake import GateIntake
    from twin_daemon.daemon.models import ModelSource
    from twin_daemon.daemon.notify import Notifier
    from twin_daemon.daemon.promotions import Promotions
    from twin_daemon.gate.audit import AuditLog
    from twin_daemon.gate.gate import Gate
    from twin_daemon.gate.latch import Latch
    from twin_daemon.services.register import Register

    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s gate: %(message)s")
    settings = load_config(config, os.environ).config
    chosen = load_named(hand or settings.hand, model or settings.model, namespace or settings.namespace)
    if not chosen.commands:
        raise BadInput("nothing moves this hand: it needs no gate", todo="Run 'twin run' alone")
    description = chosen.description
    address = choose_endpoint(endpoint or settings.endpoint)
    silence_mujoco()
    folder = hand_folder(description.namespace)
    keyring = machine_keyring(settings.recalibration)
    ros = RosKeys(settings.ros) if settings.ros is not None else None
    access = access_of(settings.access, address, keyring, description, folder, ros)
    source = ModelSource(chosen, version or settings.version)
    with contextlib.ExitStack() as stack:
        alone = stack.enter_context(_alone(folder, stop))
        twin, info = source.load()
        gate = Gate(twin, settings.gate.for_rate(description.rate_hz), latch=Latch(folder / LATCH))
        session, how = open_daemon(address, access, stop)
        stack.callback(session.close)
        if how == "joined" and someone_serves(session, description.key("gate", verb="serves")):
            raise BadInput(
                f"a twin of {description.namespace} is served there already",
                where=address,
                todo="Stop it first, or run this one with another --namespace or --endpoint",
            )
        if not alone:
            raise BadInput(
                f"another gate of {description.namespace} runs with this state folder",
                where=folder,
                todo="Stop it first, or set another TWIN_STATE_DIR",
            )
        link = GateEnd(session, description, keyring)
        stack.callback(link.close)
        audit = AuditLog(folder / AUDIT)
        stack.callback(audit.close)
        register = Register(audit, link.tell)

        def recalibrate(who: str) -> str | None:
            return link.recalibrate(who, gatekeeper.status())

        gatekeeper = Gatekeeper(session, gate, register, keyring, description, recalibrate, link.silent_s)
        stack.callback(gatekeeper.close)
        promotions = Promotions(source, gate.hand_model)
        stack.callback(promotions.close)
        where = f"listens at {address}" if how == "listens" else f"joined the router at {address}"
        log.info("the gate of %s %s, version %s", description.namespace, where, info["id"])
        gc.collect()
        gc.freeze()  # what is here stays: the collector need not walk through it while a turn waits
        sys.setswitchinterval(SWITCH_S)
        notifier = Notifier()
        link.tell_status(gatekeeper.status())
        ready()
        notifier.say("READY=1")
        end_s = None if seconds is None else time.monotonic() + seconds
        subscriber: HandSubscriber | None = None
        while not stop.wait(_SOON_S if subscriber is None else STATUS_S) and (
            end_s is None or time.monotonic() < end_s
        ):
            if subscriber is None and math.isfinite(link.silent_s(time.monotonic())):
                # not before the daemon hears: a recording is played as soon as somebody listens
                subscriber = HandSubscriber(session, description, GateIntake(twin, gate, link.tell), ros)
                stack.callback(subscriber.close)
            if gatekeeper.turns(within_s=_HANGS_S):
                notifier.alive()
            found = promotions.take()
            if found is not None:
                gate.use(found[0])
            link.tell_status(gatekeeper.status())
        notifier.say("STOPPING=1")
    log.info("the gate of %s has stopped", description.namespace)
    return 0


@contextlib.contextmanager
def _alone(folder: Path, stop: StopSignal) -> Iterator[bool]:
    """Whether this is the only gate of the hand with this state folder; waits for one that is about to end."""
    import fcntl

    folder.mkdir(parents=True, exist_ok=True)
    handle = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        deadline_s = time.monotonic() + _LOCK_S
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                alone = True
                break
            except OSError:
                if time.monotonic() > deadline_s or stop.wait(0.05):
                    alone = False
                    break
        yield alone
    finally:
        os.close(handle)
