"""`twin run`: the daemon."""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import re
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin_daemon.cli.options import HandName, Model, Seconds, VersionRef
from twin_daemon.errors import BadInput, UsageError
from twin_daemon.resources import state_dir
from twin_daemon.workflows.session import silence_mujoco

if TYPE_CHECKING:
    from collections.abc import Callable

    from twin_daemon.daemon.promotions import Promotions
    from twin_daemon.daemon.service import TwinService
    from twin_daemon.daemon.settings import DaemonSettings
    from twin_daemon.hand import Hand
    from twin_daemon.recalibration.settings import RecalibrationSettings
    from twin_daemon.security.identity import Keyring
    from twin_daemon.services.diagnoser import Diagnoser
    from twin_daemon.services.recalibrator import Recalibrator

log = logging.getLogger("twin")

Endpoint = Annotated[
    str | None,
    typer.Option("--endpoint", metavar="ENDPOINT", help="Zenoh endpoint; default TWIN_ENDPOINT or tcp/127.0.0.1:7447."),
]
Namespace = Annotated[
    str | None, typer.Option("--namespace", metavar="NS", help="First part of the keys; default the hand's name.")
]
_POLL_S = 1.0
SWITCH_S = 1e-4
_GATE_S = 20.0  # a gate that is a unit of its own may start later
AUDIT = "audit.jsonl"


def command(
    config: Annotated[Path | None, typer.Option("--config", "-c", metavar="twin.yaml", help="Configuration.")] = None,
    hand: HandName = None,
    model: Model = None,
    version: VersionRef = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    seconds: Seconds = None,
    gate_apart: Annotated[
        bool, typer.Option("--gate-apart", help="Join a 'twin gate' that runs already, and start none.")
    ] = False,
) -> int:
    """Run the live twin: follow the hand, predict it, measure the error, answer questions. Ends on SIGTERM."""
    from bridges.zenoh.access import access_of, daemon_login, require_fitting
    from bridges.zenoh.announcer import Announcer
    from bridges.zenoh.bridge import ZenohBridge
    from bridges.zenoh.gate_link import DaemonEnd
    from bridges.zenoh.keep_question import KeepQuestion
    from bridges.zenoh.ros_keys import RosKeys
    from bridges.zenoh.session import choose_endpoint, open_at_gate, open_daemon, someone_serves
    from twin_daemon.cli.reload import Reloader
    from twin_daemon.daemon.configuration import load_config
    from twin_daemon.daemon.models import ModelSource
    from twin_daemon.daemon.notify import Notifier
    from twin_daemon.daemon.promotions import Promotions
    from twin_daemon.daemon.service import TwinService
    from twin_daemon.services.diagnoser import Diagnoser
    from twin_daemon.services.gate_process import GateProcess
    from twin_daemon.services.recalibrator import Recalibrator
    from twin_daemon.services.ring import Ring
    from twin_daemon.services.ring_saver import RingSaver
    from twin_daemon.services.stop import Hangup, on_termination

    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    settings = load_config(config, os.environ).config
    hand, model = hand or settings.hand, model or settings.model
    chosen = load_named(hand, model, namespace or settings.namespace)
    address = choose_endpoint(endpoint or settings.endpoint)
    require_fitting(settings.access, address)
    silence_mujoco()
    folder = hand_folder(chosen.description.namespace)
    keyring = machine_keyring(None if gate_apart else settings.recalibration)
    named = [*named_hand(hand, model), "--namespace", chosen.description.namespace, "--endpoint", address]
    with on_termination() as stop, contextlib.ExitStack() as stack:
        process = None
        if chosen.commands and not gate_apart:
            options = [*(["--config", str(config)] if config else []), *(["--version", version] if version else [])]
            process = GateProcess([*named, *options], lambda kind, text: service.tell(kind, text))
            stack.callback(process.close)
        source = ModelSource(chosen, version or settings.version)
        twin, info = source.load()
        link: DaemonEnd | None = None
        service = TwinService(
            twin,
            info,
            settings.daemon,
            journal=folder / "events.jsonl",
            gate=lambda: None if link is None else link.status(),
        )
        ring = Ring(60.0 * settings.daemon.keep_minutes, settings.daemon.keep_mib * 2**20)
        saver = RingSaver(ring, chosen.description, state_dir() / "recordings", settings.daemon)
        ros = RosKeys(settings.ros) if settings.ros is not None else None
        if not chosen.commands:
            access = access_of(settings.access, address, keyring, chosen.description, folder, ros)
            session, how = open_daemon(address, access, stop)
        else:
            if process is not None:
                process.wait(stop)
            login = daemon_login(settings.access, keyring)
            session, how = open_at_gate(address, login, stop, _GATE_S), "joined"
        stack.callback(session.close)
        if how == "joined" and someone_serves(session, service.hand.description.key("alive")):
            raise BadInput(
                f"a twin of {service.namespace} is served there already",
                where=address,
                todo="Stop it first, or run this one with another --namespace or --endpoint",
            )
        stack.callback(saver.close)
        stack.callback(KeepQuestion(session, chosen.description, saver).close)
        diagnoser = Diagnoser(saver, service, named_hand(hand, model))
        stack.callback(diagnoser.close)
        recalibrator = Recalibrator(settings.recalibration, saver, service, source.store, folder, named)
        stack.callback(recalibrator.close)
        announcer = Announcer(session, chosen.description, recalibrator.cancel)
        stack.callback(announcer.close)
        recalibrator.announces(announcer, keyring)
        promotions = Promotions(source, service.ready)
        stack.callback(promotions.close)
        answers = {
            "versions": source.answer,
            "diagnose": diagnoser.start,
            "diagnosis": diagnoser.latest,
            "recalibration": recalibrator.status,
        }
        bridge = ZenohBridge(session, service, answers, ring, ros)
        stack.callback(bridge.close)
        if chosen.commands:
            link = DaemonEnd(session, chosen.description, keyring, service.tell, recalibrator.ask)
            stack.callback(link.close)
        if settings.daemon.metrics_port is not None:
            from twin_daemon.services.metrics import MetricsServer

            metrics = MetricsServer(settings.daemon.metrics_port, service, bridge.health)
            stack.callback(metrics.close)
        notifier = Notifier()
        hangup = Hangup(config is not None and not sys.stdin.isatty())
        stack.callback(hangup.close)

        def retune(changed: DaemonSettings) -> None:
            service.retune(changed)
            saver.retune(changed)

        def tend() -> None:
            notifier.alive()
            if link is not None:
                link.turned()
            if process is not None:
                process.tend()
            if reloader is not None and hangup.came():
                notifier.reloading()
                reloader.reload()
                notifier.say("READY=1")

        reloader = None if config is None else Reloader(config, settings, retune)
        where = f"listens at {address}" if how == "listens" else f"is at {address}"
        log.info("the twin of %s %s, version %s", service.namespace, where, info["id"])
        gc.collect()
        gc.freeze()  # what is here stays: the collector need not walk through it while samples wait
        # a thread that works in Python keeps the others waiting for so long; a sample is not to notice
        sys.setswitchinterval(SWITCH_S)
        notifier.say("READY=1")
        bridge.run(stop, seconds, each_turn=_chores(service, promotions, tend, diagnoser, recalibrator))
        notifier.say("STOPPING=1")
    accepted = service.health()["joint_states"]["accepted"]
    log.info("the twin of %s has stopped; it followed %d joint states", service.namespace, accepted)
    return 0


def hand_folder(namespace: str) -> Path:
    """Where a daemon keeps what belongs to one hand in the network: events and audit log."""
    return state_dir() / "hands" / namespace.replace("/", "_")


def machine_keyring(recalibration: RecalibrationSettings | None) -> Keyring:
    """This machine's identities, made where there are none, with one for automatic runs where the settings ask for it.

    Gate and daemon know each other by the whole file: only who starts before the other one may add to it.
    """
    from twin_daemon.security.identity import ensure_identity, ensure_keyring, keys_file

    path = keys_file(state_dir())
    keyring = ensure_keyring(path)
    if recalibration is None or recalibration.mode != "active":
        return keyring
    try:
        return ensure_identity(path, keyring, recalibration.identity, "operator")
    except OSError as error:
        log.warning("no identity for automatic runs can be made: %s", error)  # and none of them begins
        return keyring


def load_named(hand: str | None, model: Path | None, namespace: str | None) -> Hand:
    """The hand, with another namespace if one is given."""
    from twin_daemon.hand import NAMESPACE, load_hand

    loaded = load_hand(hand, model)
    if namespace is None:
        return loaded
    if not re.fullmatch(NAMESPACE, namespace):
        raise UsageError(
            f"'{namespace}' is no namespace",
            where="--namespace",
            allowed="letters, digits, _ and -, with / between parts",
        )
    return replace(loaded, description=loaded.description.model_copy(update={"namespace": namespace}))


def named_hand(hand: str | None, model: Path | None) -> list[str]:
    """The options that name the same hand to another command."""
    return [*(["--hand", hand] if hand else []), *(["--model", str(model)] if model else [])]


def _chores(
    service: TwinService,
    promotions: Promotions,
    tend: Callable[[], None],
    diagnoser: Diagnoser,
    recalibrator: Recalibrator,
) -> Callable[[], None]:
    """What the loop does between messages: `tend` at every turn, take up a version, a diagnosis, a schedule."""
    from twin_daemon.services.recalibrator import live

    next_poll_s = time.monotonic() + _POLL_S

    def chores() -> None:
        nonlocal next_poll_s
        tend()
        found = promotions.take()
        if found is not None:
            before = live(service)
            service.use(*found)
            recalibrator.taken_up(found[1], before)
        if time.monotonic() < next_poll_s:
            return
        next_poll_s = time.monotonic() + _POLL_S
        diagnoser.poll()

    return chores
