"""What the undo of an operation overwrites: whether somebody has changed it since, and a copy of it."""

from __future__ import annotations

import hashlib

from lupin_cli.connection.base import Output, Target
from lupin_cli.connection.shell_file_io import SAFE_PATHS
from lupin_cli.operations.base import Operation, RestoredFile
from lupin_cli.operations.shell import change, observe, quote, run_probe

COPY_SUFFIX = ".before-undo"
_DIGEST_LENGTH = 16  # enough to notice a change


def digests_of(operation: Operation, output: Output) -> dict[str, str]:
    """Return a digest of everything that the operation's undo overwrites, by name. Raises OperationError."""
    states = operation.overwritten(output)
    return {name: hashlib.sha256(state).hexdigest()[:_DIGEST_LENGTH] for name, state in states.items()}


def read_digests(operation: Operation, target: Target) -> dict[str, str]:
    """Return the digests of what is there now. Raises OperationError or TargetError."""
    script = operation.probe()
    if script is None:
        return {}
    # The probe's output may lack a large file. What it lacks of a release is for a change only, and must be built first.
    complete = bool(operation.restored_files())
    return digests_of(operation, observe(operation, target) if complete else run_probe(target, script))


def keep_copy(target: Target, file: RestoredFile) -> str:
    """Keep a file beside itself before an undo replaces it; return the copy's path. Earlier copies get numbers.

    The copy is a hard link: it has the owner and the mode of the file, and is made in one step.
    """
    path = quote(file.path)
    script = f"""
set -u
{SAFE_PATHS}
[ -e {path} ] || [ -L {path} ] || exit 0
enter_folder {path} || exit 1
ln -T --backup=numbered -- "./$name" "./$name{COPY_SUFFIX}"
"""
    change(target, script, f"keep a copy of {file.path}", root=file.root)
    return f"{file.path}{COPY_SUFFIX}"
