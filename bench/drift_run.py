"""From a hand that wears to a version that follows it, with nobody there: the whole way through real processes.

    python -m bench.drift_run [--sound 1600] [--hidden viscous_friction:rh_FFJ3=0.3]

A daemon shadows a stand-in hand in real time until it knows what is usual; then the hand is another one, worn. What
follows is the daemon's doing: a joint drifts, its motion is kept, a recalibration runs, its version is promoted and
takes over, and the drift test begins anew. A time is told for each.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from bench.live import Peer
from bridges.zenoh.client import ask
from twin_daemon.cli.children import free_port
from twin_daemon.hand import load_hand
from twin_daemon.resources import twin_command

_LONGEST_S = 1200.0


def main() -> None:
    """One line a step."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--sound", type=float, default=1600.0, help="seconds before it wears")
    parser.add_argument("--hidden", default="viscous_friction:rh_FFJ3=0.3", help="the wear, as for twin hand")
    parser.add_argument("--seconds", type=float, default=60.0, help="time for the recalibration")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder, endpoint = Path(name), f"tcp/127.0.0.1:{free_port()}"
        config = folder / "twin.yaml"
        recalibration = {"mode": "passive", "policy": "automatic", "seconds": chosen.seconds, "least_minutes": 0.0}
        config.write_text(yaml.safe_dump({"recalibration": recalibration}))
        daemon = Peer(twin_command("run", "-c", str(config)), endpoint, folder / "state")
        stack.callback(daemon.close)
        key = load_hand().description.key

        def hand(*arguments: str) -> subprocess.Popen[bytes]:
            command = twin_command("hand", "--trajectory", "rich_finger", "--spread", "0", *arguments)
            environment = {**os.environ, "TWIN_ENDPOINT": endpoint}
            return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

        sound = hand()
        stack.callback(sound.kill)
        time.sleep(chosen.sound)
        drift = ask(daemon.session, key("drift"), 10.0)
        print(f"after {chosen.sound:.0f} s of a sound hand: {drift['verdict']}", flush=True)
        sound.terminate()
        sound.wait(10.0)
        worn = hand("--hidden", chosen.hidden)
        stack.callback(worn.kill)
        began_s = time.monotonic()

        def until(what: str, found: Callable[[], Any]) -> None:
            while not (value := found()):
                if time.monotonic() - began_s > _LONGEST_S:
                    raise SystemExit(f"no {what} within {_LONGEST_S:.0f} s of the wear")
                time.sleep(0.5)
            print(f"{time.monotonic() - began_s:6.1f} s after the wear: {what}: {value}", flush=True)

        def events(kind: str, words: str = "") -> str:
            told = ask(daemon.session, key("events"), 10.0)["events"]
            return next((one["text"] for one in told if one["kind"] == kind and words in one["text"]), "")

        until("drift", lambda: events("drift"))
        until("begun", lambda: events("recalibration", "has begun"))
        until("ended", lambda: ask(daemon.session, key("recalibration"), 10.0)["last"])
        last = ask(daemon.session, key("recalibration"), 10.0)["last"]
        if not last.get("promoted"):
            raise SystemExit("not promoted")
        until("in use", lambda: ask(daemon.session, key("version"), 10.0)["id"] == last["version"] and last["version"])
        until("the drift test", lambda: ask(daemon.session, key("drift"), 10.0)["verdict"])
        health = ask(daemon.session, key("health"), 10.0)
        print(f"joint states received {health['joint_states']['received']}, dropped {health['loop']['dropped']}")


if __name__ == "__main__":
    main()
