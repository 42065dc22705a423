"""`lupin replay`: a recorded run again, on a graph or as a page."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from rich.progress import Progress

    from lupin_runtime.record.reader import Recording, Summary
    from lupin_runtime.record.runs import RunFiles

STOP_GRACE_S = 5.0


def command(
    run: str = typer.Argument("latest", help="A recording, a run directory, a run's id or its beginning, or: latest."),
    rate: float = typer.Option(1.0, "--rate", "-r", help="Times the recorded pace."),
    loop: bool = typer.Option(False, "--loop", help="Start again at the end, until you interrupt."),
    topics: str = typer.Option("", "--topics", help="Comma-separated names; all without this."),
    wait: float = typer.Option(0.0, "--wait", min=0.0, max=600.0, help="Wait this many seconds for listeners first."),
    page: bool = typer.Option(False, "--page", help="The report's page instead, with a time slider; built if need be."),
    info: bool = typer.Option(False, "--info", help="Only say what is recorded."),
    as_json: bool = typer.Option(False, "--json", help="With --info: print JSON, alone on standard output."),
) -> None:
    """Look at a recorded run again: publish it onto a private graph on this machine, which others can join.

    Exit status: 0 played to the end, 1 the file can't be read, 2 usage, 130 interrupted.
    """
    if not 0.0 < rate < float("inf"):
        typer.echo(f"--rate {rate} is no pace; expected a positive number, such as --rate 5", err=True)
        raise typer.Exit(2)
    if as_json and not info:
        typer.echo("--json goes with --info: lupin replay --info --json", err=True)
        raise typer.Exit(2)
    found, recordings = open_run(run)
    if page:
        _page(run, found)
        return
    summaries = [recording.summary() for recording in recordings]
    if info:
        _info(summaries, as_json)
        return
    for summary in summaries:
        for damage in summary.damage:
            typer.echo(f"{summary.path.name}: {damage}", err=True)
    wanted = {name.strip() for name in topics.split(",") if name.strip()}
    recorded = {topic.channel.topic for summary in summaries for topic in summary.topics}
    if missing := sorted(wanted - recorded):
        typer.echo(f"not recorded: {', '.join(missing)}; see what is: lupin replay {run} --info", err=True)
        raise typer.Exit(2)
    options = ["--rate", str(rate), "--topics", topics, "--wait-s", str(wait), *(["--loop"] if loop else [])]
    raise typer.Exit(_play([recording.path for recording in recordings], options, rate))


def open_run(name: str) -> tuple[RunFiles, list[Recording]]:
    """The run that `name` means, with its recordings open; ends the command with a sentence where there is none."""
    from lupin_runtime.record.reader import NotARecording
    from lupin_runtime.record.runs import RunNotFound, find_run

    try:
        found = find_run(name)
        return found, found.open()
    except RunNotFound as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(2) from error
    except NotARecording as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(1) from error


def _page(name: str, found: RunFiles) -> None:
    from lupin_cli.commands.report import build, show

    page = found.report_folder / "report.html"
    if not page.exists():
        page = build(name, None).page
    typer.echo(str(page))
    show(page)


def _info(summaries: list[Summary], as_json: bool) -> None:
    if as_json:
        print(json.dumps([_plain(summary) for summary in summaries]))
        return
    from rich.console import Console
    from rich.table import Table

    console = Console()
    for summary in summaries:
        title = f"{summary.path}  {summary.duration_s:.1f} s, {summary.messages} messages, {summary.size_bytes / 1e6:.1f} MB"
        console.print(title, highlight=False, style="bold", soft_wrap=True)
        for damage in summary.damage:
            console.print(f"  {damage}", style="yellow", markup=False)
        table = Table("Topic", "Type", "Messages", "Hz", "kB/s", box=None, pad_edge=False)
        for column in table.columns[2:]:
            column.justify = "right"
        for topic in summary.topics:
            over_s = max(summary.duration_s, 1e-9)
            numbers = (f"{topic.messages}", f"{topic.messages / over_s:.1f}", f"{topic.bytes / over_s / 1e3:.1f}")
            table.add_row(topic.channel.topic, topic.channel.type, *numbers)
        console.print(table)


def _plain(summary: Summary) -> dict[str, Any]:
    return {
        "path": str(summary.path),
        "size_bytes": summary.size_bytes,
        "start_ns": summary.start_ns,
        "end_ns": summary.end_ns,
        "duration_s": summary.duration_s,
        "messages": summary.messages,
        "metadata": summary.metadata,
        "damage": summary.damage,
        "topics": [
            {"topic": t.channel.topic, "type": t.channel.type, "messages": t.messages, "bytes": t.bytes} for t in summary.topics
        ],
    }


def _play(files: list[Path], options: list[str], rate: float) -> int:
    """Run the player in a domain of its own and show how far it is; returns its exit status."""
    # Imported before there is anything to interrupt: CPython dies of a SIGINT that lands in code that is executed as a
    # string, as the making of a dataclass is, even where the KeyboardInterrupt is caught.
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    from lupin_runtime.stack.dds import NoFreeDomain, claim_domain, loopback_environment

    try:
        claim = claim_domain()
    except NoFreeDomain as error:
        typer.echo(str(error), err=True)
        return 1
    with tempfile.TemporaryDirectory(prefix="lupin-replay-") as folder:
        environment = loopback_environment(claim.domain, Path(folder))
        names = ("ROS_DOMAIN_ID", "RMW_IMPLEMENTATION", "FASTRTPS_DEFAULT_PROFILES_FILE")
        typer.echo("join it in another terminal with:")
        typer.echo(f"  export {' '.join(f'{name}={environment[name]}' for name in names)}")
        command = [sys.executable, "-m", "lupin_runtime.record.player", *map(str, files), *options, "--end-with-parent"]
        # An interrupt inside Popen would leave a player that nobody holds: it is noted, and acted on once it is held.
        noted: list[int] = []
        interrupt = signal.signal(signal.SIGINT, lambda number, _: noted.append(number))
        try:
            player = subprocess.Popen(
                command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
            )
        except BaseException:
            signal.signal(signal.SIGINT, interrupt)
            claim.release()
            raise
        try:
            signal.signal(signal.SIGINT, interrupt)
            if noted:
                return 130
            columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[messages]} messages"))
            with Progress(*columns, console=Console(stderr=True), transient=False) as progress:
                _show_progress(progress, _lines(player), rate)
            return player.wait(STOP_GRACE_S)
        except KeyboardInterrupt:
            return 130
        finally:
            _end(player)
            claim.release()


def _lines(player: subprocess.Popen[str]) -> Iterator[dict[str, Any]]:
    assert player.stdout is not None
    for line in player.stdout:
        yield json.loads(line)


def _show_progress(progress: Progress, lines: Iterator[dict[str, Any]], rate: float) -> None:
    task = progress.add_task("waiting", total=None, messages=0)
    for line in lines:
        description = f"{_clock(line['at_s'])} of {_clock(line['of_s'])}" + (f"  ×{rate:g}" if rate != 1.0 else "")
        progress.update(
            task,
            total=max(line["of_s"], 1e-9),
            completed=line["at_s"],
            description=description,
            messages=line["published"],
        )


def _end(player: subprocess.Popen[str]) -> None:
    """The end of its input tells the player to stop; what does not, is killed."""
    for pipe in (player.stdin, player.stdout):
        if pipe is not None:
            pipe.close()
    try:
        player.wait(STOP_GRACE_S)
    except subprocess.TimeoutExpired:
        player.kill()
        player.wait(STOP_GRACE_S)


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


def has_display() -> bool:
    """Whether this terminal's person has a screen on which a browser can open."""
    if not sys.stdout.isatty():
        return False
    return sys.platform == "darwin" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
