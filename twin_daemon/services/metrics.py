"""The daemon's health for Prometheus: the same numbers as `twin/<ns>/health`, read when they are scraped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from twin_daemon.daemon.service import TwinService
from twin_daemon.errors import BadInput

Health = Callable[[], dict[str, Any]]


class _Twin(Collector):
    """Turns one health report, and the error of each joint, into metric families."""

    def __init__(self, service: TwinService, health: Health) -> None:
        self._service, self._health = service, health

    def collect(self) -> Iterator[Metric]:
        health = self._health()
        hand = [health["namespace"]]
        streams = CounterMetricFamily("twin_messages", "Messages that arrived.", labels=["hand", "stream"])
        refused = CounterMetricFamily(
            "twin_refused", "What was wrong with messages.", labels=["hand", "stream", "kind"]
        )
        for stream in ("joint_states", "joint_commands"):
            streams.add_metric([*hand, stream], health[stream]["received"])
            for kind, count in health[stream]["counts"].items():
                refused.add_metric([*hand, stream, kind], count)
        yield streams
        yield refused
        timing, loop = health["timing"], health["loop"]
        yield from (
            _gauge("twin_age_seconds", "Since any joint was heard.", hand, health["age_s"]),
            _gauge("twin_stale", "1 where the state is too old to believe.", hand, float(health["stale"])),
            _gauge("twin_uptime_seconds", "Since the daemon began.", hand, health["uptime_s"]),
            _gauge("twin_clock_offset_seconds", "Arrival minus stamp.", hand, timing["offset_s"]),
            _gauge("twin_jitter_seconds", "Of arrival beside the stamps.", hand, timing["jitter_s"]),
            _gauge("twin_rate_hertz", "Of joint states.", hand, timing["rate_hz"]),
            _gauge("twin_latency_p99_seconds", "From sample in to prediction out.", hand, loop["latency_p99_s"]),
            _counter("twin_missing", "Joint states that never came.", hand, timing["missing"]),
            _counter("twin_late", "Joint states that came late.", hand, timing["late"]),
            _counter("twin_dropped", "Messages that found the inbox full.", hand, loop["dropped"]),
            _counter("twin_errors", "Turns of the loop that failed.", hand, loop["errors"]),
        )
        error = GaugeMetricFamily("twin_residual_rmse_radians", "Over the window.", labels=["hand", "joint"])
        drifting = GaugeMetricFamily("twin_drifting", "1 where the drift test has alarmed.", labels=["hand", "joint"])
        alarmed = set(self._service.drift()["drifting_joints"])
        for joint, values in self._service.residual()["joints"].items():
            if values["rmse_rad"] is not None:
                error.add_metric([*hand, joint], values["rmse_rad"])
            drifting.add_metric([*hand, joint], float(joint in alarmed))
        yield error
        yield drifting


def _gauge(name: str, text: str, hand: list[str], value: float | None) -> Metric:
    """A gauge of the hand; without a sample while the value is unknown."""
    family = GaugeMetricFamily(name, text, labels=["hand"])
    if value is not None:
        family.add_metric(hand, value)
    return family


def _counter(name: str, text: str, hand: list[str], value: int) -> Metric:
    family = CounterMetricFamily(name, text, labels=["hand"])
    family.add_metric(hand, value)
    return family


class MetricsServer:
    """Serves the metrics over HTTP on loopback until it is closed. Raises BadInput where the port is taken."""

    def __init__(self, port: int, service: TwinService, health: Health) -> None:
        registry = CollectorRegistry()
        registry.register(_Twin(service, health))
        try:
            self._server, self._thread = start_http_server(port, addr="127.0.0.1", registry=registry)
        except OSError as error:
            raise BadInput(
                f"cannot serve metrics ({error.strerror})",
                where=f"127.0.0.1:{port}",
                todo="Choose another metrics_port",
            ) from None

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
