"""The facts that the doctor asks of both machines, as pyinfra and Ansible would gather them: each by a question of its own.

Which facts:
  robot      those of the robot alone: what the peers are made for.
  both       those of the laptop too, as the doctor has them: it compares one end with the other.
Two ways to cut the doctor's scripts, which hold several questions each:
  scripts    a task is one of our scripts, as it is.
  questions  a task is one question, as those who write for these tools do it: their facts are a command each. Scripts whose
             questions need each other stay whole.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping
from typing import Any

from bench.peers.tools import Tools, Unsafe

WAYS = ("scripts", "questions")
ENDS: Mapping[str, tuple[str, ...]] = {"robot": ("robot",), "both": ("robot", "laptop")}
Questions = Mapping[str, Mapping[str, str]]
"""By machine, then by names that tell the fact."""
SECTION = "echo '@@ "
# Before its questions a script may set the language, and a variable: that is said again with each of them that needs it.
TOGETHER = ("pids=", "found=", "j()", "cd /dev/shm", "names=")


VARIABLE = re.compile(r"([a-z]+)=")


def visiting() -> list[str]:
    """The checks that visit a graph, which the peers have nothing for."""
    from lupin_cli.checks.table import built_in

    return [c.name for c in built_in() if any(fact.name == "graph" for fact in (*c.laptop, *c.robot))]


def asked(address: str, way: str, ends: str) -> Questions:
    """What the machines are asked."""
    whole = {end: _scripts(address, end) for end in ENDS[ends]}
    if way == "scripts":
        return whole
    return {
        end: {f"{name} {n}": part for name, script in scripts.items() for n, part in enumerate(_cut(script), 1)}
        for end, scripts in whole.items()
    }


def _cut(script: str) -> list[str]:
    lines = script.splitlines(keepends=True)
    starts = [n for n, line in enumerate(lines) if line.startswith(SECTION)]
    before = lines[: starts[0]] if starts else lines
    if len(starts) < 2 or any(word in line for line in before for word in TOGETHER):
        return [script]
    parts = ["".join(lines[start:end]) for start, end in zip(starts, [*starts[1:], len(lines)])]
    leads = ["".join(line for line in before if not (set_ := VARIABLE.match(line)) or f"${set_[1]}" in part) for part in parts]
    return [lead + part for lead, part in zip(leads, parts) if "'@@ end'" not in part]


def _scripts(address: str, end: str) -> dict[str, str]:
    from lupin_cli.checks.table import built_in
    from lupin_cli.diagnosis import facts_of
    from lupin_cli.facts.routes import ROBOT_ADDRESSES
    from lupin_cli.target.framing import ENVIRONMENT

    known = f"{ENVIRONMENT}{ROBOT_ADDRESSES}={shlex.quote(address)}\n"
    checks = [check for check in built_in() if check.name not in visiting()]
    return {fact.name: known + fact.probe for fact in facts_of(checks, end)}


def pyinfra(tools: Tools, questions: Questions) -> list[str]:
    """One fact a question. They are left in files, so that nobody has to trust a summary."""
    # A question may end with a status that means something; pyinfra would take it for a failure.
    text = f"""
from pyinfra import host
from pyinfra.facts.server import Command
end = 'laptop' if host.name == '@local' else 'robot'
asked = DATA.get(end, {{}})
facts = {{name: host.get_fact(Command, command='( ' + script + '\\n) || true') for name, script in asked.items()}}
open({str(tools.folder)!r} + f'/pyinfra-{{end}}.json', 'w').write(json.dumps(facts))
"""
    return tools.pyinfra("facts", text, questions, list(questions))


def ansible(tools: Tools, questions: Questions) -> list[str]:
    """One task a question, whose answer is kept; what both are asked they are asked at the same time."""
    plays: dict[str, list[dict[str, Any]]] = {}
    scripts = dict(item for asked in questions.values() for item in asked.items())
    for number, (name, script) in enumerate(scripts.items()):
        hosts = ":".join(end for end, asked in questions.items() if name in asked)
        task = {"name": name, "ansible.builtin.shell": {"cmd": Unsafe(script)}, "register": f"fact_{number}"}
        plays.setdefault(hosts, []).append({**task, "changed_when": False, "failed_when": False})
    return tools.ansible("facts", plays)


def must_have_answered(tool: str, said: str, questions: Questions, tools: Tools) -> None:
    """Ends the bench where a tool was fast because it asked less."""
    for end, asked in questions.items():
        if tool == "pyinfra":
            answers = tools.folder / f"pyinfra-{end}.json"
            answered = len(json.loads(answers.read_text())) if answers.exists() else 0
            answers.unlink(missing_ok=True)
        else:
            lines = (line.split() for line in said.splitlines() if "ok=" in line)
            words = next((words for words in lines if words[0] == end), ["", "ok=0"])
            answered = int(next(word for word in words if word.startswith("ok="))[3:])
        if answered < len(asked):
            raise SystemExit(f"not measured: {tool} answered {answered} of {len(asked)} questions to the {end}\n{said}")
