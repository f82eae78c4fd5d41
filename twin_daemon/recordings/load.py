"""One way in for every form of recording. Whatever is wrong with the files, the answer is BadInput with one line."""

from __future__ import annotations

import hashlib
import re
import stat
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from yaml import YAMLError

from twin_daemon.errors import BadInput, TwinError
from twin_daemon.recordings.bag import Contents
from twin_daemon.recordings.budget import reading
from twin_daemon.recordings.confined import confined
from twin_daemon.recordings.csv_pair import JOINT_LIST, pair_files, read_csv_pair
from twin_daemon.recordings.joint_map import check_joint_map
from twin_daemon.recordings.joint_state_csv import read_joint_state_csv
from twin_daemon.recordings.mcap_file import PART
from twin_daemon.recordings.quality import VALUE_KINDS, Quality, measure_timing
from twin_daemon.recordings.recording import Recording, name_of_file
from twin_daemon.recordings.rosbag1 import read_ros1
from twin_daemon.recordings.rosbag2 import read_ros2, storage_files

ALLOWED = (
    "a ROS 1 bag, a ROS 2 bag (folder, .mcap or .db3), a CSV of joint states, or a folder with control.csv and "
    "state_motor.csv"
)
_QUOTED = re.compile(r""""(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'""")
_LONG_BEFORE_NS = 60 * 1_000_000_000
_MANY = 0.05  # when more of the messages than this are left out, a reader should be told in words


@dataclass(frozen=True)
class _Form:
    """A form of recording: what it is called, where it is, which files it consists of and what reads it."""

    name: str
    path: Path
    files: Sequence[Path]
    read: Callable[[Path], Contents]


def load_recording(
    path: str | Path, joint_map: Mapping[str, str] | None = None, sha256: str | None = None
) -> Recording:
    """Reads a recording of any form; `joint_map` renames its joints and commands, `sha256` is of its bytes where
    somebody has counted it already. Raises BadInput."""
    path = Path(path)
    try:
        form = _form(path)
        with ThreadPoolExecutor(1) as beside:  # of a large file, the digest takes a fifth of the reading
            digest = beside.submit(lambda: sha256 or _sha256(form))
            with reading(sum(file.stat().st_size for file in form.files)):
                contents = form.read(form.path)
            counted = digest.result()
    except TwinError as error:
        where = path if error.where is None else error.where
        raise BadInput(error.what, where=where, allowed=error.allowed, todo=error.todo) from None
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror or error})", where=path, todo=_TODO) from None
    except MemoryError:
        raise BadInput(
            "does not fit into memory, or declares sizes that it does not have", where=path, todo=_TODO
        ) from None
    except Exception as error:  # damaged files break their readers in every way there is
        raise BadInput(f"damaged or not finished ({_cause(error)})", where=path, todo=_TODO) from None
    recording = _recording(form, contents, counted)
    if not joint_map:
        return recording
    commands = recording.commands.names if recording.commands else ()
    check_joint_map(joint_map, recording.joints, commands, path)
    return recording.renamed(joint_map)


def load_offered(path: Path, joint_map: Mapping[str, str] | None = None, sha256: str | None = None) -> Recording:
    """Like `load_recording`, for what lies in a folder that others may write to: a link is not followed."""
    with confined(path) as held:
        try:
            recording = load_recording(held, joint_map, sha256)
        except BadInput as error:
            what, where = (
                None if text is None else text.replace(str(held), str(path)).replace(str(held.parent), str(path.parent))
                for text in (error.what, error.where)
            )
            raise BadInput(what or "", where=where, allowed=error.allowed, todo=error.todo) from None
    return replace(recording, path=path)


_TODO = "Record it again, or copy it from where it is whole"


def _cause(error: Exception) -> str:
    """What broke, without a word of what is in the file: it may be none of ours, and others read what is said of it."""
    if isinstance(error, YAMLError):
        mark = getattr(error, "problem_mark", None)
        return "no YAML" if mark is None else f"no YAML in line {mark.line + 1}"
    text = " ".join(_QUOTED.sub("...", str(error)).split())
    return f"{type(error).__name__}: {text:.160}" if text else type(error).__name__


def _form(path: Path) -> _Form:
    """Tells the form by what is there and how it begins, not by what it is called."""
    if not path.exists():
        raise BadInput("no such file or folder", allowed=ALLOWED)
    if path.is_dir():
        return _folder_form(path)
    if not stat.S_ISREG(path.stat().st_mode):
        raise BadInput("not a file (a device or a pipe)", allowed=ALLOWED)
    if path.name == "metadata.yaml":
        return _folder_form(path.parent)
    with path.open("rb") as file:
        start = file.read(64)
    if not start:
        raise BadInput("the file is empty", todo=_TODO)
    if start.startswith(b"#ROSBAG V"):
        return _Form("ROS 1 bag", path, [path], read_ros1)
    if start.startswith((b"\x89MCAP0\r\n", b"SQLite format 3\x00")):
        suffix = ".mcap" if start[1:5] == b"MCAP" else ".db3"
        if path.name.endswith(f".mcap{PART}"):
            raise BadInput("a recording that was never finished", todo=f"Run 'twin record --recover {path}'")
        if path.suffix != suffix:
            raise BadInput(f"holds a ROS 2 bag but is not called {suffix}", todo=f"Rename it to {path.stem}{suffix}")
        return _Form(f"ROS 2 bag ({_storage(path)})", path, [path], read_ros2)
    if path.name.removesuffix(".gz").endswith(".csv"):
        if path in pair_files(path.parent) and not start.startswith(b"name"):
            return _folder_form(path.parent)
        return _Form("CSV", path, [path], read_joint_state_csv)
    raise BadInput("not a recording of a known form", allowed=ALLOWED)


def _folder_form(folder: Path) -> _Form:
    if (folder / "metadata.yaml").is_file() or storage_files(folder):
        files = sorted(file for file in folder.iterdir() if file.is_file() and not file.name.startswith("."))
        stored = next((file for file in files if {".mcap", ".db3"} & set(file.suffixes)), folder)
        return _Form(f"ROS 2 bag ({_storage(stored)})", folder, files, read_ros2)
    if pair := pair_files(folder):
        lists = [list_ for list_ in (folder / JOINT_LIST,) if list_.is_file()]
        return _Form("CSV pair", folder, sorted([*pair, *lists]), read_csv_pair)
    raise BadInput("this folder holds no recording", allowed=ALLOWED)


def _storage(path: Path) -> str:
    return "MCAP" if ".mcap" in path.suffixes else "sqlite3"


def _sha256(form: _Form) -> str:
    """Of the file's bytes; of a folder, of the names and digests of its files, sorted."""
    if form.path.is_file():
        return _file_digest(form.path)
    digest = hashlib.sha256()
    for file in form.files:
        digest.update(f"{_file_digest(file)}  {file.name}\n".encode())
    return digest.hexdigest()


def _file_digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _recording(form: _Form, contents: Contents, sha256: str) -> Recording:
    measured = contents.measured
    quality = Quality(
        **measure_timing(measured.stamp_ns),
        messages=contents.messages,
        merged=measured.merged,
        dropped=_counted(contents.dropped),
        commands_dropped=_counted(contents.commands_dropped),
        source=form.name,
        measured_topic=contents.measured_topic,
        command_topics=contents.command_topics,
        notes=tuple(contents.notes + _warnings(contents)),
    )
    return Recording(
        name=name_of_file(form.path) if form.path.is_file() else form.path.resolve().name,
        path=form.path,
        sha256=sha256,
        joints=measured.joints,
        stamp_ns=measured.stamp_ns,
        position=measured.position,
        velocity=measured.velocity,
        effort=measured.effort,
        commands=contents.commands,
        quality=quality,
    )


def _counted(counts: Mapping[str, int]) -> dict[str, int]:
    return {kind: count for kind, count in sorted(counts.items()) if count}


def _warnings(contents: Contents) -> list[str]:
    """What a person should know before trusting the recording."""
    notes = []
    measured = contents.measured
    lost = contents.messages - len(measured.stamp_ns) - measured.merged
    if lost > _MANY * contents.messages:
        kinds = ", ".join(
            f"{count} {kind}" for kind, count in _counted(contents.dropped).items() if kind not in VALUE_KINDS
        )
        notes.append(f"{lost} of {contents.messages} messages were left out: {kinds}")
    commands = contents.commands
    if commands is not None:
        first_ns, last_ns = int(measured.stamp_ns[0]), int(measured.stamp_ns[-1])
        if commands.stamp_ns[0] > last_ns or (commands.stamp_ns[-1] < first_ns - _LONG_BEFORE_NS):
            notes.append("the commands lie wholly outside the time of the measurements: check the clocks of both")
    return notes
