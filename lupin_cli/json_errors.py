"""With --json, standard output is one JSON document, also if a command fails: then it is an object with the key `error`."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Iterator
from typing import TextIO

_NEXT = "  next: "


class _Tee:
    """A text stream that also keeps what is written to it; everything else is the stream's."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.kept: list[str] = []

    def write(self, text: str) -> int:
        written = self._stream.write(text)  # raises TypeError for bytes, by which click tells the kinds of streams apart
        self.kept.append(text)
        return written

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)


@contextlib.contextmanager
def errors_as_objects() -> Iterator[None]:
    """If the block exits with an error and has printed nothing on standard output, print the error there as an object."""
    output, errors = _Tee(sys.stdout), _Tee(sys.stderr)
    try:
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):  # type: ignore[type-var]
            yield
    except SystemExit as error:
        if error.code and not "".join(output.kept).strip():
            print(json.dumps(error_object("".join(errors.kept), error.code if isinstance(error.code, int) else 1)))
        raise


def error_object(printed: str, exit_code: int) -> dict[str, object]:
    """Return the object for an error, from what a command printed on standard error."""
    lines = [line for line in printed.splitlines() if line.strip()]
    following = [line.removeprefix(_NEXT) for line in lines if line.startswith(_NEXT)]
    messages = [line for line in lines if line.startswith(("lupin", "Error: "))] or [
        line for line in lines[-1:] if not line.startswith(_NEXT)
    ]
    message = " ".join(line.removeprefix("Error: ") for line in messages)
    return {"error": {"message": message, "next_command": following[0] if following else "", "exit_code": exit_code}}
