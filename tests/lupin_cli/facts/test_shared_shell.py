"""Probes that share a shell: each has the same output as in its own shell, whatever the others do."""

from __future__ import annotations

from lupin_cli.connection.base import Output, Script
from lupin_cli.connection.local import LocalTarget
from lupin_cli.doctor.gathering import gather_facts
from lupin_cli.facts.base import Fact, Unknown
from lupin_cli.facts.shared_shell import join_probes, split_outputs

PROBES = {
    "silent": ":",
    "failing": "echo a; exit 3",
    "without line break": "printf 'no end'; echo 'two lines' >&2; echo 'of errors' >&2",
    "syntax": "if",
    "quoting": """echo 'it'\\''s "quoted" $HOME'""",
    "empty lines": "printf '\\n\\nx\\n\\n'",
    "changing": "cd /; PATH=/nowhere; set -e; false; echo never",
    "last": "echo d",
}


def _run_alone(text: str) -> Output:
    return LocalTarget().batch([Script("it", text)])["it"]


def test_each_probe_has_same_output_as_alone() -> None:
    probes = list(PROBES.values())
    found = split_outputs(_run_alone(join_probes(probes)), probes)
    for (name, probe), output in zip(PROBES.items(), found):
        alone = _run_alone(f"eval {probe!r}" if name == "syntax" else probe)
        assert (output.status, output.stdout, output.stderr, output.truncated) == (
            alone.status,
            alone.stdout,
            alone.stderr,
            False,
        ), name


def test_hanging_probe_delays_only_later_ones() -> None:
    probes = ["echo a", "echo b; sleep 20", "echo c"]
    whole = LocalTarget().batch([Script("it", join_probes(probes), timeout_s=1.0)])["it"]
    before, hanging, behind = split_outputs(whole, probes)
    assert (before.status, before.stdout, before.truncated) == (0, "a\n", False)
    assert (hanging.status, hanging.stdout, hanging.truncated) == (None, "b\n", True)
    assert (behind.status, behind.stdout, behind.truncated) == (None, "", True)


def test_failed_script_gives_no_output_for_any_probe() -> None:
    for output in split_outputs(Output(None, "", "the link went"), [":", ":"]):
        assert (output.status, output.stdout, output.truncated) == (None, "", True)


def test_facts_that_share_a_shell_are_parsed_separately() -> None:
    def text(output: Output) -> str:
        if not output.ok:
            raise ValueError(f"status {output.status}")
        return output.stdout.strip()

    facts = [
        Fact("one", "echo 1", text, runs_in_shared_shell=True),
        Fact("apart", "echo $$", text),
        Fact("broken", "echo 2; exit 4", text, runs_in_shared_shell=True),
        Fact("known", 'echo "$LUPIN_ROBOT_ADDRESSES"', text, runs_in_shared_shell=True),
        Fact("kept", "sleep 20", text, timeout_s=1.0),
    ]
    values = gather_facts(LocalTarget(), "laptop", facts, ["10.0.0.1"]).values
    assert values["one"] == "1" and values["known"] == "10.0.0.1" and values["apart"].isdigit()
    assert values["broken"] == Unknown("unreadable answer: status 4")
    assert values["kept"] == Unknown("did not answer within 1 s")
    assert list(values) == [fact.name for fact in facts]
