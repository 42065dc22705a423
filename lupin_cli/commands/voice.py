"""`lupin voice`: command the robot by spoken or typed sentences, without a network."""

from __future__ import annotations

import getpass
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lupin_cli.exit_codes import FAILURE, UNREACHABLE, USAGE_ERROR
from lupin_cli.run.run_option import LIVE_RUN
from lupin_cli.terminal import confirm, echo, is_interactive

if TYPE_CHECKING:
    from lupin_cli.run.known_consoles import ConsoleAddress
    from lupin_cli.run.voice_connection import Console

_MAX_CODE = 200  # bytes that are read


def command(
    sentence: Annotated[str | None, typer.Argument(help="Do this one sentence, and end.", metavar="[SENTENCE]")] = None,
    text: Annotated[bool, typer.Option("--text", help="Type sentences instead of speaking them.")] = False,
    wav: Annotated[Path | None, typer.Option("--wav", help="Take what is said in this WAV file.")] = None,
    language: Annotated[str, typer.Option("--language", help="Understand typed sentences in this language: en or nl.")] = "en",
    speech: Annotated[bool, typer.Option("--speech/--no-speech", help="Speak the answers to spoken sentences.")] = True,
    run: LIVE_RUN = None,
    console: Annotated[
        str, typer.Option("--console", metavar="HOST[:PORT]", help="Use the console there [that of the live run].")
    ] = "",
    code: Annotated[
        str, typer.Option("--code", help="Pair with the code that the console shows; -: read it from standard input.")
    ] = "",
    accept: Annotated[str, typer.Option("--accept", help="Trust the console whose authority has this SHA-256.")] = "",
    forget: Annotated[bool, typer.Option("--forget", help="Forget the console's authority and the pairing, and end.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show the calls; send nothing.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for each sentence, on a line.")] = False,
) -> None:
    """Command the robot by spoken or typed sentences; everything runs on this computer, without the internet.

    Each sentence becomes one call of a tool, which the console checks. What moves the robot, except short bursts, is read back
    and waits for yes or no; so does what only may have been meant, or ends with a question mark. What is not understood is
    asked again. Stop, halt and nee engage the e-stop at once.

    The console of another computer is paired once, with a code that `lupin console code` shows there.

    Exit status: 0 done, 1 the last sentence was not understood, not confirmed or refused, 2 a wrong option or file, or this
    computer lacks what speech needs, 3 no console, none that is trusted, or none that lets this computer in.

    Example: lupin voice --text "lights blue"
    """
    from lupin_cli.run.voice_connection import ConnectionLost
    from lupin_cli.run.voice_session import Options, find_console, run_session
    from lupin_runtime.atomic_file import MalformedFile
    from lupin_runtime.stack.runs import RunError
    from lupin_runtime.voice.languages import LANGUAGES
    from lupin_runtime.voice.sounds import BadSound
    from lupin_runtime.voice.speech import SpeechUnavailable

    address = _address(console, needs_pairing=bool(code or accept or forget))
    if language not in LANGUAGES:
        raise typer.BadParameter(f"{language!r} is not one of {', '.join(LANGUAGES)}", param_hint="--language")
    if wav is not None and (text or sentence is not None):
        raise typer.BadParameter("give either a sound or a sentence", param_hint="--wav")
    if forget and address is not None:
        _forget(address, dry_run=dry_run)
        return
    try:
        found: Console | None = None
        if not dry_run:
            found = find_console(run) if address is None else _reach(address, code, accept)
        options = Options(
            sentence=sentence,
            is_typed=text or sentence is not None,
            wav=wav,
            language=LANGUAGES[language],
            speaks=speech and not as_json,
            as_json=as_json,
            console=found,
        )
        is_done = run_session(options)
    except (RunError, ConnectionLost) as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    except (SpeechUnavailable, BadSound, MalformedFile) as error:
        echo(str(error), err=True)
        raise typer.Exit(USAGE_ERROR) from error
    except OSError as error:
        echo(f"cannot read {wav}: {error.strerror or error}", err=True)
        raise typer.Exit(USAGE_ERROR) from error
    raise typer.Exit(0 if is_done else FAILURE)


def _address(console: str, *, needs_pairing: bool) -> ConsoleAddress | None:
    """Return what --console names; None without it. Raises BadParameter."""
    from lupin_cli.run.known_consoles import BadAddress, parse_address

    try:
        address = parse_address(console) if console else None
    except BadAddress as error:
        raise typer.BadParameter(str(error), param_hint="--console") from error
    if needs_pairing and (address is None or address.is_of_this_computer):
        raise typer.BadParameter(
            "only the console of another computer is paired; name it with --console", param_hint="--code, --accept, --forget"
        )
    return address


def _reach(address: ConsoleAddress, code: str, accept: str) -> Console:
    from lupin_cli.run.console_pairing import Consent, reach_console
    from lupin_cli.run.known_consoles import console_file
    from lupin_cli.run.voice_connection import ConnectionLost, Console

    if address.is_of_this_computer:
        return Console(address.url("http"))
    if code == "-":
        code = _read_line(sys.stdin.fileno())
        if not code:
            raise typer.BadParameter("standard input has no code", param_hint="--code")
    asks = is_interactive()
    ask_code = (lambda: getpass.getpass(f"Code of {address}: ").strip()) if asks else None
    try:
        return reach_console(address, Consent(code.strip(), accept, confirm if asks else None, ask_code))
    except ConnectionLost:
        raise
    except OSError as error:
        echo(f"the pairing cannot be kept in {error.filename or console_file(address)}: {error.strerror or error}", err=True)
        raise typer.Exit(USAGE_ERROR) from error


def _read_line(descriptor: int) -> str:
    """Read one line, and nothing of what follows: those are sentences."""
    line = b""
    while len(line) < _MAX_CODE and (byte := os.read(descriptor, 1)) not in (b"", b"\n"):
        line += byte
    return line.decode(errors="replace").strip()


def _forget(address: ConsoleAddress, *, dry_run: bool) -> None:
    from lupin_cli.run.known_consoles import console_file, forget_known

    path = console_file(address)
    try:
        existed = path.exists() if dry_run else forget_known(address)
    except OSError as error:
        echo(f"{path} cannot be deleted: {error.strerror}", err=True)
        raise typer.Exit(USAGE_ERROR) from error
    if not existed:
        echo(f"nothing to forget: {address} is not known")
    else:
        echo(f"would delete {path}" if dry_run else f"{address} is forgotten; there, revoke it with: lupin console revoke NAME")
