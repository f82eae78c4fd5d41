"""The daemon put together on one Zenoh session: its gate, the service, what runs beside it, and the bridge."""

from __future__ import annotations

import contextlib
import gc
import logging
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import zenoh

from bridges.zenoh.access import access_of, daemon_login
from bridges.zenoh.announcer import Announcer
from bridges.zenoh.bridge import ZenohBridge
from bridges.zenoh.gate_link import DaemonEnd
from bridges.zenoh.keep_question import KeepQuestion
from bridges.zenoh.ros_keys import RosKeys
from bridges.zenoh.session import open_at_gate, open_daemon, someone_serves
from twin_daemon.daemon.models import ModelSource
from twin_daemon.daemon.notify import Notifier
from twin_daemon.daemon.promotions import Promotions
from twin_daemon.daemon.service import TwinService
from twin_daemon.daemon.settings import DaemonSettings, TwinConfig
from twin_daemon.errors import BadInput
from twin_daemon.hand import Hand
from twin_daemon.resources import SWITCH_S, state_dir
from twin_daemon.security.identity import Keyring
from twin_daemon.services.change_namer import ChangeNamer
from twin_daemon.services.diagnoser import Diagnoser
from twin_daemon.services.gate_process import GateProcess
from twin_daemon.services.recalibrator import Recalibrator, live
from twin_daemon.services.reload import Reloader
from twin_daemon.services.ring import Ring
from twin_daemon.services.ring_saver import RingSaver
from twin_daemon.services.stop import Hangup, StopSignal

log = logging.getLogger("twin")

_POLL_S = 1.0
_GATE_S = 20.0  # a gate that is a unit of its own may start later


@dataclass(frozen=True)
class Setup:
    """What a daemon is started with. With `own_gate` it starts the gate's process itself. `hand_options` name the hand
    to another `twin` command, `network_options` the network as well, `gate_options` all that its gate needs."""

    hand: Hand
    settings: TwinConfig
    config: Path | None
    version: str | None
    address: str
    folder: Path
    keyring: Keyring
    own_gate: bool
    hand_options: list[str]
    network_options: list[str]
    gate_options: list[str]


class Daemon:
    """Everything that `twin run` runs; what has to be closed goes on `stack`, in the order in which it was opened.

    Raises BadInput for an address at which this hand has a twin already, and what its gate says that cannot begin.
    """

    def __init__(self, setup: Setup, stop: StopSignal, stack: contextlib.ExitStack) -> None:
        self._setup, self._stop, self._stack = setup, stop, stack
        description, settings = setup.hand.description, setup.settings
        self._link: DaemonEnd | None = None
        self._process = self._start_gate()
        source = ModelSource(setup.hand, setup.version)
        twin, info = source.load()
        self.service = TwinService(
            twin,
            info,
            settings.daemon,
            journal=setup.folder / "events.jsonl",
            gate=lambda: None if self._link is None else self._link.status(),
        )
        ring = Ring(60.0 * settings.daemon.keep_minutes, settings.daemon.keep_mib * 2**20)
        self._saver = RingSaver(ring, description, state_dir() / "recordings", settings.daemon)
        ros = RosKeys(settings.ros) if settings.ros is not None else None
        session = self._open_session(ros)
        stack.callback(self._saver.close)
        stack.callback(KeepQuestion(session, description, self._saver).close)
        self._diagnoser = Diagnoser(self._saver, self.service, setup.hand_options)
        stack.callback(self._diagnoser.close)
        self._recalibrator = self._begin_recalibrator(session, source)
        nice = setup.settings.recalibration.nice
        namer = ChangeNamer(self._saver, self.service, source.store, setup.folder, setup.hand_options, nice)
        stack.callback(namer.close)
        self._promotions = Promotions(source, self.service.ready)
        stack.callback(self._promotions.close)
        answers = {
            "versions": source.answer,
            "diagnose": self._diagnoser.start,
            "diagnosis": self._diagnoser.latest,
            "recalibration": self._recalibrator.status,
        }
        self._bridge = ZenohBridge(session, self.service, answers, ring, ros)
        stack.callback(self._bridge.close)
        if setup.hand.commands:
            self._link = DaemonEnd(session, description, setup.keyring, self.service.tell, self._recalibrator.ask)
            stack.callback(self._link.close)
        self._serve_metrics()
        self._notifier = Notifier()
        self._hangup = Hangup(setup.config is not None and not sys.stdin.isatty())
        stack.callback(self._hangup.close)
        self._reloader = None if setup.config is None else Reloader(setup.config, settings, self._retune)

    # -- its parts -----------------------------------------------------------------------------------------

    def _start_gate(self) -> GateProcess | None:
        if not self._setup.own_gate:
            return None
        process = GateProcess(self._setup.gate_options, lambda kind, text: self.service.tell(kind, text))
        self._stack.callback(process.close)
        return process

    def _open_session(self, ros: RosKeys | None) -> zenoh.Session:
        setup = self._setup
        description, address, access = setup.hand.description, setup.address, setup.settings.access
        if not setup.hand.commands:
            rules = access_of(access, address, setup.keyring, description, setup.folder, ros)
            session, how = open_daemon(address, rules, self._stop)
        else:
            if self._process is not None:
                self._process.wait(self._stop)
            login = daemon_login(access, setup.keyring)
            session, how = open_at_gate(address, login, self._stop, _GATE_S), "joined"
        self._stack.callback(session.close)
        if how == "joined" and someone_serves(session, description.key("alive")):
            raise BadInput(
                f"a twin of {self.service.namespace} is served there already",
                where=address,
                todo="Stop it first, or run this one with another --namespace or --endpoint",
            )
        self._where = f"listens at {address}" if how == "listens" else f"is at {address}"
        return session

    def _begin_recalibrator(self, session: zenoh.Session, source: ModelSource) -> Recalibrator:
        setup = self._setup
        recalibrator = Recalibrator(
            setup.settings.recalibration, self._saver, self.service, source.store, setup.folder, setup.network_options
        )
        self._stack.callback(recalibrator.close)
        announcer = Announcer(session, setup.hand.description, recalibrator.cancel)
        self._stack.callback(announcer.close)
        recalibrator.announces(announcer, setup.keyring)
        return recalibrator

    def _serve_metrics(self) -> None:
        port = self._setup.settings.daemon.metrics_port
        if port is not None:
            from twin_daemon.services.metrics import MetricsServer

            self._stack.callback(MetricsServer(port, self.service, self._bridge.health).close)

    # -- the loop ------------------------------------------------------------------------------------------

    def run(self, seconds: float | None) -> None:
        """Works until the stop signal, or until `seconds` have passed."""
        log.info("the twin of %s %s, version %s", self.service.namespace, self._where, self.service.version_info["id"])
        gc.collect()
        gc.freeze()  # what is here stays: the collector need not walk through it while samples wait
        sys.setswitchinterval(SWITCH_S)
        self._notifier.say("READY=1")
        self._bridge.run(self._stop, seconds, each_turn=self._chores())
        self._notifier.say("STOPPING=1")

    def _chores(self) -> Callable[[], None]:
        """What the loop does between messages: tend its parts at every turn, take up a version, look at a diagnosis."""
        next_poll_s = time.monotonic() + _POLL_S

        def chores() -> None:
            nonlocal next_poll_s
            self._tend()
            found = self._promotions.take()
            if found is not None:
                before = live(self.service)
                self.service.use(*found)
                self._recalibrator.taken_up(found[1], before)
            if time.monotonic() < next_poll_s:
                return
            next_poll_s = time.monotonic() + _POLL_S
            self._diagnoser.poll()

        return chores

    def _tend(self) -> None:
        self._notifier.alive()
        if self._link is not None:
            self._link.turned()
        if self._process is not None:
            self._process.tend()
        if self._reloader is not None and self._hangup.came():
            self._notifier.reloading()
            self._reloader.reload()
            self._notifier.say("READY=1")

    def _retune(self, changed: DaemonSettings) -> None:
        self.service.retune(changed)
        self._saver.retune(changed)
