"""`lupin console voice`: the key with which the console's voice agent reaches its model."""

from __future__ import annotations

import getpass
import json
import sys

import typer

from lupin_cli.command_group import command_group
from lupin_cli.exit_codes import FAILURE, USAGE_ERROR
from lupin_cli.terminal import echo

_MAX_CHARACTERS = 10_000

voice = command_group(
    """Store, describe or forget the key of the Gemini API for the voice agent of the console's page.

    The console mints a token with it for each connection of a browser. The key itself leaves this computer only to Google.

    Exit status: 0 done.
    """,
    "lupin console voice status",
)


@voice.command("set-key")
def set_key() -> None:
    """Store the key, which is read from the terminal without showing it, or from standard input. It is never an argument,
    since other users see those.

    Exit status: 0 stored, 2 no key was given.

    Example: lupin console voice set-key < key.txt
    """
    from lupin_runtime.console.voice_key import BadKey, check_key, key_file, write_key

    try:
        typed = getpass.getpass("Key of the Gemini API: ") if sys.stdin.isatty() else sys.stdin.read(_MAX_CHARACTERS)
        write_key(key_file(), check_key(typed))
    except (EOFError, KeyboardInterrupt):
        echo("nothing was stored", err=True)
        raise typer.Exit(USAGE_ERROR) from None
    except (BadKey, UnicodeDecodeError) as error:
        echo(f"nothing was stored: {error if isinstance(error, BadKey) else 'the input is not text'}", err=True)
        raise typer.Exit(USAGE_ERROR) from None
    except OSError as error:
        echo(f"the key could not be stored in {error.filename or key_file()}: {error.strerror}", err=True)
        raise typer.Exit(USAGE_ERROR) from error
    echo("stored; a running console uses it from the next conversation on")


@voice.command()
def status(as_json: bool = typer.Option(False, "--json", help="Print only JSON on standard output.")) -> None:
    """Say whether a key is stored; never shows the key. Changes nothing.

    Exit status: 0 a key is stored, 1 there is none, 2 its file is damaged or may be read by others.

    Example: lupin console voice status
    """
    from lupin_runtime.atomic_file import MalformedFile
    from lupin_runtime.console.voice_key import SET_KEY, key_file, read_key

    path = key_file()
    try:
        is_stored = read_key(path) is not None
    except (MalformedFile, OSError) as error:
        echo(str(error), err=True)
        raise typer.Exit(USAGE_ERROR) from error
    if as_json:
        print(json.dumps({"stored": is_stored, "path": str(path)}))
    else:
        echo(f"a key is stored in {path}" if is_stored else f"no key is stored; store one with: {SET_KEY}")
    if not is_stored:
        raise typer.Exit(FAILURE)


@voice.command()
def forget(dry_run: bool = typer.Option(False, "--dry-run", help="Show what would be deleted; change nothing.")) -> None:
    """Delete the stored key. Conversations that are open go on until their connection ends.

    Exit status: 0 there is none any more, 2 it cannot be deleted.

    Example: lupin console voice forget
    """
    from lupin_runtime.console.voice_key import forget_key, key_file

    path = key_file()
    try:
        existed = path.exists() if dry_run else forget_key(path)
    except OSError as error:
        echo(f"{path} cannot be deleted: {error.strerror}", err=True)
        raise typer.Exit(USAGE_ERROR) from error
    if not existed:
        echo("no key is stored")
    else:
        echo(f"would delete {path}" if dry_run else "deleted; to make it useless, delete it at aistudio.google.com, too")
