"""The table of commands. Nothing of a command is imported until it runs: `lupin --help` is typed all day."""

from __future__ import annotations

import atexit
import importlib
import io
import os
import sys
from contextlib import suppress
from typing import Any, NoReturn

import typer
from typer.core import TyperGroup

from lupin_cli import __version__

# verb: (section, one line of help). The module is lupin_cli.commands.<verb>, with dashes as underscores.
COMMANDS: dict[str, tuple[str, str]] = {
    "up": ("Run", "Bring the whole stack up; with --mission, explore, read every tag and report."),
    "status": ("Run", "What runs: stages, processes, mission."),
    "logs": ("Run", "What the processes of a run have said."),
    "down": ("Run", "Stop a run and leave nothing behind."),
    "run": ("Run", "Run one process of the stack in the foreground."),
    "mission": ("Mission", "Start, pause, resume or abort a mission; draw its state machine."),
    "deploy": ("Robot", "Put Lupin onto a robot, or this machine's half of the link in place."),
    "doctor": ("Robot", "What is wrong with robot, laptop and link, why, and what mends it."),
    "robots": ("Robot", "The robots that Lupin knows, and whether they answer."),
    "dds": ("Robot", "How this machine joins the robot's graph: set up, check, remove."),
    "transport": ("Robot", "What carries the link, how good it is, which to take."),
    "sim": ("Simulator", "The simulated robot: worlds, pictures, the red button."),
    "home": ("Robot", "Controllers active, arm at rest."),
    "play": ("Robot", "Play a playbook: dry run, diff, resume, undo."),
    "journal": ("Robot", "What playbooks did: runs, steps, outputs."),
    "sync-clock": ("Robot", "Measure the robot's clock; set it while its stack is stopped."),
    "sweep": ("Robot", "End zombie ROS processes, remove shared memory that nobody holds."),
    "bundle": ("Robot", "A redacted support archive: facts, findings, logs, for somebody else to look at."),
    "replay": ("Results", "Look at a recorded run again."),
    "report": ("Results", "Build the report of a recorded run."),
    "map": ("Tools", "Build, plan on and optimise maps, without a robot."),
    "tags": ("Tools", "Find AprilTags in pictures."),
}


class LazyGroup(TyperGroup):
    """A group that knows its commands from the table and imports one only when it is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"lupin_cli.commands.{cmd_name.replace('-', '_')}")
        app = getattr(module, "app", None)
        if app is None:
            app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
            app.command(cmd_name)(module.command)
        command = typer.main.get_command(app)
        command.name = cmd_name
        return command

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        sections: dict[str, list[tuple[str, str]]] = {}
        for verb, (section, text) in COMMANDS.items():
            sections.setdefault(section, []).append((verb, text))
        for section, rows in sections.items():
            with formatter.section(section):
                formatter.write_dl(rows)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        # The base class looks for near misses among loaded commands; ours are the table's.
        if args and not args[0].startswith("-") and args[0] not in COMMANDS:
            from difflib import get_close_matches

            near = get_close_matches(args[0], COMMANDS, n=1)
            hint = f" Did you mean: lupin {near[0]}" if near else " See: lupin --help"
            ctx.fail(f"there is no command {args[0]!r}.{hint}")
        return super().resolve_command(ctx, args)


app = typer.Typer(
    cls=LazyGroup,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(value: bool) -> None:
    if value:
        typer.echo(f"lupin {__version__}")
        raise typer.Exit()


@app.callback(help="Lupin: operator's toolkit and runtime of a MIRTE Master greenhouse robot.")
def root(
    version: bool = typer.Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
    ),
    debug: bool = typer.Option(False, "--debug", help="Show the whole stack of an error."),
) -> None:
    """Options that every command shares."""


def _speak_utf8() -> None:
    """Playbooks, journals and the names of files are UTF-8, whatever the terminal's language: where Python would read and write
    something else, it is started again in its UTF-8 mode (PEP 540). What no encoding can show is shown by its number."""
    if sys.getfilesystemencoding() != "utf-8" and "PYTHONUTF8" not in os.environ:
        os.environ["PYTHONUTF8"] = "1"
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def main() -> None:
    """The `lupin` command: an expected error ends in one line and a status, a defect keeps its stack with --debug."""
    _speak_utf8()
    status: object = 0
    try:
        app()
    except SystemExit as end:
        status = end.code
    except KeyboardInterrupt:
        status = 130
    except Exception as error:
        if "--debug" in sys.argv:
            raise
        print(f"lupin: {type(error).__name__}: {error}", file=sys.stderr)
        print("lupin: this is a defect; the whole stack: lupin --debug ...", file=sys.stderr)
        status = 70
    _end(status)


def _end(status: object) -> NoReturn:
    """End at once: with the exit functions, without the 30 ms in which Python takes its modules apart, or a wait for a thread
    that nobody needs any more."""
    if not isinstance(status, int | None):
        sys.exit(status)  # type: ignore[arg-type]  # a word to print, as sys.exit takes it
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # whoever read it is gone, or it is closed
            stream.flush()
    os._exit(status or 0)


if __name__ == "__main__":
    main()
