"""`lupin doctor` as it is typed: its exit statuses, its outputs, and what --fix does before it judges."""

from __future__ import annotations

import ast
import importlib
import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
from typer.testing import CliRunner, Result

from lupin_cli import report
from lupin_cli.app import app
from lupin_cli.checks import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks import table as checks_table
from lupin_cli.commands import doctor
from lupin_cli.facts import Fact
from lupin_cli.runbook import load
from lupin_cli.target import Output

Run = Callable[..., Result]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Type `lupin doctor ...` as a user with a home of his own."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return lambda *words: CliRunner().invoke(app, ["doctor", *words])


@pytest.fixture
def refused() -> Iterator[str]:
    """An address where a machine answers and no SSH server does."""
    with socket.socket() as holder:  # bound and not listening: refused, and nobody else gets the port
        holder.bind(("127.0.0.1", 0))
        yield f"127.0.0.1:{holder.getsockname()[1]}"


def read(output: Output) -> str:
    return output.stdout.strip()


@pytest.fixture
def sick(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Adds a check, as a plug-in would: this machine is sick until a file is there, and a playbook makes it."""

    def add(*, safe: bool = True, mends: bool = True) -> Path:
        cure, playbook = tmp_path / "cure", tmp_path / "mend.yaml"
        made = cure if mends else tmp_path / "elsewhere"
        playbook.write_text(
            "name: mend\n"
            "description: The file is there.\n"
            "steps:\n"
            "  - name: The file is there\n"
            "    on: laptop\n"
            f"    file: {{path: {made}, content: 'well'}}\n"
        )
        fact = Fact("cure", f"[ -e {cure} ] && echo there; exit 0", read)
        finding = Finding(
            "cure-missing", Severity.PROBLEM, "laptop", "it aches", "the file is missing", ("ls: no such file",),
            Fix(f"touch {cure}", str(playbook), safe=safe),
        )  # fmt: skip

        def find(evidence: Evidence) -> Iterator[Finding]:
            if not evidence.laptop.get(fact):
                yield finding

        check = Check("cure", find, laptop=(fact,))
        monkeypatch.setattr(checks_table, "plugged_in", lambda: ((check,), ()))
        return cure

    return add


def test_a_healthy_machine_is_told_in_one_line(run: Run) -> None:
    result = run("--only", "link.*")
    assert (result.exit_code, result.output) == (0, "healthy; 4 checks\n")


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["--only", "dds.profile"], "did you mean dds.profiles?"),
        (["--robot", "a", "--host", "b"], "exclude each other"),
        (["--json", "--markdown"], "both want standard output"),
        (["--yes"], "go with --fix"),
        (["--dry-run"], "go with --fix"),
        (["--all", "--watch"], "--watch looks at one robot"),
        (["--limit", "pot-*", "--robot", "pot-1"], "--all --limit"),
        (["--all"], "has no robots"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_status_2(run: Run, words, hint) -> None:
    result = run(*words)
    assert result.exit_code == 2
    assert hint in result.stderr
    assert result.stdout == ""


def test_an_unknown_robot_is_refused_with_the_nearest_name(run: Run, tmp_path: Path) -> None:
    inventory = tmp_path / "lupin.toml"
    inventory.write_text('[robots.greenhouse.addresses]\nwired = "10.42.0.1"\n')
    result = run("--robot", "greenhose", "--config", str(inventory))
    assert result.exit_code == 2
    assert "did you mean greenhouse?" in result.stderr


def test_a_robot_that_cannot_be_reached_is_diagnosed_with_status_3(run: Run, refused: str) -> None:
    result = run("--host", refused, "--only", "link.*", "--json")
    assert result.exit_code == 3
    told = json.loads(result.stdout)
    assert told["robot"]["unreachable"] == "refused"
    assert [finding["id"] for finding in told["findings"]] == ["robot-unreachable"]


def test_several_robots_are_told_side_by_side_and_the_worst_status_counts(run: Run, tmp_path: Path, refused: str) -> None:
    inventory = tmp_path / "lupin.toml"
    inventory.write_text("".join(f'[robots.{name}.addresses]\nwired = "{refused}"\n' for name in ("pot-1", "pot-2")))
    result = run("--all", "--config", str(inventory), "--only", "link.*", "--json")
    assert result.exit_code == 3
    assert [robot["robot"]["name"] for robot in json.loads(result.stdout)["robots"]] == ["pot-1", "pot-2"]


def test_a_junit_report_holds_a_case_for_every_check(run: Run, tmp_path: Path, sick) -> None:
    sick()
    report = tmp_path / "report.xml"
    result = run("--only", "link.*", "--only", "cure", "--junit", str(report))
    assert result.exit_code == 1
    (suite,) = ElementTree.parse(report).getroot()
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("5", "1", "0")


def test_a_report_that_cannot_be_written_is_the_doctors_failure(run: Run, tmp_path: Path) -> None:
    result = run("--only", "link.*", "--junit", str(tmp_path / "nowhere" / "report.xml"))
    assert result.exit_code == 4
    assert "nowhere" in result.stderr


def test_markdown_is_all_of_standard_output(run: Run, sick) -> None:
    sick()
    result = run("--only", "cure", "--markdown")
    assert result.exit_code == 1
    assert result.stdout.startswith("# Diagnosis of this machine\n")
    assert "## the file is missing" in result.stdout


def test_nothing_is_changed_without_fix(run: Run, sick) -> None:
    cure = sick()
    assert run("--only", "cure").exit_code == 1
    assert not cure.exists()


def test_fix_plays_what_is_safe_and_judges_what_is_then(run: Run, sick) -> None:
    cure = sick()
    result = run("--only", "cure", "--fix")
    assert result.exit_code == 0, result.output
    assert "played" in result.stderr
    assert result.stdout == "healthy; 1 check\n"
    assert cure.read_text() == "well"


def test_fix_leaves_what_is_not_safe_to_a_person_and_yes_speaks_for_one(run: Run, sick) -> None:
    cure = sick(safe=False)
    assert run("--only", "cure", "--fix").exit_code == 1
    assert not cure.exists()
    assert run("--only", "cure", "--fix", "--yes").exit_code == 0
    assert cure.exists()


def test_a_question_that_is_not_answered_plays_nothing_and_ends_like_an_interrupt(run: Run, sick, monkeypatch) -> None:
    cure, consent = sick(safe=False), doctor._Consent
    monkeypatch.setattr(doctor, "_Consent", lambda yes, interactive: consent(yes, interactive=True))
    result = run("--only", "cure", "--fix")  # its input ends at once, as Ctrl-C would end it
    assert result.exit_code == doctor.INTERRUPTED == 130
    assert "Play" in result.output and "debug" not in result.output and not cure.exists()


def test_a_dry_run_shows_what_fix_would_do_and_does_nothing(run: Run, sick) -> None:
    cure = sick()
    result = run("--only", "cure", "--fix", "--dry-run")
    assert result.exit_code == 1
    assert "would play" in result.stderr
    assert not cure.exists()


def test_a_cure_that_does_not_cure_is_played_once_and_leaves_status_1(run: Run, sick) -> None:
    sick(mends=False)
    result = run("--only", "cure", "--fix", "--json")
    told = json.loads(result.stdout)
    assert result.exit_code == 1
    assert [(each["state"], each["changed"]) for each in told["treatments"]] == [("done", 1)]
    assert [finding["id"] for finding in told["findings"]] == ["cure-missing"]


def test_a_playbook_that_is_not_there_is_said_to_be_refused(run: Run, tmp_path: Path, sick) -> None:
    sick()
    (tmp_path / "mend.yaml").unlink()
    result = run("--only", "cure", "--fix", "--json")
    (treatment,) = json.loads(result.stdout)["treatments"]
    assert (result.exit_code, treatment["state"]) == (1, "refused")


def test_a_check_that_breaks_is_the_doctors_failure_and_is_named(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def find(evidence: Evidence) -> list[Finding]:
        raise RuntimeError("a defect")

    monkeypatch.setattr(
        checks_table, "plugged_in", lambda: ((Check("theirs", find),), ("plug-in other (a:b): ImportError: x",))
    )
    result = run("--only", "theirs")
    assert result.exit_code == 4
    assert "check theirs: RuntimeError: a defect" in result.stdout
    assert "plug-in other" in result.stdout


def test_every_check_is_listed_with_what_it_looks_for(run: Run) -> None:
    lines = run("--list").stdout.splitlines()
    assert len(lines) == len(checks_table.built_in())
    assert all(len(line.split(None, 1)) == 2 for line in lines)


def test_every_playbook_that_a_check_names_is_shipped_and_takes_its_variables() -> None:
    named = set()
    for module in checks_table.MODULES:
        tree = ast.parse(Path(importlib.import_module(module).__file__ or "").read_text())
        words = [node for node in ast.walk(tree) if isinstance(node, ast.keyword) and node.arg == "playbook"]
        named |= {word.value.value for word in words if isinstance(word.value, ast.Constant) and word.value.value}
    assert named
    for name in named:
        assert load(name).name == name


def test_the_doctor_starts_without_what_only_a_robot_needs() -> None:
    code = (
        "import sys; from lupin_cli.commands import doctor; doctor._checks((), ()); "
        "print([m for m in ('paramiko', 'rclpy', 'rich', 'numpy', 'yaml') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=dict(os.environ))
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


def test_statuses_of_the_command_are_those_of_the_report() -> None:
    names = ("HEALTHY", "ATTENTION", "USAGE", "UNREACHABLE", "FAILED")
    assert [getattr(report, name) for name in names] == [getattr(doctor, name) for name in names] == [0, 1, 2, 3, 4]


def test_a_third_partys_check_is_asked_judged_listed_and_reported_like_any_other(tmp_path: Path) -> None:
    (tmp_path / "their_checks.py").write_text(
        "from lupin_cli.checks import Check, Finding, Fix, Severity\n"
        "from lupin_cli.facts import Fact\n"
        "WATER = Fact('theirs-water', 'echo 0.2', lambda output: float(output.stdout))\n"
        "def find(evidence):\n"
        "    'A tank that runs dry.'\n"
        "    if evidence.laptop.get(WATER) < 0.5:\n"
        "        yield Finding('tank-low', Severity.WARNING, 'laptop', 'dry', 'the tank is low', ('0.2',), Fix('fill it'))\n"
        "CHECKS = [Check('theirs.water', find, laptop=(WATER,))]\n"
    )
    info = tmp_path / "theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[lupin.checks]\nwater = their_checks:CHECKS\nbad = their_checks:NOTHING\n")
    environment = {**os.environ, "HOME": str(tmp_path), "PYTHONPATH": str(tmp_path)}

    def lupin(*words: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "lupin_cli.app", "doctor", *words]
        return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)

    assert any(
        line.split() == ["theirs.water", "A", "tank", "that", "runs", "dry."] for line in lupin("--list").stdout.splitlines()
    )
    done = lupin("--only", "theirs.*", "--json", "--junit", str(tmp_path / "report.xml"))
    told = json.loads(done.stdout)
    assert ([finding["id"] for finding in told["findings"]], done.returncode) == (["tank-low"], 1)
    assert any("plug-in bad" in line for line in told["broken"])
    assert "tank-low" in (tmp_path / "report.xml").read_text()
