"""The facts of the doctor, gathered by pyinfra and Ansible.

Machines:
  robot      the robot's facts only, the usual use of these tools
  both       the laptop's facts too, as the doctor gathers them
Task sizes, because each of the doctor's probes runs several commands:
  scripts    a task runs one whole probe
  questions  a task runs one section of a probe, as the authors of these tools recommend: one command a fact. Probes whose
             sections depend on each other stay whole.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping
from typing import Any

from bench.peers.pyinfra_and_ansible import PeerTools, Unsafe

TASK_SIZES = ("scripts", "questions")
MACHINES: Mapping[str, tuple[str, ...]] = {"robot": ("robot",), "both": ("robot", "laptop")}
Questions = Mapping[str, Mapping[str, str]]
"""Scripts by machine, then by name."""
SECTION = "echo '@@ "
# A probe may set the locale and variables before its first section; they are repeated in each section that needs them. A probe
# with one of these strings before its first section stays whole.
INDIVISIBLE = ("pids=", "found=", "j()", "cd /dev/shm", "names=")
VARIABLE = re.compile(r"([a-z]+)=")


def graph_checks() -> list[str]:
    """Return the checks that join the ROS graph, for which the peers have no equivalent."""
    from lupin_cli.checks.table import built_in

    return [c.name for c in built_in() if any(fact.name == "graph" for fact in (*c.laptop, *c.robot))]


def questions_for(address: str, task_size: str, machines: str) -> Questions:
    """Return the scripts to run; `address` is the robot's, `task_size` and `machines` are described above."""
    whole = {machine: _scripts(address, machine) for machine in MACHINES[machines]}
    if task_size == "scripts":
        return whole
    return {
        machine: {f"{name} {n}": part for name, script in scripts.items() for n, part in enumerate(_split(script), 1)}
        for machine, scripts in whole.items()
    }


def _split(script: str) -> list[str]:
    lines = script.splitlines(keepends=True)
    starts = [n for n, line in enumerate(lines) if line.startswith(SECTION)]
    before = lines[: starts[0]] if starts else lines
    if len(starts) < 2 or any(word in line for line in before for word in INDIVISIBLE):
        return [script]
    parts = ["".join(lines[start:stop]) for start, stop in zip(starts, [*starts[1:], len(lines)])]
    leads = ["".join(line for line in before if not (set_ := VARIABLE.match(line)) or f"${set_[1]}" in part) for part in parts]
    return [lead + part for lead, part in zip(leads, parts) if "'@@ end'" not in part]


def _scripts(address: str, machine: str) -> dict[str, str]:
    from lupin_cli.checks.table import built_in
    from lupin_cli.connection.batch_protocol import ENVIRONMENT
    from lupin_cli.doctor.gathering import needed_facts
    from lupin_cli.facts.routes import ROBOT_ADDRESSES

    known = f"{ENVIRONMENT}{ROBOT_ADDRESSES}={shlex.quote(address)}\n"
    checks = [check for check in built_in() if check.name not in graph_checks()]
    return {fact.name: known + fact.probe for fact in needed_facts(checks, machine)}


def pyinfra_command(tools: PeerTools, questions: Questions) -> list[str]:
    """Return pyinfra's command. It writes the facts to files, in which `require_all_answers` counts them."""
    # pyinfra treats a non-zero exit status as a failure, but in some probes it is a result.
    text = f"""
from pyinfra import host
from pyinfra.facts.server import Command
machine = 'laptop' if host.name == '@local' else 'robot'
scripts = DATA.get(machine, {{}})
facts = {{name: host.get_fact(Command, command='( ' + script + '\\n) || true') for name, script in scripts.items()}}
open({str(tools.folder)!r} + f'/pyinfra-{{machine}}.json', 'w').write(json.dumps(facts))
"""
    return tools.pyinfra_command("facts", text, questions, list(questions))


def ansible_command(tools: PeerTools, questions: Questions) -> list[str]:
    """Return Ansible's command. Scripts for both machines run on both in parallel."""
    plays: dict[str, list[dict[str, Any]]] = {}
    by_name = dict(item for scripts in questions.values() for item in scripts.items())
    for number, (name, script) in enumerate(by_name.items()):
        hosts = ":".join(machine for machine, scripts in questions.items() if name in scripts)
        task = {"name": name, "ansible.builtin.shell": {"cmd": Unsafe(script)}, "register": f"fact_{number}"}
        plays.setdefault(hosts, []).append({**task, "changed_when": False, "failed_when": False})
    return tools.ansible_command("facts", plays)


def require_all_answers(tool: str, printed: str, questions: Questions, tools: PeerTools) -> None:
    """Stop the bench if a tool gathered fewer facts than it should."""
    for machine, scripts in questions.items():
        if tool == "pyinfra":
            answers = tools.folder / f"pyinfra-{machine}.json"
            answered = len(json.loads(answers.read_text())) if answers.exists() else 0
            answers.unlink(missing_ok=True)
        else:
            lines = (line.split() for line in printed.splitlines() if "ok=" in line)
            words = next((words for words in lines if words[0] == machine), ["", "ok=0"])
            answered = int(next(word for word in words if word.startswith("ok="))[3:])
        if answered < len(scripts):
            raise SystemExit(
                f"not measured: {tool} answered {answered} of {len(scripts)} questions to the {machine}\n{printed}"
            )
