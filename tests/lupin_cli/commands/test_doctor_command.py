"""`lupin doctor` on the command line: exit statuses, output formats, and --fix."""

from __future__ import annotations

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

from lupin_cli.app import app
from lupin_cli.checks import Check, Finding, Fix, Gap, Severity, Snapshot
from lupin_cli.checks import table as checks_table
from lupin_cli.checks.table import built_in, select
from lupin_cli.commands import doctor
from lupin_cli.connection import Output
from lupin_cli.doctor.session import DoctorSession, FixResult
from lupin_cli.facts import Fact

Run = Callable[..., Result]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return a function that runs `lupin doctor ...` with an empty home folder, on this machine unless a robot is named."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    def invoke(*words: str) -> Result:
        local = [] if {"--robot", "--host", "--all", "--limit", "--local"} & set(words) else ["--local"]
        return CliRunner().invoke(app, ["doctor", *local, *words])

    return invoke


@pytest.fixture
def refused() -> Iterator[str]:
    """Yield an address that refuses SSH connections."""
    with socket.socket() as holder:  # bound and not listening: connections are refused, and no other program gets the port
        holder.bind(("127.0.0.1", 0))
        yield f"127.0.0.1:{holder.getsockname()[1]}"


def read(output: Output) -> str:
    return output.stdout.strip()


@pytest.fixture
def add_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Return a function that plugs in a check, which reports a problem until its playbook has created a marker file."""

    def add(*, safe: bool = True, effective: bool = True) -> Path:
        marker, playbook = tmp_path / "marker", tmp_path / "create-marker.yaml"
        created = marker if effective else tmp_path / "elsewhere"
        playbook.write_text(
            "name: create-marker\n"
            "description: The marker exists.\n"
            "steps:\n"
            "  - name: The marker exists\n"
            "    on: laptop\n"
            f"    file: {{path: {created}, content: 'fixed'}}\n"
        )
        fact = Fact("marker", f"[ -e {marker} ] && echo present; exit 0", read)
        finding = Finding(
            "marker-missing", Severity.PROBLEM, "laptop", "it fails", "the marker is missing", ("ls: no such file",),
            Fix(f"touch {marker}", str(playbook), safe=safe),
        )  # fmt: skip

        def find(snapshot: Snapshot) -> Iterator[Finding]:
            if not snapshot.laptop.get(fact):
                yield finding

        check = Check("marker", find, laptop=(fact,))
        monkeypatch.setattr(checks_table, "plugged_in", lambda: ((check,), ()))
        return marker

    return add


def test_machine_without_findings_prints_one_line(run: Run) -> None:
    result = run("--only", "link.*")
    assert (result.exit_code, result.output) == (0, "this machine: nothing found, topics were not measured\n")


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["--only", "dds.profile"], "did you mean dds.profiles?"),
        (["--robot", "a", "--host", "b"], "exclude each other"),
        (["--json", "--markdown"], "both print to standard output"),
        (["--fields", "status"], "--fields needs --json"),
        (["--json", "--fields", "state"], "there is no field 'state' in status, robot, findings"),
        (["--yes"], "need --fix"),
        (["--dry-run"], "need --fix"),
        (["--all", "--watch"], "--watch examines one robot"),
        (["--limit", "pot-*"], "--limit needs --all"),
        (["--all", "--robot", "pot-1"], "--all --limit"),
        (["--local", "--robot", "pot-1"], "--local is this machine"),
        (["--all"], "has no robots"),
    ],
)
def test_contradicting_options_exit_2(run: Run, words: list[str], hint: str) -> None:
    result = run(*words)
    assert result.exit_code == 2
    assert hint in result.stderr
    assert "--json" in words or result.stdout == ""


def test_unknown_robot_suggests_the_nearest_name(run: Run, tmp_path: Path) -> None:
    inventory = tmp_path / "lupin.toml"
    inventory.write_text('[robots.greenhouse.addresses]\nwired = "10.42.0.1"\n')
    result = run("--robot", "greenhose", "--config", str(inventory))
    assert result.exit_code == 2
    assert "did you mean greenhouse?" in result.stderr


def test_default_robot_is_examined_without_arguments(tmp_path: Path, refused: str, run: Run) -> None:
    inventory = tmp_path / "lupin.toml"
    inventory.write_text("".join(f'[robots.{name}.addresses]\nwired = "{refused}"\n' for name in ("pot-1", "pot-2")))
    doctor_alone = ["doctor", "--config", str(inventory), "--only", "link.*", "--json"]
    undecided = CliRunner().invoke(app, doctor_alone)
    assert undecided.exit_code == 2 and "which robot? name one of pot-1, pot-2" in undecided.stderr
    inventory.write_text(f'default_robot = "pot-2"\n{inventory.read_text()}')
    examined = CliRunner().invoke(app, doctor_alone)
    assert (examined.exit_code, json.loads(examined.stdout)["robot"]["name"]) == (3, "pot-2")
    local = run("--local", "--config", str(inventory), "--only", "link.*", "--json")
    assert (local.exit_code, json.loads(local.stdout)["robot"]) == (0, None)


def test_chosen_fields_are_all_that_json_contains(run: Run, refused: str) -> None:
    result = run("--host", refused, "--only", "link.*", "--json", "--fields", "status, findings.id,robot.unreachable")
    assert result.exit_code == 3
    assert json.loads(result.stdout) == {
        "status": 3,
        "findings": [{"id": "robot-unreachable"}],
        "robot": {"unreachable": "refused"},
    }


def test_unreachable_robot_is_diagnosed_with_exit_3(run: Run, refused: str) -> None:
    result = run("--host", refused, "--only", "link.*", "--json")
    assert result.exit_code == 3
    output = json.loads(result.stdout)
    assert output["robot"]["unreachable"] == "refused"
    assert [finding["id"] for finding in output["findings"]] == ["robot-unreachable"]


def test_several_robots_exit_with_the_worst_status(run: Run, tmp_path: Path, refused: str) -> None:
    inventory = tmp_path / "lupin.toml"
    inventory.write_text("".join(f'[robots.{name}.addresses]\nwired = "{refused}"\n' for name in ("pot-1", "pot-2")))
    result = run("--all", "--config", str(inventory), "--only", "link.*", "--json")
    assert result.exit_code == 3
    assert [robot["robot"]["name"] for robot in json.loads(result.stdout)["robots"]] == ["pot-1", "pot-2"]


def test_junit_report_has_a_case_for_every_check(run: Run, tmp_path: Path, add_fault: Callable[..., Path]) -> None:
    add_fault()
    report = tmp_path / "report.xml"
    result = run("--only", "link.*", "--only", "marker", "--junit", str(report))
    assert result.exit_code == 1
    (suite,) = ElementTree.parse(report).getroot()
    number = len(select(built_in(), only=["link.*"])) + 1
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == (str(number), "1", "0")


def test_unwritable_report_exits_4(run: Run, tmp_path: Path) -> None:
    result = run("--only", "link.*", "--junit", str(tmp_path / "nowhere" / "report.xml"))
    assert result.exit_code == 4
    assert "nowhere" in result.stderr


def test_markdown_is_alone_on_standard_output(run: Run, add_fault: Callable[..., Path]) -> None:
    add_fault()
    result = run("--only", "marker", "--markdown")
    assert result.exit_code == 1
    assert result.stdout.startswith("# Diagnosis of this machine\n")
    assert "## the marker is missing" in result.stdout


def test_nothing_is_changed_without_fix(run: Run, add_fault: Callable[..., Path]) -> None:
    marker = add_fault()
    assert run("--only", "marker").exit_code == 1
    assert not marker.exists()


def test_fix_plays_safe_fixes_and_examines_again(run: Run, add_fault: Callable[..., Path]) -> None:
    marker = add_fault()
    result = run("--only", "marker", "--fix")
    assert result.exit_code == 0, result.output
    assert "played" in result.stderr
    assert result.stdout == "this machine: nothing found, topics were not measured\n"
    assert marker.read_text() == "fixed"


def test_fix_plays_unsafe_fixes_only_with_yes(run: Run, add_fault: Callable[..., Path]) -> None:
    marker = add_fault(safe=False)
    assert run("--only", "marker", "--fix").exit_code == 1
    assert not marker.exists()
    assert run("--only", "marker", "--fix", "--yes").exit_code == 0
    assert marker.exists()


def test_unanswered_question_plays_nothing_and_exits_130(
    run: Run, add_fault: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    marker, consent = add_fault(safe=False), doctor._Consent
    monkeypatch.setattr(doctor, "_Consent", lambda yes, **_: consent(yes, interactive=True))
    result = run("--only", "marker", "--fix")  # the empty standard input acts like Ctrl-C at the question
    assert result.exit_code == 130
    assert "Play" in result.output and "debug" not in result.output and not marker.exists()


def test_dry_run_shows_fixes_and_changes_nothing(run: Run, add_fault: Callable[..., Path]) -> None:
    marker = add_fault()
    result = run("--only", "marker", "--fix", "--dry-run")
    assert result.exit_code == 1
    assert "would play" in result.stderr
    assert not marker.exists()


def test_dry_run_of_fixes_asks_nothing_and_shows_all(
    run: Run, add_fault: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    marker = add_fault(safe=False)
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    result = run("--only", "marker", "--fix", "--dry-run")
    assert result.exit_code == 1 and "would play" in result.stderr and "Play " not in result.output
    assert not marker.exists()


def test_ineffective_fix_is_played_once_and_exits_1(run: Run, add_fault: Callable[..., Path]) -> None:
    add_fault(effective=False)
    result = run("--only", "marker", "--fix", "--json")
    output = json.loads(result.stdout)
    assert result.exit_code == 1
    assert [(each["state"], each["changed"]) for each in output["fixes"]] == [("done", 1)]
    assert output["treatments"] == output["fixes"]
    assert [finding["id"] for finding in output["findings"]] == ["marker-missing"]


def test_missing_playbook_is_reported_as_refused(run: Run, tmp_path: Path, add_fault: Callable[..., Path]) -> None:
    add_fault()
    (tmp_path / "create-marker.yaml").unlink()
    result = run("--only", "marker", "--fix", "--json")
    (fix,) = json.loads(result.stdout)["fixes"]
    assert (result.exit_code, fix["state"]) == (1, "refused")


def test_raising_check_is_named_and_exits_4(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def find(_snapshot: Snapshot) -> list[Finding]:
        raise RuntimeError("a defect")

    monkeypatch.setattr(
        checks_table, "plugged_in", lambda: ((Check("theirs", find),), (Gap("plug-in", "other (a:b)", "ImportError: x"),))
    )
    result = run("--only", "theirs")
    assert result.exit_code == 4
    assert "check theirs: RuntimeError: a defect" in result.stdout
    assert "plug-in other" in result.stdout


def test_list_shows_every_check_with_its_description(run: Run) -> None:
    lines = run("--list").stdout.splitlines()
    assert len(lines) == len(checks_table.built_in())
    assert all(len(line.split(None, 1)) == 2 for line in lines)


def test_doctor_imports_no_robot_libraries_at_start() -> None:
    code = (
        "import sys; from lupin_cli.commands import doctor; doctor._checks((), ()); "
        "print([m for m in ('paramiko', 'rclpy', 'rich', 'numpy', 'yaml') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=dict(os.environ))
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


def test_third_party_check_is_run_and_reported(tmp_path: Path) -> None:
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
    done = lupin("--local", "--only", "theirs.*", "--json", "--junit", str(tmp_path / "report.xml"))
    output = json.loads(done.stdout)
    assert ([finding["id"] for finding in output["findings"]], done.returncode) == (["tank-low"], 1)
    assert any("plug-in bad" in line for line in output["broken"])
    assert "tank-low" in (tmp_path / "report.xml").read_text()


@pytest.mark.parametrize(("answer", "played"), [(None, False), (False, False), (True, True)], ids=["no terminal", "no", "yes"])
def test_loss_of_memory_is_announced_before_the_login_ends(
    monkeypatch: pytest.MonkeyPatch, run: Run, answer: bool | None, played: bool
) -> None:
    fix = Fix("lupin play keep-shared-memory --robot pot", "keep-shared-memory", safe=True)
    risk = Finding("shared-memory-at-risk", Severity.WARNING, "robot", "s", "c", ("e",), fix)
    calls: list[str] = []

    def play(_session: DoctorSession, finding: Finding) -> FixResult:
        calls.append(finding.fix.playbook)
        return FixResult(finding.id, finding.fix.playbook, "done", 2)

    monkeypatch.setattr(DoctorSession, "find_endangered_memory", lambda *_: risk)
    monkeypatch.setattr(DoctorSession, "play_fix", play)
    monkeypatch.setattr(DoctorSession, "close", lambda _: calls.append("logout"))
    monkeypatch.setattr(doctor, "is_interactive", lambda: answer is not None)
    monkeypatch.setattr(doctor, "confirm", lambda _: answer)
    result = run("--only", "link.*")
    assert "ten seconds after this login ends" in result.stderr
    assert calls == (["keep-shared-memory", "logout"] if played else ["logout"])
    assert ("keep it with: lupin play keep-shared-memory --robot pot" in result.stderr) != played
