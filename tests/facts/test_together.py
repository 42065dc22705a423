"""Probes that share a shell: each must leave what it leaves alone, whatever the others do."""

from __future__ import annotations

from lupin_cli.diagnosis import ask
from lupin_cli.facts.base import Fact, Unknown
from lupin_cli.facts.together import apart, together
from lupin_cli.target.base import Output, Script
from lupin_cli.target.local import LocalTarget

PROBES = {
    "silent": ":",
    "failing": "echo a; exit 3",
    "unended": "printf 'no end'; echo 'it said' >&2; echo more >&2",
    "syntax": "if",
    "quoting": """echo 'it'\\''s "quoted" $HOME'""",
    "empty lines": "printf '\\n\\nx\\n\\n'",
    "changing": "cd /; PATH=/nowhere; set -e; false; echo never",
    "last": "echo d",
}


def _alone(text: str) -> Output:
    return LocalTarget().batch([Script("it", text)])["it"]


def test_each_leaves_what_it_leaves_alone() -> None:
    probes = list(PROBES.values())
    found = apart(_alone(together(probes)), probes)
    for (name, probe), output in zip(PROBES.items(), found):
        alone = _alone(f"eval {probe!r}" if name == "syntax" else probe)
        assert (output.status, output.stdout, output.stderr, output.truncated) == (
            alone.status,
            alone.stdout,
            alone.stderr,
            False,
        ), name


def test_one_that_hangs_keeps_only_those_behind_it() -> None:
    probes = ["echo a", "echo b; sleep 20", "echo c"]
    whole = LocalTarget().batch([Script("it", together(probes), timeout_s=1.0)])["it"]
    before, hanging, behind = apart(whole, probes)
    assert (before.status, before.stdout, before.truncated) == (0, "a\n", False)
    assert (hanging.status, hanging.stdout, hanging.truncated) == (None, "b\n", True)
    assert (behind.status, behind.stdout, behind.truncated) == (None, "", True)


def test_a_script_that_never_ran_answers_for_none() -> None:
    for output in apart(Output(None, "", "the link went"), [":", ":"]):
        assert (output.status, output.stdout, output.truncated) == (None, "", True)


def test_facts_that_share_a_shell_are_read_each_for_itself() -> None:
    def text(output: Output) -> str:
        if not output.ok:
            raise ValueError(f"status {output.status}")
        return output.stdout.strip()

    facts = [
        Fact("one", "echo 1", text, at_once=True),
        Fact("apart", "echo $$", text),
        Fact("broken", "echo 2; exit 4", text, at_once=True),
        Fact("known", 'echo "$LUPIN_ROBOT_ADDRESSES"', text, at_once=True),
        Fact("kept", "sleep 20", text, timeout_s=1.0),
    ]
    values = ask(LocalTarget(), "laptop", facts, ["10.0.0.1"]).values
    assert values["one"] == "1" and values["known"] == "10.0.0.1" and values["apart"].isdigit()
    assert values["broken"] == Unknown("unreadable answer: status 4")
    assert values["kept"] == Unknown("did not answer within 1 s")
    assert list(values) == [fact.name for fact in facts]
