"""A configuration from file and environment: who wins, where a value came from, what is refused, what is taken live."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from pydantic import BaseModel, ConfigDict, SecretStr

from twin_daemon.cli.app import main
from twin_daemon.daemon import configuration
from twin_daemon.daemon.config_page import page
from twin_daemon.daemon.configuration import Effective, after_reload, load_config, shown
from twin_daemon.daemon.keys import keys_of
from twin_daemon.daemon.settings import TwinConfig
from twin_daemon.errors import BadInput

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def write(tmp_path: Path):
    def write(text: str) -> Path:
        path = tmp_path / "twin.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_the_page_is_what_the_types_say() -> None:
    assert (ROOT / "docs" / "configuration.md").read_text(encoding="utf-8") == page()


def test_every_key_has_a_meaning() -> None:
    assert [key.dotted for key in keys_of(TwinConfig) if not key.field.description] == []


def test_every_variable_of_the_program_is_on_the_page() -> None:
    sources = [path for folder in ("twin_daemon", "bridges") for path in (ROOT / folder).rglob("*.py")]
    asked = r"environ(?:\.get\(|\[)\s*\"(TWIN_[A-Z_]+)\""
    named = {name for path in sources for name in re.findall(asked, path.read_text(encoding="utf-8"))}
    assert named
    text = page()
    assert {name for name in named if f"`{name}`" not in text} == set()


def test_the_environment_wins_over_the_file_and_both_are_named(write) -> None:
    path = write("endpoint: tcp/127.0.0.1:1\ndaemon: {horizon_s: 3, keep_mib: 64}\n")
    found = load_config(path, {"TWIN_DAEMON__HORIZON_S": "1.5", "TWIN_ENDPOINT": "tcp/127.0.0.1:2"})
    assert found.config.daemon.horizon_s == 1.5
    assert found.config.endpoint == "tcp/127.0.0.1:2"
    rows = {key: (value, source) for key, value, source in shown(found)}
    assert rows["daemon.horizon_s"] == (1.5, "TWIN_DAEMON__HORIZON_S")
    assert rows["daemon.keep_mib"] == (64, "file")
    assert rows["daemon.stale_after_s"] == (0.5, "default")


@pytest.mark.parametrize(
    ("name", "text", "key", "value"),
    [
        ("TWIN_DAEMON__RECORDINGS_ROTATE", "true", "daemon.recordings_rotate", True),
        ("TWIN_DAEMON__METRICS_PORT", "9464", "daemon.metrics_port", 9464),
        ("TWIN_DAEMON__METRICS_PORT", "null", "daemon.metrics_port", None),
        ("TWIN_NAMESPACE", "007", "namespace", "007"),
        ("TWIN_NAMESPACE", "", "namespace", None),
        ("TWIN_ROS__TRANSPORT", "ros2dds", "ros.transport", "ros2dds"),
        ("TWIN_ACCESS", "{anonymous: nothing}", "access.anonymous", "nothing"),
        ("TWIN_GATE__LIMITS__rh_WRJ2__VELOCITY_RAD_S", "0.5", "gate.limits.rh_WRJ2.velocity_rad_s", 0.5),
        ("TWIN_GATE__EFFORT_LIMIT", "{rh_FFJ3: 2}", "gate.effort_limit.rh_FFJ3", 2.0),
    ],
)
def test_a_variable_sets_its_key(name: str, text: str, key: str, value: object) -> None:
    found = load_config(None, {name: text})
    assert {key: value for key, value, _ in shown(found)}[key] == value
    assert found.source(key) == (name if text else "default")


@pytest.mark.parametrize(
    ("environment", "said"),
    [
        ({"TWIN_DAEMON__HORIZN_S": "1"}, "Did you mean 'TWIN_DAEMON__HORIZON_S'?"),
        ({"TWIN_ENDPONT": "tcp/127.0.0.1:1"}, "Did you mean 'TWIN_ENDPOINT'?"),
        ({"TWIN_KEY": "keys.json"}, "Did you mean 'TWIN_KEYS'?"),
        ({"TWIN_HAND__NAME": "x"}, "there is no such setting"),
        ({"TWIN_DAEMON__HORIZON_S": "soon"}, "environment, TWIN_DAEMON__HORIZON_S: daemon.horizon_s"),
        ({"TWIN_DAEMON__HORIZON_S": "[1"}, "environment, TWIN_DAEMON__HORIZON_S"),
        ({"TWIN_DAEMON": "7"}, "environment, TWIN_DAEMON"),
    ],
)
def test_a_variable_that_means_nothing_is_refused_by_name(environment: dict[str, str], said: str) -> None:
    with pytest.raises(BadInput, match=re.escape(said)) as caught:
        load_config(None, environment)
    assert "\n" not in str(caught.value)


def test_variables_of_others_are_left_alone() -> None:
    assert load_config(None, {"TWIN_CITIES_WEATHER": "cold", "TWIN_STATE_DIR": "/x"}) == Effective(TwinConfig())


def test_an_unknown_key_deep_in_the_file_is_named_with_the_nearest(write) -> None:
    with pytest.raises(BadInput, match=r"gate\.limits\.rh_WRJ2\.velocity_rads.*Did you mean 'velocity_rad_s'"):
        load_config(write("gate: {limits: {rh_WRJ2: {velocity_rads: 1}}}\n"), {})


def test_aliases_that_stand_for_millions_are_refused(write) -> None:
    lines = ["a0: &a0 [x]", *(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 12))]
    with pytest.raises(BadInput, match="aliases stand for more than"):
        load_config(write("\n".join(lines)), {})


@pytest.mark.parametrize("text", ["", "# nothing yet\n"])
def test_a_file_that_sets_nothing_means_the_defaults(write, text: str) -> None:
    assert load_config(write(text), {}) == Effective(TwinConfig())


def test_a_secret_is_never_shown() -> None:
    class Mail(BaseModel):
        model_config = ConfigDict(frozen=True)
        password: SecretStr = SecretStr("hunter2")

    assert list(configuration._values(Mail())) == [("password", "(set, not shown)")]


def test_a_reload_takes_what_it_can_and_names_the_rest() -> None:
    before = load_config(None, {}).config
    after = load_config(None, {"TWIN_DAEMON__HORIZON_S": "1", "TWIN_DAEMON__KEEP_MIB": "7", "TWIN_HAND": "x"}).config
    merged, taken, waiting = after_reload(before, after)
    assert taken == ["daemon.horizon_s"]
    assert waiting == ["hand", "daemon.keep_mib"]
    assert merged.daemon == before.daemon.model_copy(update={"horizon_s": 1.0})
    assert merged.hand is None


def test_check_and_show_speak_to_people(
    write, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write("daemon: {horizon_s: 3}\n")
    monkeypatch.setenv("TWIN_GATE__SPEED", "0.5")
    assert main(["config", "check", str(path)]) == 0
    assert "2 keys are set" in capsys.readouterr().out
    assert main(["config", "show", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.split() == ["daemon.horizon_s", "3.0", "file"] for line in lines)
    assert any(line.split() == ["gate.speed", "0.5", "TWIN_GATE__SPEED"] for line in lines)


def test_check_looks_at_the_hand_too(write, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "check", str(write("gate: {limits: {rh_WRJ9: {step_rad: 1}}}\n"))]) == 3
    assert "rh_WRJ9" in capsys.readouterr().err
    assert main(["config", "check", str(write("hand: shadow_hnd\n"))]) == 3
    assert "Did you mean 'shadow_hand'?" in capsys.readouterr().err
