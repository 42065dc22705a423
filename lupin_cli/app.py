"""The `lupin` command. A command's module is imported only when it runs, so that `lupin --help` stays fast."""

from __future__ import annotations

import importlib
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from typing import Any

import typer
from typer.core import TyperGroup

from lupin_cli import __version__
from lupin_cli.completion import matching
from lupin_cli.exit_codes import FAILURE, INTERNAL_ERROR, INTERRUPTED
from lupin_cli.json_errors import errors_as_objects
from lupin_cli.printed_commands import lupin, print_next
from lupin_cli.terminal import echo, is_interrupt, printable
from lupin_runtime.ending import STUCK

# verb: (section, one line of help). The module is lupin_cli.commands.<verb>, with dashes as underscores.
COMMANDS: dict[str, tuple[str, str]] = {
    "up": ("Run", "Start the stack; with --mission, explore, read every tag and report."),
    "status": ("Run", "Show the processes and the mission of a run, or how the last run ended."),
    "logs": ("Run", "Show the logs of a run's processes, merged by time."),
    "env": ("Run", "Print what a shell evaluates to join the graph of a run."),
    "down": ("Run", "Stop a run and everything that it started."),
    "runs": ("Run", "List the past runs with result, world and duration; keep and remove runs."),
    "run": ("Run", "Run one process of the stack in the foreground."),
    "console": ("Run", "Serve a running graph to browsers; their codes, sessions and the certificate."),
    "voice": ("Run", "Command the robot by spoken or typed sentences, without a network."),
    "teleop": ("Run", "Drive by the keys of this terminal; test and calibrate the gamepads of this computer."),
    "mission": ("Mission", "Start, pause, resume or abort a mission; draw its state machine."),
    "deploy": ("Robot", "Install Lupin on a robot, or set up this machine for it."),
    "onboard": ("Robot", "Show what a robot does by itself: its units, processes and devices."),
    "doctor": ("Robot", "Diagnose robot, laptop and link; show each root cause, its evidence and its fix."),
    "wait": ("Robot", "Wait until a robot is healthy, free or reachable."),
    "robots": ("Robot", "List, add, remove, rename and check the robots of the inventory."),
    "dds": ("Robot", "Set up, check or remove this machine's access to the robot's ROS graph."),
    "transport": ("Robot", "Show and measure the link to the robot; switch its transport."),
    "home": ("Robot", "Activate the controllers and move the arm to its home pose."),
    "play": ("Robot", "Run a playbook; preview, resume or undo it."),
    "journal": ("Robot", "Show earlier playbook runs: their steps, changes and outputs."),
    "sync-clock": ("Robot", "Measure the robot's clock; set it while its stack is stopped."),
    "sweep": ("Robot", "Terminate stale ROS processes and remove shared memory that no process uses."),
    "bundle": ("Robot", "Pack facts, findings and logs into one archive for support, with secrets masked."),
    "sim": ("Simulator", "List simulated worlds, render pictures, press the e-stop, boot a simulated computer."),
    "replay": ("Results", "Play back a recorded run."),
    "report": ("Results", "Build the report of a recorded run."),
    "foxglove": ("Tools", "Write the layout for Foxglove and Lichtblick."),
    "map": ("Tools", "Build and optimize maps and plan paths on them, without a robot."),
    "tags": ("Tools", "Find AprilTags in images."),
    "completion": ("Tools", "Print the script by which bash, zsh or fish completes the words of lupin."),
}


@contextmanager
def _printable_errors() -> Iterator[None]:
    """Take control characters out of usage errors, which Typer prints itself: they quote words of the command line."""
    try:
        yield
    except Exception as error:
        if isinstance(message := getattr(error, "message", None), str):  # of click's exceptions, which have no public name
            error.message = printable(message)  # type: ignore[attr-defined]
        raise


class LazyGroup(TyperGroup):
    """Takes the commands' names and help from the table, and imports a command only when it is called."""

    # Any: Typer bundles click privately, so the types of contexts, commands and formatters have no public name.

    def main(self, args: Any = None, *more: Any, **options: Any) -> Any:
        """Run the command; with --json, an error is an object on standard output, too."""
        if "_LUPIN_COMPLETE" in os.environ:  # a shell asks for completions
            from typer._completion_classes import completion_init

            completion_init()
        words = sys.argv[1:] if args is None else list(args)
        with errors_as_objects() if "--json" in words else nullcontext():
            return super().main(args, *more, **options)

    def make_context(self, *words: Any, **options: Any) -> Any:
        """Parse the words of `lupin` itself; see `_printable_errors`."""
        with _printable_errors():
            return super().make_context(*words, **options)

    def invoke(self, ctx: Any) -> Any:
        """Parse the words of a command, and run it; see `_printable_errors`."""
        with _printable_errors():
            return super().invoke(ctx)

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:  # noqa: ARG002 -- click's signature
        """Complete the names of commands from the table, without importing the commands."""
        from typer._click.shell_completion import CompletionItem

        return [CompletionItem(verb) for verb in matching(COMMANDS, incomplete)]

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002 -- click's signature
        """Return the names of all commands."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002 -- click's signature
        """Import and return a command; None if there is no such command."""
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

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002 -- click's signature
        """Write the commands into the help, by section."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for verb, (section, text) in COMMANDS.items():
            sections.setdefault(section, []).append((verb, text))
        for section, rows in sections.items():
            with formatter.section(section):
                formatter.write_dl(rows)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command of `args`; for an unknown one, name the nearest in the table."""
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
        echo(f"lupin {__version__}")
        raise typer.Exit()


@app.callback(help="Lupin: operator's toolkit and runtime of a MIRTE Master greenhouse robot.\n\nExample: lupin up --mission")
def root(
    version: bool = typer.Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
    ),
    debug: bool = typer.Option(False, "--debug", help="Show the stack trace of an unexpected error."),
) -> None:
    """Options of `lupin` itself."""


def _use_utf8() -> None:
    """Restart Python in its UTF-8 mode (PEP 540) if the locale has another encoding.

    Playbooks, journals and file names are UTF-8 whatever the locale. A terminal shows characters it lacks by their numbers.
    """
    if sys.getfilesystemencoding() != "utf-8" and "PYTHONUTF8" not in os.environ:
        os.environ["PYTHONUTF8"] = "1"
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])  # noqa: S606 -- this very command again
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def main() -> None:
    """Run `lupin`. An expected error prints one line and the next command; an unexpected one names --debug."""
    _use_utf8()
    try:
        with errors_as_objects() if "--json" in sys.argv else nullcontext():
            _run()
    except SystemExit as ended:
        if STUCK.is_set():
            _flush_output()
            os._exit(ended.code if isinstance(ended.code, int) else FAILURE)
        raise
    finally:
        _flush_output()


def _run() -> None:
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except Exception as error:  # the last resort of every command
        if is_interrupt(error):
            sys.exit(INTERRUPTED)
        if "--debug" in sys.argv:
            raise
        sys.exit(_report(error))


def _report(error: Exception) -> int:
    """Print an error that no command handled; return the exit code."""
    from lupin_cli.connection.base import TargetError
    from lupin_cli.connection.options import exit_code_of, print_error

    if isinstance(error, TargetError):
        print_error(sys.argv[1], error)
        return exit_code_of(error)
    if isinstance(error, OSError):  # the disk is full, a file may not be written: not Lupin's defect
        echo(f"lupin: {error}", err=True)
    else:
        echo(f"lupin: {type(error).__name__}: {error}", err=True)
        echo("lupin: this is a defect of Lupin", err=True)
    print_next(lupin("--debug", *sys.argv[1:]), "for the stack trace")
    return INTERNAL_ERROR


def _flush_output() -> None:
    """Flush both streams. If the reader of one is gone, drop its text: the interpreter would report a broken pipe at exit."""
    for stream in filter(None, (sys.stdout, sys.stderr)):  # None: the descriptor was closed before Python started
        try:
            stream.flush()
        except (OSError, ValueError):  # ValueError: the stream is closed
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


if __name__ == "__main__":
    main()
