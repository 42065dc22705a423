"""`release-key`: an operator's key by which the robot recognizes releases."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import Difference, Operation, OperationError, RestoredFile, probe_script
from lupin_cli.operations.path_state import (
    FileState,
    all_of,
    complete_file,
    file_script,
    parse_file,
    put_owned,
    restore,
    state_before,
    unified_diff,
)
from lupin_cli.operations.shell import quote
from lupin_cli.release.signing_key import PublicKey, SigningKeyError, ensure_key, key_path, load_key
from lupin_cli.release.verify_release import SIGNERS

TRUST = "lupin deploy robot --trust-key"
_OWNER, _MODE = "root:root", 0o644


@dataclass(frozen=True, kw_only=True)
class ReleaseKey(Operation):
    """`key` is the line of a public key; if it is empty, this operator's key is used, and made if there is none yet.

    The first key is trusted as it is; a further one only with `further: true`.
    """

    name: ClassVar[str] = "release-key"
    effect: ClassVar[str] = "the robot runs releases that this operator signs; a key besides others needs `further: true`"
    undo_effect: ClassVar[str] = "byte for byte"
    prefetchable: ClassVar[bool] = True

    key: str = ""
    further: bool = False
    signers: str = SIGNERS

    def __post_init__(self) -> None:
        if self.key:
            PublicKey.parse(self.key)

    def probe(self) -> Script:
        return probe_script(file_script(self.signers), root=True)

    def complete(self, target: Target, output: Output) -> Output:
        return complete_file(target, output, self.signers, True)

    def judge(self, output: Output) -> Difference | None:
        state = parse_file(output, self.signers)
        trusted = self._trusted(state)
        key = self._public_key()
        if key is not None and key.encoded in {each.encoded for each in trusted}:
            return None
        if trusted and not self.further:
            whose = "this key" if self.key else "yours"
            raise OperationError(
                f"the robot runs only releases that are signed with a key it trusts: {_list(trusted)}; {whose} is none of them",
                TRUST,
            )
        summary = f"trust the release key of {key}" if key is not None else f"make a release key, {key_path()}, and trust it"
        besides = f", besides {_list(trusted)}" if trusted else ", the first one"
        content = (state.content or b"") + (key.signers_line.encode() if key is not None else b"")
        return Difference(summary + besides, unified_diff(self.signers, state.content, content), state_before(state))

    def _trusted(self, state: FileState) -> list[PublicKey]:
        """Return the keys that the robot trusts. Raises OperationError if others than root may have written them."""
        if state.kind == "absent":
            return []
        if state.kind != "file" or state.owner != _OWNER or int(state.mode, 8) & 0o022:
            raise OperationError(
                f"others than root may have written {self.signers}, so its keys cannot be trusted: it is a {state.kind} of "
                f"{state.owner} with mode {state.mode}",
                f"sudo rm {quote(self.signers)}",
            )
        trusted = []
        for line in (state.content or b"").decode("utf-8", "replace").splitlines():
            try:
                trusted.append(PublicKey.parse(line))
            except ValueError:
                continue  # a comment, or a line that ssh-keygen ignores as well
        return trusted

    def _public_key(self) -> PublicKey | None:
        """Return the key to trust; None if this operator has none yet. Raises OperationError."""
        if self.key:
            return PublicKey.parse(self.key)
        try:
            key = load_key()
        except SigningKeyError as error:
            raise OperationError(str(error), error.next_command) from error
        return key.public if key is not None else None

    def change(self, target: Target, difference: Difference) -> None:
        try:
            key = PublicKey.parse(self.key) if self.key else ensure_key().public
        except SigningKeyError as error:
            raise OperationError(str(error), error.next_command) from error
        content = target.get(self.signers, root=True) or b""
        if content and not content.endswith(b"\n"):
            content += b"\n"
        put_owned(target, self.signers, content + key.signers_line.encode(), _MODE, _OWNER, True)

    def restored_files(self) -> tuple[RestoredFile, ...]:
        return (RestoredFile(self.signers, root=True),)

    def overwritten(self, output: Output) -> dict[str, bytes]:
        return {self.signers: all_of(parse_file(output, self.signers))}

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        restore(target, self.signers, before, True)


def _list(keys: list[PublicKey]) -> str:
    return ", ".join(map(str, keys))
