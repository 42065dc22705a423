"""Whether every command that `lupin doctor` prints can be pasted, and helps, in a terminal of the laptop.

For each fault of `bench.fault_table`, a shell in a pseudo-terminal runs `lupin doctor`. The command of the fault's own finding
is pasted as it was printed, questions are answered with yes, and the doctor runs again. A command works if the shell ran it
and it exited with 0, or with the status of the state that it only shows; it helps if its finding is gone afterwards. Findings
that a person mends by hand have no command, but a text.

`--record` writes the terminal sessions as an asciicast. Needs root, as the tests on booted hosts do. The laptop has no systemd
of its own, so what is mended in its services is pasted by a test on one that has.
"""

from __future__ import annotations

import fnmatch
import json
import os
import pty
import re
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TextIO

from bench.fault_case import FaultCase
from bench.fault_rig import FaultRig, RigError
from bench.fault_table import CASES
from bench.runner import Figures, Patterns, benchmark, note
from lupin_sim.host import HostError
from lupin_sim.host.host import PROJECT

COLUMNS, ROWS = 110, 50
COMMAND_TIMEOUT_S = 240.0
DIAGNOSES = 4  # some faults become visible, or disappear, only after a DDS lease has expired or chrony has polled
PROMPT = "laptop$ "
# Faults whose command works on a service of the laptop, with the test that runs it.
_ON_BOOTED_LAPTOP = "tests/lupin_sim/host/test_booted_laptop.py::test_laptop_is_deployed_serves_time_and_is_removed"
OF_SERVICES = dict.fromkeys(("laptop-not-serving", "stock-makestep"), _ON_BOOTED_LAPTOP)
# Commands that show a state: `lupin transport show` exits with 3 where the robot answers over none of its transports.
SHOWN_STATUSES = {"lupin transport show": (3,)}
STATUS = re.compile(r"\[exit (\d+)\]")
QUESTION = re.compile(r"\[(?:y/N|Y/n|y/n)\][^\n]{0,4}$")
FIX = re.compile(r"^  fix {7}(?P<command>.+)$", re.MULTILINE)
INSTRUCTION = re.compile(r"^  do {8}(?P<text>.+(?:\n {12}\S.*)*)$", re.MULTILINE)
# A cause may be continued on the next lines.
FINDING = re.compile(r"^[✗▲] .*?(?:\n  \S.*?)*?(?:\n  )?\[(?P<id>[a-z0-9-]+)\]$", re.MULTILINE)
ESCAPES = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]|\x1b\][^\x07]*\x07|\r")


@dataclass
class PasteResult:
    """What pasting did for one fault."""

    fault: str
    instruction: str = ""  # what a person does by hand, as it was printed
    command: str = ""  # as it was printed; "": the finding has none
    status: int | None = None  # of the pasted command; None: nothing was pasted
    gone: bool | None = None  # whether the finding had gone afterwards
    error: str = ""
    output: str = ""  # the end of what the command printed, or the doctor, if it failed

    @property
    def works(self) -> bool:
        """Whether the pasted command did what it was printed for."""
        shown = next((statuses for command, statuses in SHOWN_STATUSES.items() if self.command.startswith(command)), ())
        return self.status is not None and self.status in (0, *shown)


class Recording:
    """An asciicast, version 2: what the terminals showed, and when."""

    def __init__(self, path: Path | None) -> None:
        self._file: TextIO | None = None if path is None else path.open("w", encoding="utf-8")
        self._began = time.monotonic()
        self._line({"version": 2, "width": COLUMNS, "height": ROWS, "title": "lupin doctor: every printed command, pasted"})

    def show(self, text: str) -> None:
        """Add what a terminal has just printed."""
        self._line([round(time.monotonic() - self._began, 3), "o", text])

    def _line(self, value: object) -> None:
        if self._file is not None:
            self._file.write(json.dumps(value) + "\n")
            self._file.flush()


# OpenSSH reads the home folder of the account, and not $HOME, which is the operator's here.
SSH = """#!/bin/sh
exec {program} -i "$HOME/.ssh/id_ed25519" -o IdentitiesOnly=yes -o UserKnownHostsFile="$HOME/.ssh/known_hosts" "$@"
"""


class Terminal:
    """An interactive shell of the operator in a pseudo-terminal on the laptop."""

    def __init__(self, rig: FaultRig, env: Mapping[str, str], recording: Recording) -> None:
        self._recording = recording
        self._master, slave = pty.openpty()
        programs = rig.home / "bin"
        programs.mkdir(exist_ok=True)
        (programs / "ssh").write_text(SSH.format(program=shutil.which("ssh")))
        (programs / "ssh").chmod(0o755)
        path = f"{programs}:{Path(sys.executable).parent}:{env['PATH']}"
        shell = {**env, "PATH": path, "TERM": "xterm-256color", "LC_ALL": "C.UTF-8"}
        subprocess.run(["stty", "cols", str(COLUMNS), "rows", str(ROWS)], stdin=slave, check=True)
        self._process: subprocess.Popen[Any] = rig.machines.popen(
            ["bash", "--noprofile", "--norc", "--noediting", "-i"],
            shell,
            cwd=str(PROJECT),
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
        )
        os.close(slave)
        self._write(f"PS1='[exit $?]\n{PROMPT}'; stty -echo\n")
        self._until(lambda text: text.endswith(PROMPT) and "[exit" in ESCAPES.sub("", text).rsplit("\n", 2)[-2])

    def _write(self, text: str) -> None:
        os.write(self._master, text.encode())

    def _until(self, is_done: Any) -> str:
        """Read until the text is complete; answer questions with yes. Raises TimeoutError."""
        deadline, text, answered = time.monotonic() + COMMAND_TIMEOUT_S, "", 0
        while time.monotonic() < deadline:
            if select.select([self._master], [], [], 0.2)[0]:
                got = os.read(self._master, 65536).decode(errors="replace")
                self._recording.show(got)
                text += got
            plain = ESCAPES.sub("", text)
            if is_done(plain):
                return plain
            if QUESTION.search(plain[answered:]):
                answered = len(plain)
                self._write("y\n")
        raise TimeoutError(f"no prompt after {COMMAND_TIMEOUT_S:g} s: {text[-300:]!r}")

    def paste(self, line: str) -> tuple[int, str]:
        """Paste a line and press Enter; return the exit status and what was printed. Raises TimeoutError."""
        self._recording.show(f"{line}\r\n")
        self._write(f"{line}\n")
        text = self._until(lambda text: text.endswith(f"]\n{PROMPT}"))
        return int(STATUS.findall(text)[-1]), text

    def close(self) -> None:
        """End the shell and what it started."""
        os.close(self._master)
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._recording.show("\r\n\r\n")


@dataclass(frozen=True)
class PrintedFix:
    """What the doctor printed for a root cause: a command, what a person does by hand, or both."""

    instruction: str
    command: str


def printed_fixes(text: str) -> dict[str, PrintedFix]:
    """Return what the doctor printed for each root cause."""
    found = list(FINDING.finditer(text))
    ends = [*(each.start() for each in found[1:]), len(text)]
    fixes = {}
    for each, end in zip(found, ends):
        fix, instruction = FIX.search(text, each.end(), end), INSTRUCTION.search(text, each.end(), end)
        words = " ".join(instruction["text"].split()) if instruction else ""
        fixes[each["id"]] = PrintedFix(words, fix["command"] if fix else "")
    return fixes


def diagnose(terminal: Terminal, case: FaultCase, *, until_gone: bool) -> tuple[dict[str, PrintedFix], str]:
    """Run the doctor until the fault's finding is reported, or is gone; return the fixes and what was printed."""
    for _ in range(DIAGNOSES):
        text = terminal.paste(f"lupin doctor --robot {case.robot}")[1]
        fixes = printed_fixes(text)
        if (case.expected <= fixes.keys()) != until_gone:
            break
        time.sleep(3.0)
    return fixes, text


def measure(rig: FaultRig, case: FaultCase, recording: Recording) -> tuple[PasteResult, str]:
    """Inject, diagnose, paste, diagnose again, undo. Returns the result, and why the machines did not recover."""
    result = PasteResult(case.name)
    terminal: Terminal | None = None
    recovery_error = ""
    try:
        recording.show(f"\x1b[1m# fault: {case.name}\x1b[0m\r\n")
        case.inject(rig)
        terminal = Terminal(rig, rig.environments[case.shell], recording)
        fixes, text = diagnose(terminal, case, until_gone=False)
        (wanted,) = case.expected
        if wanted not in fixes:
            result.error, result.output = f"not a root cause: {', '.join(fixes) or 'nothing found'}", text[-600:]
        else:
            result.instruction, result.command = fixes[wanted].instruction, fixes[wanted].command
        if result.command:
            result.status, output = terminal.paste(result.command)
            result.gone = wanted not in diagnose(terminal, case, until_gone=True)[0]
            result.output = "" if result.works else output[-600:]
    except (RigError, HostError, subprocess.TimeoutExpired, TimeoutError, OSError) as error:
        result.error = f"{type(error).__name__}: {error}"[:400]
    if terminal is not None:
        terminal.close()
    try:
        case.undo(rig)
    except (RigError, HostError, subprocess.TimeoutExpired) as error:
        recovery_error = f"{error}"[:300]  # the command may have undone it already; then the doctor says so
    try:
        rig.restore()
        rig.wait_until_healthy()
    except (RigError, HostError, subprocess.TimeoutExpired) as error:
        return result, f"after {case.name}: {recovery_error or error}"[:600]
    return result, ""


def run(cases: Sequence[FaultCase], recording: Recording) -> list[PasteResult]:
    """Measure the cases on one host, which is replaced if it does not recover."""
    results: list[PasteResult] = []
    rig: FaultRig | None = None
    try:
        for case in cases:
            if rig is None:
                rig = FaultRig.start()
                rig.wait_until_healthy()
            result, recovery_error = measure(rig, case, recording)
            results.append(result)
            note(line_of(result))
            if recovery_error:
                note(f"  a new host: {recovery_error}")
                rig.stop()
                rig = None
    finally:
        if rig is not None:
            rig.stop()
    return results


def line_of(result: PasteResult) -> str:
    """Return one line for a person."""
    if result.error:
        return f"?  {result.fault}: {result.error}\n{result.output}"
    if result.status is None:
        return f"   {result.fault}: by hand: {result.instruction}"
    mark = "✓" if result.works else "✗"
    gone = "finding gone" if result.gone else "finding remains"
    failed = f"\n{result.output}" if result.output else ""
    return f"{mark}  {result.fault}: {result.command}  -> {result.status}, {gone}{failed}"


@benchmark(at_most={"failed": 0, "errors": 0}, long=True)
def main(only: Patterns = (), record: Annotated[Path | None, "write the terminal sessions as an asciicast"] = None) -> Figures:
    """Paste the commands."""
    patterns = only or ("*",)
    named = [case for case in CASES if any(fnmatch.fnmatchcase(case.name, pattern) for pattern in patterns)]
    results = run([case for case in named if case.name not in OF_SERVICES], Recording(record))
    for fault in OF_SERVICES:
        note(f"{fault}: needs a laptop with its own systemd: {OF_SERVICES[fault]}")
    pasted = [result for result in results if result.status is not None]
    return {
        "faults": {each.fault: {"status": each.status, "gone": each.gone, "command": each.command} for each in results},
        "measured": len(results),
        "pasted": len(pasted),
        "failed": sum(not result.works for result in pasted),
        "errors": sum(bool(result.error) for result in results),
        "findings_gone": sum(result.gone is True for result in pasted),
    }


if __name__ == "__main__":
    sys.exit(main())
