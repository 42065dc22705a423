"""`chrony-folder`: the folder whose *.conf files chronyd reads. Changes nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script
from lupin_cli.facts.chrony_configuration import READER
from lupin_cli.facts.sections import PRELUDE
from lupin_cli.operations.base import Difference, Operation, probe_script
from lupin_cli.operations.shell import key_values

_FIND = r"""
main=$(chrony_main)
folder=$(chrony_lines confdir | sed 's/^.*:[0-9]*:[[:space:]]*[^[:space:]]*[[:space:]]*//' | tr -s ' \t\r' '\n' |
  while IFS= read -r each; do [ ! -d "$each" ] || { printf '%s\n' "$each"; break; }; done)
main=${main:-/etc/chrony/chrony.conf}
printf 'main=%s\nfolder=%s\n' "$main" "$folder"
"""


@dataclass(frozen=True, kw_only=True)
class ChronyFolder(Operation):
    """Reports `folder`, the first of a `confdir` that exists, empty if there is none, and `main`, the main file."""

    name: ClassVar[str] = "chrony-folder"
    effect: ClassVar[str] = "read only: the folder whose `*.conf` files chronyd reads"
    read_only: ClassVar[bool] = True
    report_keys: ClassVar[tuple[str, ...]] = ("folder", "main")

    def probe(self) -> Script:
        return probe_script(PRELUDE + READER + _FIND)

    def judge(self, output: Output) -> Difference | None:
        return None

    def report(self, output: Output) -> dict[str, Any]:
        found = key_values(output, "chrony's configuration")
        return {"folder": found.get("folder", "").rstrip("/"), "main": found.get("main", "")}
