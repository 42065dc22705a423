"""Runs of playbooks that this machine's journal has begun and not finished: interrupted, or failed half way."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, Section, parse_sections
from lupin_runtime.json_text import parse_json

NEWEST = 40
PROBE = (
    PRELUDE
    + f"""echo '@@ now'; date +%s
folder="${{XDG_STATE_HOME:-$HOME/.local/state}}/lupin/journal"
ls -t "$folder" 2>/dev/null | grep '\\.jsonl$' | head -n {NEWEST} | while read -r file; do
  flock -n -s "$folder/$file" true 2>/dev/null && lock=free || lock=held
  echo "@@ run ${{file%.jsonl}}"; echo "$lock $(grep -cE '"event": ?"change"' "$folder/$file")"
  head -n 1 "$folder/$file" | head -c 20000 | tr -d '\\n'; echo
  tail -n 1 "$folder/$file" | head -c 20000 | tr -d '\\n'; echo
done
echo '@@ end'
"""
)


@dataclass(frozen=True)
class UnfinishedRun:
    """The newest run of a playbook on a machine, if it did not come to its end and nobody is playing it now."""

    run: str
    playbook: str
    robot: str  # empty: the laptop
    state: str  # interrupted, unreachable, failed after a change, or "cut off": the program was killed
    age_s: float  # since it was started
    changes: int = 0  # that it has begun


def parse(output: Output) -> tuple[UnfinishedRun, ...]:
    """Parse the output of PROBE: the newest run first. Raises ValueError."""
    sections = parse_sections(output)
    sections.lines("end")
    now_s = sections.number("now")
    found, seen, undone = [], set(), set()
    for section in sections.all("run"):
        start, last = _line(section, 1), _line(section, 2)
        playbook, robot = str(start.get("playbook", "")), str(start.get("robot", ""))
        if start.get("event") != "start" or (playbook, robot) in seen:
            continue
        if start.get("undo_of"):
            undone.add(start["undo_of"])  # an undo is newer than its run
            continue
        seen.add((playbook, robot))
        ended = last.get("event") == "end"
        state = str(last.get("state", "")) if ended else "cut off"
        lock, _, count = section.text.partition(" ")
        changes = int(count) if count.isdigit() else 0
        left_half_way = state in ("interrupted", "unreachable", "cut off") or (state == "failed" and changes > 0)
        if section.argument in undone or last.get("closed"):
            continue  # its changes were undone, or it has put things in order itself
        if lock == "free" and left_half_way:
            begun_s = datetime.fromisoformat(str(start.get("time", ""))).timestamp()
            found.append(UnfinishedRun(section.argument, playbook, robot, state, round(now_s - begun_s, 1), changes))
    return tuple(found)


def _line(section: Section, index: int) -> dict[str, Any]:
    try:
        found = parse_json(section.lines[index]) if len(section.lines) > index else {}
    except ValueError:  # the run was killed while it wrote the line
        return {}
    return found if isinstance(found, dict) else {}


UNFINISHED_RUNS = Fact("unfinished-runs", PROBE, parse)
