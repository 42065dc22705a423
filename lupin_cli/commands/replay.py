"""`lupin replay`: publish a recorded run onto a private graph, or show its report."""

from __future__ import annotations

import json
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.completion import runs
from lupin_cli.exit_codes import FAILURE, INTERRUPTED, USAGE_ERROR
from lupin_cli.run.recordings import RUN_HELP, build_run_report, open_run, show_page
from lupin_cli.terminal import echo, minutes
from lupin_runtime.interpreter import PYTHON
from lupin_runtime.json_text import parse_json

if TYPE_CHECKING:
    from rich.progress import Progress

    from lupin_runtime.record.reader import Summary
    from lupin_runtime.record.runs import RecordedRun

STOP_GRACE_S = 5.0


def command(
    run: str = typer.Argument("latest", help=RUN_HELP, autocompletion=runs),
    rate: float = typer.Option(1.0, "--rate", "-r", help="Play at this speed relative to the recording."),
    loop: bool = typer.Option(False, "--loop", help="Repeat until interrupted."),
    topics: str = typer.Option("", "--topics", help="Play only these comma-separated topics; without it, all."),
    wait: float = typer.Option(0.0, "--wait", min=0.0, max=600.0, help="First wait up to this many seconds for subscribers."),
    page: bool = typer.Option(False, "--page", help="Show the report, which has a time slider; build it if missing."),
    info: bool = typer.Option(False, "--info", help="Only list what is recorded."),
    as_json: bool = typer.Option(False, "--json", help="With --info: print only JSON on standard output."),
) -> None:
    """Publish a recorded run onto a private graph on this machine, which other terminals can join.

    Exit status: 0 played to the end, 1 the file cannot be read, 2 usage, 130 interrupted.

    Example: lupin replay latest --rate 5
    """
    if not 0.0 < rate < float("inf"):
        echo(f"--rate {rate} is not a valid speed; type a positive number, such as --rate 5", err=True)
        raise typer.Exit(USAGE_ERROR)
    if as_json and not info:
        echo("--json needs --info; type: lupin replay --info --json", err=True)
        raise typer.Exit(USAGE_ERROR)
    found, recordings = open_run(run)
    if page:
        _show_report(run, found)
        return
    summaries = [recording.summary() for recording in recordings]
    if info:
        _info(summaries, as_json)
        return
    for summary in summaries:
        for damage in summary.damage:
            echo(f"{summary.path.name}: {damage}", err=True)
    wanted = {name.strip() for name in topics.split(",") if name.strip()}
    recorded = {topic.channel.topic for summary in summaries for topic in summary.topics}
    if missing := sorted(wanted - recorded):
        echo(f"not recorded: {', '.join(missing)}; list what is with: lupin replay {run} --info", err=True)
        raise typer.Exit(USAGE_ERROR)
    options = ["--rate", str(rate), "--topics", topics, "--wait-s", str(wait), *(["--loop"] if loop else [])]
    raise typer.Exit(_play([recording.path for recording in recordings], options, rate))


def _show_report(name: str, run: RecordedRun) -> None:
    page = run.report_folder / "report.html"
    if not page.exists():
        page = build_run_report(name, None).page
    echo(str(page))
    show_page(page)


def _info(summaries: list[Summary], as_json: bool) -> None:
    if as_json:
        print(json.dumps([_summary_json(summary) for summary in summaries]))
        return
    from rich.table import Table

    from lupin_cli.safe_console import SafeConsole

    console = SafeConsole()
    for summary in summaries:
        title = f"{summary.path}  {summary.duration_s:.1f} s, {summary.messages} messages, {summary.size_bytes / 1e6:.1f} MB"
        console.print(title, style="bold", soft_wrap=True)
        for damage in summary.damage:
            console.print(f"  {damage}", style="yellow")
        table = Table("Topic", "Type", "Messages", "Hz", "kB/s", box=None, pad_edge=False)
        for column in table.columns[2:]:
            column.justify = "right"
        for topic in summary.topics:
            duration_s = max(summary.duration_s, 1e-9)
            numbers = (f"{topic.messages}", f"{topic.messages / duration_s:.1f}", f"{topic.bytes / duration_s / 1e3:.1f}")
            table.add_row(topic.channel.topic, topic.channel.type, *numbers)
        console.print(table)


def _summary_json(summary: Summary) -> dict[str, Any]:
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
    """Run the player in its own DDS domain and show its progress; return its exit status."""
    # Imported first, while there is nothing to interrupt: a SIGINT during code that is executed from a string, such as a
    # dataclass definition, terminates CPython even if KeyboardInterrupt is caught.
    from rich.progress import BarColumn, Progress, TextColumn

    from lupin_cli.safe_console import SafeConsole
    from lupin_runtime.stack.dds import NoFreeDomain, claim_domain, loopback_environment

    try:
        claim = claim_domain()
    except NoFreeDomain as error:
        echo(str(error), err=True)
        return FAILURE
    with tempfile.TemporaryDirectory(prefix="lupin-replay-") as folder:
        environment = loopback_environment(claim.domain, Path(folder))
        names = ("ROS_DOMAIN_ID", "RMW_IMPLEMENTATION", "FASTRTPS_DEFAULT_PROFILES_FILE")
        echo("to join it, type in another terminal:")
        echo(f"  export {' '.join(f'{name}={environment[name]}' for name in names)}")
        command = [*PYTHON, "-m", "lupin_runtime.record.player", *map(str, files), *options, "--end-with-parent"]
        # An interrupt inside Popen would leave a player without an owner: it is handled once Popen has returned.
        interrupts: list[int] = []
        default_handler = signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))
        try:
            player = subprocess.Popen(
                command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
            )
        except BaseException:
            signal.signal(signal.SIGINT, default_handler)
            claim.release()
            raise
        try:
            signal.signal(signal.SIGINT, default_handler)
            if interrupts:
                return INTERRUPTED
            columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[messages]} messages"))
            with Progress(*columns, console=SafeConsole(stderr=True), transient=False) as progress:
                _show_progress(progress, _progress_lines(player), rate)
            return player.wait(STOP_GRACE_S)
        except KeyboardInterrupt:
            return INTERRUPTED
        finally:
            _stop(player)
            claim.release()


def _progress_lines(player: subprocess.Popen[str]) -> Iterator[dict[str, Any]]:
    assert player.stdout is not None
    for line in player.stdout:
        yield parse_json(line)


def _show_progress(progress: Progress, lines: Iterator[dict[str, Any]], rate: float) -> None:
    task = progress.add_task("waiting", total=None, messages=0)
    for line in lines:
        description = f"{minutes(line['at_s'])} of {minutes(line['of_s'])}" + (f"  ×{rate:g}" if rate != 1.0 else "")
        progress.update(
            task,
            total=max(line["of_s"], 1e-9),
            completed=line["at_s"],
            description=description,
            messages=line["published"],
        )


def _stop(player: subprocess.Popen[str]) -> None:
    """Stop the player by closing its input; kill it after STOP_GRACE_S."""
    for pipe in (player.stdin, player.stdout):
        if pipe is not None:
            pipe.close()
    try:
        player.wait(STOP_GRACE_S)
    except subprocess.TimeoutExpired:
        player.kill()
        player.wait(STOP_GRACE_S)
