"""How far work has come, on standard error."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import TaskID

    from twin_daemon.estimation.solvers.tracker import Progress


def progress_console() -> Console:
    """The console for progress bars and notes: always standard error, so that results can be piped."""
    from rich.console import Console

    return Console(stderr=True, highlight=False)


class progress_bar:
    """A progress bar on standard error with the best error so far; nothing is drawn before there is one."""

    def __init__(self, label: str, budget: int | None) -> None:
        from rich.markup import escape
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("best {task.fields[best]}"),
            TimeElapsedColumn(),
            console=progress_console(),
        )
        self._label, self._budget = escape(label), budget
        self._task: TaskID | None = None

    def __enter__(self) -> Progress:
        return self._report

    def _report(self, count: int, best: float) -> None:
        if self._task is None:
            self._task = self._progress.add_task(self._label, total=self._budget, best="-")
            self._progress.start()
        self._progress.update(self._task, completed=count, best=f"{best:.4g} rad²")

    def __exit__(self, *_: object) -> None:
        if self._task is not None:
            self._progress.stop()


class streaming:
    """Lines above a running clock on standard error."""

    def __init__(self) -> None:
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
        self._progress = Progress(*columns, console=progress_console(), transient=True)

    def __enter__(self) -> Callable[[str], None]:
        self._progress.start()
        self._progress.add_task("refitting candidates", total=None)
        # neither markup nor emoji: 'gravity_tilt:hand:' is a name
        return lambda line: self._progress.console.print(line, markup=False, emoji=False, soft_wrap=True)

    def __exit__(self, *_: object) -> None:
        self._progress.stop()
