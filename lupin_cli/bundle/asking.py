"""Asking a machine for its sources: one batch, and a second for what sudo refused, which the user may be allowed to read."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from lupin_cli.bundle import ends
from lupin_cli.bundle.pieces import ABSENT, UNREACHABLE, UNREADABLE, LeftOut, Piece
from lupin_cli.bundle.sources import ABSENT as EXIT_ABSENT
from lupin_cli.bundle.sources import HEAD_BYTES, TAIL_BYTES, Source, script_of
from lupin_cli.target.base import Output, Script, Target, TargetError

_SLACK_S = 3.0
_REFUSED = "root refused:"
_FORBIDDEN = re.compile(r"permission|not permitted|denied", re.I)
_JOURNAL = re.compile(r"@@ last\n(?P<last>.*?)\n?@@ first\n(?P<first>.*)\Z", re.S)


def ask(
    target: Target, sources: Sequence[Source], folder: str, *, since_s: float | None = None, sudo: bool = True
) -> Iterable[Piece | LeftOut]:
    """What `target` says to each source, below `folder`. A machine that can't be asked is a line for each, never an error."""
    try:
        outputs = _batch(target, sources, since_s, root=sudo)
        refused = [source for source in sources if outputs[source.path].stderr.startswith(_REFUSED)]
        reasons = {source.path: outputs[source.path].stderr for source in refused}
        if refused:
            outputs |= _batch(target, refused, since_s, root=False)
    except TargetError as error:
        for source in sources:
            yield LeftOut(f"{folder}/{source.path}", UNREACHABLE, str(error))
        return
    for source in sources:
        yield read(source, outputs[source.path], folder, target.user, reasons.get(source.path, ""))


def _batch(target: Target, sources: Sequence[Source], since_s: float | None, *, root: bool) -> dict[str, Output]:
    scripts = [Script(each.path, script_of(each, since_s), each.timeout_s, root and each.root) for each in sources]
    missing = Output(None, "", "the machine gave no answer")
    outputs = target.batch(scripts, bound_s=max(each.timeout_s for each in sources) + _SLACK_S)
    return {each.path: outputs.get(each.path, missing) for each in sources}


def read(source: Source, output: Output, folder: str, user: str, refused: str = "") -> Piece | LeftOut:
    """What became of one source. Pure."""
    path = f"{folder}/{source.path}"
    as_user = f"read as {user} ({refused})" if refused else ""
    if output.status == EXIT_ABSENT:
        return LeftOut(path, ABSENT, "there is none on this machine")
    text, remark = _text(output)
    if not text.strip():
        said = (output.stderr.strip().splitlines() or [""])[-1]
        if output.status != 0:
            return LeftOut(path, UNREADABLE, said or f"it ended with status {output.status}")
        if refused or _FORBIDDEN.search(output.stderr):
            return LeftOut(path, UNREADABLE, "; ".join(filter(None, (f"{user} may read nothing of it", said, refused))))
        return LeftOut(path, ABSENT, said or "it says nothing")
    if output.status is None or output.truncated:
        remark = f"{remark}; it did not end in time" if remark else output.stderr.strip() or "it did not end in time"
    return Piece(path, source.what, text.encode("utf-8", "surrogateescape"), "; ".join(filter(None, (remark, as_user))))


def _text(output: Output) -> tuple[str, str]:
    """What the script printed, and what is missing of it. A journal's head is put before its tail, if it isn't in there."""
    journal = _JOURNAL.match(output.stdout)
    if journal is None:
        if len(output.stdout.encode("utf-8", "surrogateescape")) < TAIL_BYTES:
            return output.stdout, ""
        return output.stdout.partition("\n")[2], "its first lines are left out"
    first, last = journal["first"], journal["last"]
    if len(last.encode("utf-8", "surrogateescape")) >= TAIL_BYTES:
        last = last.partition("\n")[2]  # begins within a line
    if len(first.encode("utf-8", "surrogateescape")) >= HEAD_BYTES:
        first = first[: first.rfind("\n") + 1]
    head, tail = first.splitlines(), last.splitlines()
    if not head or not tail or tail[0] in head or tail[0] <= head[0]:
        # The tail reaches back into the head, or is all there is.
        return "\n".join(_spliced(head, tail)) + "\n" * bool(tail or head), ""
    joined = ends.join(
        (first.rstrip("\n") + "\n").encode("utf-8", "surrogateescape"), b"\n" + last.encode("utf-8", "surrogateescape"), "lines"
    )
    return joined.data.decode("utf-8", "surrogateescape"), "lines between its first and its last are left out"


def _spliced(head: list[str], tail: list[str]) -> list[str]:
    if not tail:
        return head
    return head[: head.index(tail[0])] + tail if tail[0] in head else tail
