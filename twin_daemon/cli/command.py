"""What every command is made of: options that take several values, and groups of commands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import typer
from typer.core import TyperCommand, TyperOption


class TwinCommand(TyperCommand):
    """A command whose list options take several values at once.

    `--recording a b` means the same as `--recording a --recording b`. The values end at the next option or at `--`;
    arguments without an option therefore stand before list options, or after `--`.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        several = {
            name
            for option in self.params
            if isinstance(option, TyperOption) and option.multiple
            for name in (*option.opts, *option.secondary_opts)
        }
        return super().parse_args(ctx, expand(args, several))


def expand(args: Sequence[str], several: set[str]) -> list[str]:
    """Repeat each option of `several` before every one of its values."""
    out: list[str] = []
    option: str | None = None  # the list option whose further values may follow
    for position, arg in enumerate(args):
        if arg == "--":
            return out + list(args[position:])
        if arg.startswith("-") and len(arg) > 1:
            option = arg if arg in several else None
            out.append(arg)
        elif option is not None and out[-1] != option:
            out += [option, arg]
        else:
            out.append(arg)
    return out


class Group(typer.Typer):
    """Several commands under one word: `app = Group("help")`, then `@app.command("list")` on each function."""

    def __init__(self, help: str) -> None:
        super().__init__(help=help, add_completion=False, pretty_exceptions_enable=False)

        @self.callback()
        def _always_a_group() -> None:  # with one command only, typer would otherwise drop the word
            """Nothing is common to the commands."""

    def command(self, name: str | None = None, **settings: Any) -> Callable[[Any], Any]:
        settings.setdefault("cls", TwinCommand)
        return super().command(name, **settings)


def single(name: str, function: Callable[..., Any]) -> Any:
    """The command that calls `function`; its docstring is the help."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command(name, cls=TwinCommand)(function)
    return typer.main.get_command(app)
