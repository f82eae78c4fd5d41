"""`twin workbench`: the page on which people see hand and twin, and work on what the model lacks."""

from __future__ import annotations

import logging
import os
import socket
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated

import typer

from twin_daemon.cli import options
from twin_daemon.cli.console import people, plain_text
from twin_daemon.cli.run import load_named, named_hand
from twin_daemon.errors import BadInput
from twin_daemon.workflows.session import silence_mujoco

PORT = 8460

Port = Annotated[
    int, typer.Option("--port", metavar="N", min=0, max=65535, help="Port of the page; 0 takes any free one.")
]
Names = Annotated[
    list[str] | None,
    typer.Option("--name", metavar="HOST...", help="Further names under which browsers may ask this server."),
]
Folders = Annotated[
    list[Path] | None,
    typer.Option("--folder", metavar="FOLDER...", help="Folders of recordings to offer; default: the state folder's."),
]

MostUpload = Annotated[
    int,
    typer.Option(
        "--most-upload", metavar="MB", min=0, max=1_000_000, help="Largest recording that may be dropped on the page."
    ),
]

Fleet = Annotated[
    bool, typer.Option("--fleet", help="Show every hand on the network; recordings and versions are --hand's.")
]


def command(
    port: Port = PORT,
    bind: options.Bind = "127.0.0.1",
    name: Names = None,
    recording: options.OptionalRecordings = None,
    folder: Folders = None,
    trajectory: options.TrajectoryRef = None,
    joint_map: options.JointMap = None,
    hand: options.HandName = None,
    model: options.Model = None,
    namespace: options.Namespace = None,
    endpoint: options.Endpoint = None,
    fleet: Fleet = False,
    most_upload: MostUpload = 4096,
    seconds: options.Seconds = None,
) -> int:
    """Serve the workbench: live hand and twin, recordings against versions, diagnosis, ladder, history.

    It reads only, until the page is opened with the token of the address that is printed at the start.
    """
    from bridges.zenoh.session import choose_endpoint
    from twin_daemon.files import write_atomically
    from twin_daemon.resources import own_state_dir, state_dir
    from twin_daemon.services.stop import leave, on_termination
    from twin_daemon.versions import VersionStore
    from twin_daemon.web.app import build
    from twin_daemon.web.authorization import LOOPBACK, looking_token, new_token
    from twin_daemon.web.compare import Compare
    from twin_daemon.web.dependence import Dependence
    from twin_daemon.web.hands import Hands
    from twin_daemon.web.history import History
    from twin_daemon.web.jobs import Jobs
    from twin_daemon.web.learn import Learn
    from twin_daemon.web.library import Library
    from twin_daemon.web.model_cache import ModelCache
    from twin_daemon.web.scene import Scene
    from twin_daemon.web.server import listen, serve
    from twin_daemon.web.space import Space
    from twin_daemon.web.trial import Trial
    from twin_daemon.web.uploads import Uploads

    logging.basicConfig(level=logging.WARNING, format="%(asctime)s %(levelname)s %(message)s")
    chosen = load_named(hand, model, namespace)
    where = choose_endpoint(endpoint)
    silence_mujoco()
    library = Library(existing(recording), existing(folder) or [state_dir() / "recordings"])
    cache = ModelCache(chosen, VersionStore.of(chosen), trajectory, joint_map)
    listener = listen(bind, port)
    token = new_token()
    local = is_loopback(bind)
    shown = f"[{bind}]" if ":" in bind else bind
    hosts = {*LOOPBACK, shown, socket.gethostname(), *(name or [])}
    for path in recording or []:
        cache.warm(path.absolute())
    compare = Compare(library, cache)
    jobs = Jobs(named_hand(hand, model))
    options_of_data = [*(["--trajectory", trajectory] if trajectory else [])]
    options_of_data += ["--joint-map", str(joint_map.absolute())] if joint_map else []
    learn = Learn(library, cache, jobs, options_of_data)
    hands = Hands(chosen.description, Scene(cache.nominal), where, fleet=fleet)
    uploads = Uploads(library.folders[0], library, cache, most_upload)
    panels = (Dependence(library, cache, jobs), Space(library, cache), Trial(library, cache))
    views = (compare, learn, History(cache.store, chosen.description.bands), *panels, uploads)
    routes = [route for view in views for route in view.routes]
    app = build(chosen, hands, token, hosts, routes, [jobs.close, cache.close, uploads.close], local=local)
    name_shown = socket.gethostname() if bind in ("0.0.0.0", "::") else shown
    look = "" if local else f"#look={looking_token(token)}"
    address = f"http://{name_shown}:{listener.getsockname()[1]}/"

    def ready() -> None:
        console = people()
        shown_hands = f"the hands at {where}" if fleet else chosen.description.namespace
        console.print(f"The workbench of {plain_text(shown_hands)}:", soft_wrap=True)
        if not (look and os.environ.get("JOURNAL_STREAM")):
            console.print(f"  to look:  {plain_text(address)}{look}", soft_wrap=True)
        if os.environ.get("JOURNAL_STREAM"):  # a log is read by more people than may work
            write_atomically(own_state_dir() / "workbench.token", f"{token}\n".encode(), mode=0o600)
            if look:
                write_atomically(own_state_dir() / "workbench.look", f"{looking_token(token)}\n".encode(), mode=0o600)
                console.print(
                    f"  to look:  {plain_text(address)}#look= and what is in {own_state_dir() / 'workbench.look'}"
                )
            console.print(f"  to work:  the same with #token= and what is in {own_state_dir() / 'workbench.token'}")
        else:
            console.print(f"  to work:  {plain_text(address)}#token={token}", soft_wrap=True)
        console.file.flush()

    with on_termination():
        serve(app, listener, seconds, ready)
    return leave(0)


def is_loopback(address: str) -> bool:
    """Whether this machine alone reaches what listens there."""
    try:
        return ip_address(address).is_loopback
    except ValueError:
        return address == "localhost"


def existing(paths: list[Path] | None) -> list[Path]:
    """The paths, all of which have to be there. Raises BadInput."""
    for path in paths or []:
        if not path.exists():
            raise BadInput("no such file or folder", where=path, todo="Name what is there")
    return list(paths or [])
