"""`lupin console`: serve a graph to browsers and rosbridge clients; show pairing codes and the paired browsers."""

from __future__ import annotations

import json
import sys
import time
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.command_group import command_group
from lupin_cli.commands.console_certificate import certificate
from lupin_cli.commands.console_voice import voice
from lupin_cli.exit_codes import FAILURE, UNREACHABLE, USAGE_ERROR
from lupin_cli.run.run_option import LIVE_RUN
from lupin_cli.terminal import echo
from lupin_runtime.ports import CONSOLE_PORT, ROSBRIDGE_PORT

if TYPE_CHECKING:
    from pathlib import Path

    from lupin_runtime.console.description import ConsoleDescription
    from lupin_runtime.console.sessions import Sessions

UP_TIMEOUT_S = 30.0
AS_JSON = typer.Option(False, "--json", help="Print only JSON on standard output.")
app = command_group(
    """Serve the graph of the live run, or of this shell, to browsers until Ctrl-C; list and revoke paired browsers.

    If the port of rosbridge is in use, the page is served without it.

    Exit status: 0 stopped, 1 the console failed, 2 the page's port is in use, 3 no such run.
    """,
    "lupin console",
    invoke_without_command=True,
)
app.command()(certificate)
app.add_typer(voice, name="voice")


@app.callback()
def serve(
    context: typer.Context,
    run: LIVE_RUN = None,
    host: str = typer.Option("", help="Listen on this address [all of this computer's]."),
    tls: bool = typer.Option(True, "--tls/--no-tls", help="Use HTTPS for browsers on other computers."),
    port: int = typer.Option(CONSOLE_PORT, min=0, max=65535, help="Serve the page on this port; 0: any free one."),
    rosbridge_port: int = typer.Option(
        ROSBRIDGE_PORT, min=0, max=65535, help="Serve rosbridge on this port of localhost, if it is free; 0: any free one."
    ),
    share: bool = typer.Option(False, "--share", help="Print the code that pairs a viewer, who can only watch and stop."),
    dev: bool = typer.Option(False, "--dev", help="Also serve the page from its sources in this checkout, with hot reload."),
) -> None:
    """Serve until Ctrl-C."""
    if context.invoked_subcommand is not None:
        return
    from lupin_cli.run.console_access import access_banner
    from lupin_cli.run.foreground import graph_of, start_in_foreground
    from lupin_cli.run.page_server import PageServer, PageServerFailed
    from lupin_runtime.console.ports import PortInUse, check_free
    from lupin_runtime.mission.overrides import OVERRIDES_NAME
    from lupin_runtime.stack.options import Options
    from lupin_runtime.stack.runs import RunError
    from lupin_runtime.stack.table import TABLE, launch

    try:
        check_free(host, port)
        joined = graph_of(run)
    except RunError as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    except PortInUse as error:
        echo(f"{error}; choose another with --port, or see the run's console with: lupin console code", err=True)
        raise typer.Exit(USAGE_ERROR) from error
    except OSError as error:
        raise typer.BadParameter(f"cannot listen on {host}: {error.strerror}", param_hint="--host") from error
    environment, folder = joined.environment, joined.folder
    console_folder = folder / "console-foreground"
    console_folder.mkdir(mode=0o700, exist_ok=True)
    console = launch(next(row for row in TABLE if row.name == "console"), Options(run_path=console_folder))
    assert console.config is not None
    console.config["nodes"][0]["parameters"].update(
        host=host, port=port, rosbridge_port=rosbridge_port, tls=tls, overrides_file=str(folder / OVERRIDES_NAME)
    )
    child = start_in_foreground(console, environment, console_folder)
    page_server: PageServer | None = None
    try:
        description = _wait_for(console_folder, child)
        if description is not None:
            from rich.text import Text

            from lupin_cli.safe_console import SafeConsole

            banner = access_banner(description, environment, sys.stdout, share=share)
            SafeConsole().print(Text.from_ansi(banner), soft_wrap=True)
            sys.stdout.flush()
        if dev and description is not None:
            echo("starting the page's server", err=True)
            page_server = PageServer(f"http://127.0.0.1:{description.port}")
            echo(f"the page with hot reload: {page_server.url}")
            sys.stdout.flush()
        status = child.wait()
    except KeyboardInterrupt:
        status = child.wait()
    except PageServerFailed as error:
        echo(str(error), err=True)
        child.terminate()
        child.wait()
        raise typer.Exit(FAILURE) from error
    finally:
        if page_server is not None:
            page_server.stop()
    raise typer.Exit(FAILURE if status not in (0, 130) else 0)


def _wait_for(folder: Path, child: Any) -> ConsoleDescription | None:
    """Return the console's description once it listens; None if its process exits first, or takes too long."""
    from lupin_runtime.console.description import read_description

    deadline_s = time.monotonic() + UP_TIMEOUT_S
    while child.poll() is None and time.monotonic() < deadline_s:
        description = read_description(folder)
        if description is not None and description.pid == child.pid:
            return description
        time.sleep(0.05)
    return None


@app.command()
def code(run: LIVE_RUN = None, as_json: bool = AS_JSON) -> None:
    """Show where the console is, and the codes that pair one browser each.

    Exit status: 0 shown, 3 no console is running.

    Example: lupin console code
    """
    from lupin_runtime.console.description import read_description, spoken
    from lupin_runtime.stack.runs import RunError, find_live_run

    try:
        folder = find_live_run(run).path
    except RunError as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    description = read_description(folder) or read_description(folder / "console-foreground")
    if description is None:
        echo("this run has no console; start one with: lupin console", err=True)
        raise typer.Exit(UNREACHABLE)
    if as_json:
        print(json.dumps({"url": description.url, "rosbridge_port": description.rosbridge_port, "codes": description.codes}))
        return
    for url in (description.url, *description.network_urls()):
        echo(url)
    for role, each in description.codes.items():
        echo(f"{spoken(each)} pairs one browser as {role}")


@app.command()
def sessions(as_json: bool = AS_JSON) -> None:
    """List the paired browsers, the most recently used first. Changes nothing.

    Exit status: 0 listed, 2 their file is damaged.

    Example: lupin console sessions
    """
    paired = _sessions().all()
    if as_json:
        rows = [{"name": p.name, "role": p.role.value, "paired_s": p.paired_s, "used_s": p.used_s} for p in paired]
        print(json.dumps(rows))
        return
    for browser in paired:
        used = time.strftime("%Y-%m-%d %H:%M", time.localtime(browser.used_s))
        echo(f"{browser.name:14s} {browser.role.value:9s} used {used}")
    echo(
        "revoke one with: lupin console revoke NAME" if paired else "no browser is paired; show a code with: lupin console code"
    )


@app.command()
def revoke(
    name: str = typer.Argument(None, help="The browser's name, as `lupin console sessions` shows it."),
    everyone: bool = typer.Option(False, "--all", help="Revoke all browsers."),
    dry_run: bool = typer.Option(False, "--dry-run", help="Show what would be revoked; change nothing."),
) -> None:
    """Forget a paired browser; it is disconnected at once and needs a new code.

    Exit status: 0 done, 2 no such browser.

    Example: lupin console revoke --all
    """
    stored = _sessions()
    names = [pairing.name for pairing in stored.all()]
    chosen = names if everyone else [each for each in names if each == name]
    if (name is None) != everyone or (not chosen and not everyone):
        echo(f"name one of the paired browsers, or type --all: {', '.join(names) or 'none is paired'}", err=True)
        raise typer.Exit(USAGE_ERROR)
    for each in chosen:
        if not dry_run:
            stored.revoke(each)
        echo(f"{'would revoke' if dry_run else 'revoked'} {each}")


def _sessions() -> Sessions:
    from lupin_runtime.atomic_file import MalformedFile
    from lupin_runtime.console.sessions import Sessions, sessions_file

    try:
        return Sessions(sessions_file())
    except MalformedFile as error:
        echo(str(error), err=True)
        raise typer.Exit(USAGE_ERROR) from error
