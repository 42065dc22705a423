"""`lupin voice`: command the robot by spoken or typed sentences, without a network."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lupin_cli.exit_codes import FAILURE, UNREACHABLE, USAGE_ERROR
from lupin_cli.run.run_option import LIVE_RUN
from lupin_cli.terminal import echo


def command(
    sentence: Annotated[str | None, typer.Argument(help="Do this one sentence, and end.", metavar="[SENTENCE]")] = None,
    text: Annotated[bool, typer.Option("--text", help="Type sentences instead of speaking them.")] = False,
    wav: Annotated[Path | None, typer.Option("--wav", help="Take what is said in this WAV file.")] = None,
    language: Annotated[str, typer.Option("--language", help="Understand typed sentences in this language: en or nl.")] = "en",
    speech: Annotated[bool, typer.Option("--speech/--no-speech", help="Speak the answers to spoken sentences.")] = True,
    run: LIVE_RUN = None,
    url: Annotated[str, typer.Option("--url", help="Use the console at this address [that of the live run].")] = "",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show the calls; send nothing.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for each sentence, on a line.")] = False,
) -> None:
    """Command the robot by spoken or typed sentences; everything runs on this computer, without a network.

    Each sentence becomes one call of a tool, which the console checks. What moves the robot, except short bursts, is read back
    and waits for yes or no. What is not understood is asked again. Stop, halt and nee engage the e-stop at once.

    Exit status: 0 done, 1 the last sentence was not understood, not confirmed or refused, 2 a wrong option or file, or this
    computer lacks what speech needs, 3 no console.

    Example: lupin voice --text "lights blue"
    """
    from lupin_cli.run.voice_connection import ConnectionLost
    from lupin_cli.run.voice_session import Options, find_console, run_session
    from lupin_runtime.stack.runs import RunError
    from lupin_runtime.voice.languages import LANGUAGES
    from lupin_runtime.voice.sounds import BadSound
    from lupin_runtime.voice.speech import SpeechUnavailable

    if language not in LANGUAGES:
        raise typer.BadParameter(f"{language!r} is not one of {', '.join(LANGUAGES)}", param_hint="--language")
    if wav is not None and (text or sentence is not None):
        raise typer.BadParameter("give either a sound or a sentence", param_hint="--wav")
    try:
        options = Options(
            sentence=sentence,
            is_typed=text or sentence is not None,
            wav=wav,
            language=LANGUAGES[language],
            speaks=speech and not as_json,
            as_json=as_json,
            url=None if dry_run else url or find_console(run),
        )
        is_done = run_session(options)
    except (RunError, ConnectionLost) as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    except (SpeechUnavailable, BadSound) as error:
        echo(str(error), err=True)
        raise typer.Exit(USAGE_ERROR) from error
    except OSError as error:
        echo(f"cannot read {wav}: {error.strerror or error}", err=True)
        raise typer.Exit(USAGE_ERROR) from error
    raise typer.Exit(0 if is_done else FAILURE)
