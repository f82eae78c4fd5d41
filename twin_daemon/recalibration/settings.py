"""When the twin is fitted anew, and what becomes of the result."""

from __future__ import annotations

import re
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator


class RecalibrationSettings(BaseModel):
    """Times are UTC. Whatever comes first triggers; runs that were missed count once."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    mode: Literal["off", "passive", "active"] = Field(
        default="off",
        description="passive: fit what the hand did anyway; active: with consent, drive it along `trajectory`",
    )
    policy: Literal["ask", "automatic"] = Field(
        default="ask", description="ask: keep as a candidate; automatic: promote what is decided to be better"
    )
    cron: str | None = Field(default=None, description="five fields, minute first; days of the week by name (mon)")
    interval_hours: float | None = Field(default=None, gt=0.0, le=8760.0, description="since the last one")
    motion_hours: float | None = Field(default=None, gt=0.0, le=8760.0, description="of motion since the last one")
    on_drift: bool = Field(default=True, description="when a joint drifts")
    quiet: str | None = Field(default=None, description="no run begins in these hours, such as 22:00-06:00")
    least_minutes: float = Field(
        default=10.0, ge=0.0, description="between the ends of one run and the start of the next"
    )
    seconds: float = Field(
        default=300.0,
        gt=0.0,
        le=86_400.0,
        description="what a run may take of all cores, a diagnosis included, if nothing else ran",
    )
    nice: int = Field(
        default=19, ge=0, le=19, description="priority of its process, and of what names a change; 19: lowest"
    )
    trajectory: str = Field(default="rich_hand", description="of an active run")
    identity: str = Field(default="automatic", description="in whose name an active run arms the hand")
    countdown_s: float = Field(
        default=30.0, ge=5.0, le=3600.0, description="an active run is announced so long before the hand moves"
    )
    probation_s: float = Field(
        default=600.0, ge=0.0, description="a promoted version that does worse live is rolled back within this time"
    )
    worse: float = Field(default=3.0, gt=1.0, description="so many times the error that it promised is worse")

    @field_validator("cron")
    @classmethod
    def _five_fields(cls, text: str | None) -> str | None:
        from apscheduler.triggers.cron import CronTrigger

        if text is not None:
            if re.search(r"\d", text.rpartition(" ")[2]):
                raise ValueError("days of the week by name (mon, tue-fri): programs disagree whether 0 is Monday")
            CronTrigger.from_crontab(text, timezone="UTC")
        return text

    @field_validator("quiet")
    @classmethod
    def _two_times(cls, text: str | None) -> str | None:
        if text is not None:
            quiet_minutes(text)
        return text


def quiet_minutes(text: str) -> tuple[int, int]:
    """Begin and end of 'HH:MM-HH:MM' in minutes of the day. Raises ValueError."""
    found = re.fullmatch(r"([01]\d|2[0-3]):([0-5]\d)-([01]\d|2[0-3]):([0-5]\d)", text)
    if found is None:
        raise ValueError(f"'{text}' is not HH:MM-HH:MM")
    hours = [int(part) for part in found.groups()]
    return 60 * hours[0] + hours[1], 60 * hours[2] + hours[3]
