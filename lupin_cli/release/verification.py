"""The script by which this machine verifies a release on a robot, with its own copy of the verifier, and what it prints."""

from __future__ import annotations

import shlex
from functools import cache
from pathlib import Path

from lupin_cli.release import verify_release

UNDAMAGED = "undamaged"
NOT_VERIFIED = "no answer of the verifier"


@cache
def verifier() -> str:
    """Return the text of the verifier."""
    return Path(verify_release.__file__).read_text(encoding="utf-8")


def verifier_script(*words: str) -> str:
    """Return sh that runs the verifier with these words of a shell, without installing it."""
    return f"python3 -I - {' '.join(words)} <<'VERIFIER'\n{verifier()}VERIFIER\n"


def verification_script(folder: str, signers: str = verify_release.SIGNERS, *, quick_if: str = "false") -> str:
    """Return sh that prints the damage of a release, one path a line, or UNDAMAGED; nothing if there is no such folder.

    If the command `quick_if` succeeds, only files with another modification time than a deploy's are read. `folder` is a word
    of a shell.
    """
    verify = verifier_script("$quick", folder, shlex.quote(signers))
    return f"""if [ -L {folder} ] || [ -d {folder} ]; then
quick=
{quick_if} && quick=--quick
(
{verify}) 2>/dev/null && echo {UNDAMAGED}
fi
:
"""


def parse_damage(text: str) -> tuple[str, ...]:
    """Return the damage that `verification_script` printed: paths, each with a reason. Without UNDAMAGED there is some."""
    lines = tuple(line for line in text.splitlines() if line.strip())
    if lines[-1:] == (UNDAMAGED,):
        return lines[:-1]
    return lines or (NOT_VERIFIED,)
