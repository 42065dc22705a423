"""The facts that the doctor asks of a robot, as pyinfra and Ansible would gather them: each by a question of its own.

Two ways to cut the doctor's scripts, which hold several questions each:
  scripts    a task is one of our scripts, as it is.
  questions  a task is one question, as those who write for these tools do it: their facts are a command each. Scripts whose
             questions need each other stay whole.
"""

from __future__ import annotations

import json
import shlex
from pathlib import Path

from bench.peers.tools import Tools, Unsafe

WAYS = ("scripts", "questions")
SECTION = "echo '@@ "
# Before its questions a script may set the language, and look for sudo: that is said again with each of them.
TOGETHER = ("pids=", "found=", "j()", "cd /dev/shm", "names=")


def asked(address: str, way: str) -> dict[str, str]:
    """What a robot is asked, by names that tell the fact."""
    whole = _scripts(address)
    if way == "scripts":
        return whole
    return {f"{name} {n}": part for name, script in whole.items() for n, part in enumerate(_cut(script), 1)}


def _cut(script: str) -> list[str]:
    lines = script.splitlines(keepends=True)
    starts = [n for n, line in enumerate(lines) if line.startswith(SECTION)]
    before = lines[: starts[0]] if starts else lines
    if len(starts) < 2 or any(word in line for line in before for word in TOGETHER):
        return [script]
    parts = ["".join(lines[start:end]) for start, end in zip(starts, [*starts[1:], len(lines)])]
    # Nobody looks for sudo who doesn't need it.
    leads = ["".join(line for line in before if not line.startswith("as=") or "$as" in part) for part in parts]
    return [lead + part for lead, part in zip(leads, parts) if "'@@ end'" not in part]


def _scripts(address: str) -> dict[str, str]:
    from lupin_cli.checks.table import built_in
    from lupin_cli.diagnosis import facts_of
    from lupin_cli.facts.routes import ROBOT_ADDRESSES
    from lupin_cli.target.framing import ENVIRONMENT

    known = f"{ENVIRONMENT}{ROBOT_ADDRESSES}={shlex.quote(address)}\n"
    return {fact.name: known + fact.probe for fact in facts_of(built_in(), "robot")}


def pyinfra(tools: Tools, questions: dict[str, str]) -> list[str]:
    """One fact a question. They are left in a file, so that nobody has to trust a summary."""
    # A question may end with a status that means something; pyinfra would take it for a failure.
    text = f"""
from pyinfra import host
from pyinfra.facts.server import Command
facts = {{name: host.get_fact(Command, command='( ' + script + '\\n) || true') for name, script in DATA.items()}}
open({str(_answers(tools))!r}, 'w').write(json.dumps(facts))
"""
    return tools.pyinfra("facts", text, questions)


def ansible(tools: Tools, questions: dict[str, str]) -> list[str]:
    """One task a question, whose answer is kept."""
    return tools.ansible(
        "facts",
        [
            {
                "name": name,
                "ansible.builtin.shell": {"cmd": Unsafe(script)},
                "register": f"fact_{number}",
                "changed_when": False,
                "failed_when": False,
            }
            for number, (name, script) in enumerate(questions.items())
        ],
    )


def must_have_answered(tool: str, said: str, questions: dict[str, str], tools: Tools) -> None:
    """Ends the bench where a tool was fast because it asked less."""
    if tool == "pyinfra":
        answered = len(json.loads(_answers(tools).read_text()))
        _answers(tools).unlink()
    else:
        line = next((line for line in said.splitlines() if line.startswith("robot ") and "ok=" in line), "robot ok=0")
        answered = int(line.split("ok=")[1].split()[0])
    if answered < len(questions):
        raise SystemExit(f"not measured: {tool} answered {answered} of {len(questions)} questions\n{said}")


def _answers(tools: Tools) -> Path:
    return tools.folder / "pyinfra-facts.json"
