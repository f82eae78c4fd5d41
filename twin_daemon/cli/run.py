"""`twin run`: the daemon."""

from __future__ import annotations

import contextlib
import logging
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin_daemon.cli.options import Config, Endpoint, HandName, Model, Namespace, Seconds, VersionRef
from twin_daemon.errors import UsageError
from twin_daemon.resources import state_dir
from twin_daemon.workflows.session import silence_mujoco

if TYPE_CHECKING:
    from twin_daemon.hand import Hand
    from twin_daemon.recalibration.settings import RecalibrationSettings
    from twin_daemon.security.identity import Keyring

log = logging.getLogger("twin")

AUDIT = "audit.jsonl"


def command(
    config: Config = None,
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
    from bridges.zenoh.access import require_fitting
    from bridges.zenoh.daemon import Daemon, Setup
    from bridges.zenoh.session import choose_endpoint
    from twin_daemon.daemon.configuration import load_config
    from twin_daemon.services.stop import on_termination

    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    settings = load_config(config, os.environ).config
    hand, model = hand or settings.hand, model or settings.model
    chosen = load_named(hand, model, namespace or settings.namespace)
    namespace = chosen.description.namespace
    address = choose_endpoint(endpoint or settings.endpoint)
    require_fitting(settings.access, address)
    silence_mujoco()
    own = named_hand(hand, model)
    named = [*own, "--namespace", namespace, "--endpoint", address]
    for_gate = [*(["--config", str(config)] if config else []), *(["--version", version] if version else [])]
    setup = Setup(
        chosen,
        settings,
        config,
        version or settings.version,
        address,
        hand_folder(namespace),
        machine_keyring(None if gate_apart else settings.recalibration),
        own_gate=bool(chosen.commands) and not gate_apart,
        hand_options=own,
        network_options=named,
        gate_options=[*named, *for_gate],
    )
    with on_termination() as stop, contextlib.ExitStack() as stack:
        daemon = Daemon(setup, stop, stack)
        daemon.run(seconds)
    accepted = daemon.service.health()["joint_states"]["accepted"]
    log.info("the twin of %s has stopped; it followed %d joint states", namespace, accepted)
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
