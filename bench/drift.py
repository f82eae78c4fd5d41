"""Does the live twin notice wear, and leave a sound hand alone? Hours of a plant, as fast as it goes.

python -m bench.drift [--hours 8] [--rate 25]

First the hand as it is for some hours: false alarms are counted, and whether the memory stays flat. Then friction grows
on one joint within ten minutes: which joint alarms, and after how long.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import psutil

from twin_daemon.daemon.messages import JointSample
from twin_daemon.daemon.service import TwinService
from twin_daemon.hand import load_hand
from twin_daemon.plant import Plant, parse_hidden
from twin_daemon.plant.motions import rich
from twin_daemon.simulation.twin import TwinModel

_JOINT = "rh_MFJ3"
_MOST_NM = 0.3  # ten times the joint's own friction
_WEARS_S = 600.0
_TAKE_S = 60.0


class Bench:
    """A plant and a twin on one clock that runs as fast as both of them can."""

    def __init__(self, rate_hz: float) -> None:
        hand = load_hand()
        friction = parse_hidden(f"coulomb_friction:{_JOINT}=0.0001", hand)
        self.plant = Plant(hand, seed=11, hidden=[friction], spread=0.2, step_s=0.002)
        self.now_s = 0.0
        self.service = TwinService(
            TwinModel.load(hand), {"id": "nominal"}, monotonic_s=lambda: self.now_s, wall_ns=lambda: self.now_ns
        )
        self._hand, self._period_s, self._take = hand, 1.0 / rate_hz, 0

    @property
    def now_ns(self) -> int:
        return 1_700_000_000_000_000_000 + round(self.now_s * 1e9)

    def run(self, seconds: float, wearing: bool = False) -> list[str]:
        """Moves richly for some time; the joints that alarmed, with when (s since the beginning of this run)."""
        begun_s, alarms = self.now_s, []
        while self.now_s - begun_s < seconds:
            self._take += 1
            motion = rich(self._hand, seconds=_TAKE_S, seed=self._take).by_command(self._hand)
            times = np.arange(0.0, _TAKE_S, self._period_s)
            for row in motion.sample(times):
                self.plant.set_targets(dict(zip(motion.joints, row.tolist(), strict=True)))
                self.service.on_command(JointSample(self.now_ns, motion.joints, row))
                if wearing:
                    share = min((self.now_s - begun_s) / _WEARS_S, 1.0)
                    self.plant.set_hidden("coulomb_friction", 0.0001 + share * _MOST_NM, _JOINT)
                self.plant.advance(self._period_s)
                self.now_s += self._period_s
                names, position, velocity, effort = self.plant.measure()
                self.service.on_joint_state(JointSample(self.now_ns, names, position, velocity, effort))
            for event in self.service.take_events():
                if event.kind == "drift":
                    alarms.append(f"{event.data['joint']} after {self.now_s - begun_s:.0f} s: {event.text}")
        return alarms


def main() -> None:
    """Prints what alarmed, and the memory before and after."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=8.0)
    parser.add_argument("--rate", type=float, default=25.0, help="joint states a second; the loop costs less at few")
    chosen = parser.parse_args()
    bench, process = Bench(chosen.rate), psutil.Process()
    begun, alarms, memory = time.monotonic(), [], []
    for quarter in range(max(1, round(4 * chosen.hours))):
        alarms += bench.run(900.0)
        memory.append(process.memory_info().rss / 1e6)
        print(f"{(quarter + 1) / 4:.2f} h  {memory[-1]:.0f} MB  alarms {len(alarms)}", flush=True)
    print(
        f"{chosen.hours:g} h of a sound hand in {time.monotonic() - begun:.0f} s: {len(alarms)} false alarms", *alarms
    )
    print(f"memory from {memory[0]:.1f} to {memory[-1]:.1f} MB")
    worn = bench.run(_WEARS_S + 120.0, wearing=True)
    print(f"friction of {_JOINT} grows by {_MOST_NM} N m in {_WEARS_S:g} s:", *(worn or ["no alarm"]), sep="\n  ")


if __name__ == "__main__":
    main()
