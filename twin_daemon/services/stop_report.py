"""What a stop did and what it did not: the gate's proved answer, and what was measured for a second after it."""

from __future__ import annotations

from typing import Any

AFTER_S = 1.0
"""So long after the gate's answer it is asked whether the hand still moves."""
UNPROVED = "nobody who can prove it is the gate has answered"
OWN_STOP = "Use the hand's own emergency stop"


def stop_report(answer: dict[str, Any], status: dict[str, Any] | None) -> dict[str, Any]:
    """`latched`, `was_driving`, `hand_still_moves` (None: not known), `moved_rad`, `driver_stop` and `proved`, beside
    what the gate answered. `status` is the gate's a second later, None where it did not answer any more.

    Whoever cannot prove to be the gate has latched nothing.
    """
    proved = answer.get("proved") is True
    later = status if status is not None and status.get("proved") is True else {}
    return answer | {
        "proved": proved,
        "latched": proved and answer.get("latched") is True,
        "was_driving": answer.get("was_driving") if proved else None,
        "hand_still_moves": later.get("hand_moves"),
        "moved_rad": later.get("moved_rad") or {},
        "driver_stop": later.get("driver_stop", answer.get("driver_stop")),
    }


def is_safe(report: dict[str, Any]) -> bool:
    """Whether the stop did all that it can: latched, and nothing was seen to move."""
    return report["latched"] and report["hand_still_moves"] is not True


def in_words(report: dict[str, Any]) -> str:
    """The report in a few sentences, what is wrong first."""
    if not report["proved"]:
        return f"NOT known to be stopped: {UNPROVED}. {OWN_STOP}"
    if not report["latched"]:
        return f"NOT stopped: {report.get('why') or 'the gate did not latch'}. {OWN_STOP}"
    said = []
    if report["hand_still_moves"]:
        moved = sorted(report["moved_rad"].items(), key=lambda one: -one[1])
        joints = ", ".join(f"{name} by {way:.2f} rad" for name, way in moved[:4]) + (", ..." if len(moved) > 4 else "")
        said.append(f"THE HAND STILL MOVES ({joints} in the last moments): somebody else drives it. {OWN_STOP}")
    said.append("The gate is latched: nothing goes out through it before a release")
    if report.get("latch_kept") is False:
        said.append(f"The latch is not on disk: {report.get('latch_why')}")
    said.append(
        "commands of this gate were under way and came to rest"
        if report["was_driving"]
        else "no commands of this gate were under way"
    )
    driver = report.get("driver_stop")
    if driver is not None:
        done = {True: "was called", False: f"FAILED: {driver.get('why')}"}.get(driver["done"], "has not answered")
        said.append(f"the stop of the hand's driver ({driver['what']}) {done}")
    if report["hand_still_moves"] is None:
        said.append("whether the hand moves is not known: it was not heard for a second")
    elif not report["hand_still_moves"]:
        said.append("the hand is at rest")
    return ". ".join(part[0].upper() + part[1:] for part in said)
