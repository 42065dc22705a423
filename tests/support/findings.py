"""Compares what checks return with the table of findings, and parses the commands that findings print."""

from __future__ import annotations

import functools
import re
import shlex
import subprocess
from collections.abc import Iterator

from lupin_cli.checks import Finding
from lupin_cli.checks.findings import FINDINGS
from lupin_cli.doctor.engine import Diagnosis
from tests.support.command_line import parse_words

ROWS = {row.id: row for row in FINDINGS}
# The programs with which a printed command may begin, on the laptop and on the robot.
# fmt: off
PROGRAMS = frozenset(
    {
        "apt", "chmod", "chown", "chronyc", "command", "du", "echo", "env", "export", "firewall-cmd", "getent", "grep",
        "head", "ip", "iptables", "iptables-legacy", "iptables-legacy-save", "iptables-save", "journalctl", "kill",
        "ls", "lsusb", "lupin", "mkdir", "mount", "nft", "nmcli", "picotool", "ping", "printf", "ps", "sed", "sleep",
        "sort", "source", "ss", "ssh", "ssh-keygen", "sudo", "sysctl", "systemctl", "systemd-analyze", "tail", "tc",
        "tee", "timedatectl", "true", "ufw", "unset", "usermod",
    }
)
# fmt: on
_JOINTS = ("&&", "||", ";", "|", "&")


def assert_findings_match_rows(diagnosis: Diagnosis) -> None:
    """Assert that no check failed, that each finding came from the check in its row of the table, and that its fix is typed."""
    assert diagnosis.check_errors == ()
    for check, findings in diagnosis.by_check.items():
        for finding in findings:
            assert ROWS[finding.id].check == check, finding.id
            assert finding.symptom and finding.cause, finding.id
            assert finding.fix.playbook or not finding.fix.safe, finding.id
    for finding in diagnosis.findings:
        assert_can_be_followed(finding)


def assert_can_be_followed(finding: Finding) -> None:
    """Assert that a finding says what to do, and that its command is a line for bash without prose."""
    command, instruction = finding.fix.command, finding.fix.instruction
    assert command or instruction, finding.id
    assert "\n" not in command + instruction, finding.id
    assert not instruction.endswith((".", ":", ";")) and instruction == instruction.strip(), (finding.id, instruction)
    if command:
        assert mistake_in_line(command) == "", (finding.id, command)


@functools.cache
def mistake_in_line(line: str) -> str:
    """Return what keeps a line from being pasted into a terminal of the laptop; empty if nothing does."""
    parsed = subprocess.run(["bash", "-n", "-c", line], capture_output=True, text=True)
    if parsed.returncode != 0:
        return parsed.stderr.strip()
    for words in simple_commands(line):
        if words[0] == "sudo":
            words = words[1:]
        if words[0] not in PROGRAMS:
            return f"{words[0]!r} is no known program"
        if words[0] == "lupin" and (mistake := parse_words(words[1:])):
            return mistake
        if words[0] == "ssh" and (mistake := _mistake_in_login(words[1:])):
            return mistake
    return ""


def simple_commands(line: str) -> Iterator[list[str]]:
    """Yield the words of each command of a line, without redirections."""
    lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
    lexer.whitespace_split = True
    words: list[str] = []
    for word in [*lexer, ";"]:
        if word in _JOINTS:
            if words:
                yield words
            words = []
        else:
            words.append(word)


def _mistake_in_login(words: list[str]) -> str:
    """Return what is wrong with the arguments of ssh: a terminal is needed for sudo, and the rest is a script for the robot."""
    has_terminal = words[:1] == ["-t"]
    place = next(
        (at for at, word in enumerate(words) if "@" in word or (re.fullmatch(r"[\w.-]+", word) and word[0] != "-")), None
    )
    if place is None:
        return "ssh without a machine"
    if words[place - 1] == "-p":
        place += 1
    script = words[place + 1 :]
    if not script or script == ["-v"]:
        return ""
    if len(script) > 1 and script[0] != "sudo":
        return f"the script is not one word: {script}"
    if "sudo" in script[0] and not has_terminal:
        return "sudo needs a terminal: ssh -t"
    return mistake_in_line(" ".join(script))
