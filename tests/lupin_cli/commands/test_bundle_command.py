"""`lupin bundle` on the machine that the test runs on."""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import socket
import subprocess
import sys
import tarfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from lupin_cli.app import app
from lupin_cli.bundle import collect
from lupin_cli.bundle.redact import Redactor
from lupin_cli.checks import Check, Finding, Fix, Severity, Snapshot
from lupin_cli.checks import table as checks_table
from lupin_cli.connection.inventory import Config, Robot
from lupin_cli.connection.local import LocalTarget
from lupin_cli.connection.options import open_target
from lupin_cli.doctor.engine import diagnose
from lupin_cli.doctor.session import DoctorResult
from lupin_cli.facts import Fact, Facts
from lupin_cli.facts.link import Link

Run = Callable[..., Result]
FACT: Fact[object] = Fact("words", "echo 'WIFI_PSK=planted7probe'; echo heard", lambda output: output.stdout.splitlines()[1])


def _find(snapshot: Snapshot) -> Iterator[Finding]:
    evidence = ("the line psk=planted7finding shows it", f"it was {snapshot.laptop.get(FACT)}")
    yield Finding("always-there", Severity.WARNING, "laptop", "symptom", "cause", evidence, Fix("lupin fix"))


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return a function that runs `lupin bundle ...` in an empty folder, with an empty home and only one check.

    Unless a robot is named, it covers only this machine.
    """
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.delenv("LUPIN_CONFIG", raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(checks_table, "built_in", lambda: (Check("always", _find, laptop=(FACT,)),))
    monkeypatch.setattr(checks_table, "plugged_in", lambda: ((), ()))
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)

    def invoke(*words: str) -> Result:
        local = [] if {"--robot", "--host", "--all", "--local"} & set(words) else ["--local"]
        return CliRunner().invoke(app, ["bundle", *local, *words])

    return invoke


@pytest.fixture
def planted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put a secret into each of Lupin's files that a bundle collects; each secret contains `planted7`."""
    config = tmp_path / ".config" / "lupin"
    config.mkdir(parents=True)
    (config / "lupin.toml").write_text('# password: planted7toml\n[robots.pot.addresses]\nwired = "127.0.0.1:1"\n')
    (config / "ros-env.sh").write_text("export ROS_DISCOVERY_SERVER=10.42.0.1:11811\nexport API_TOKEN=planted7exports\n")
    logs = tmp_path / "state" / "lupin" / "runs" / "20261121-100000-abcd" / "logs"
    logs.mkdir(parents=True)
    (logs.parent / "run.json").write_text(json.dumps({"environment": {"GITHUB_TOKEN": "planted7run", "ROS_DOMAIN_ID": "7"}}))
    (logs / "nav.log").write_bytes(b"\0\xff Authorization: Bearer planted7log\nplanted7toml is what I was given\nplan found\n")
    (logs / "pipe.log").symlink_to("/dev/zero")
    journal = tmp_path / "state" / "lupin" / "journal"
    journal.mkdir(parents=True)
    events = [
        {"event": "start", "playbook": "pin-wifi", "variables": {"psk": "planted7variable"}},
        {
            "event": "change",
            "index": 0,
            "before": {"content": "a file of planted7before"},
            "diff": "+psk=planted7diff and more\n",
        },
        {"event": "output", "index": 0, "text": "nmcli c add wifi-sec.psk 'planted7 output'"},
    ]
    torn = '{"event": "change", "before": {"content": "planted7torn'
    (journal / "20261121-100000-pin-wifi.jsonl").write_text("".join(json.dumps(each) + "\n" for each in events) + torn)
    monkeypatch.setenv("LUPIN_PASSWORD", "planted7environment")


def contents(path: Path) -> dict[str, bytes]:
    """Return the files of an archive, by their paths below its folder."""
    with tarfile.open(path) as tar:
        return {entry.name.split("/", 1)[1]: tar.extractfile(entry).read() for entry in tar}  # type: ignore[union-attr]


@pytest.mark.usefixtures("planted")
def test_bundle_of_this_machine_is_complete_without_secrets(run: Run, tmp_path: Path) -> None:
    result = run("--json")
    summary = json.loads(result.stdout)
    path = tmp_path / "work" / summary["path"]
    assert list((tmp_path / "work").iterdir()) == [path]
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.stat().st_size == summary["bytes"]
    found = contents(path)
    assert [name for name, data in found.items() if b"planted7" in data or "planted7" in name] == []
    assert [each["path"] for each in summary["files"]] == list(found)

    assert b"always-there" in found["findings/laptop.md"]
    assert json.loads(found["findings/laptop.json"])["findings"][0]["evidence"][1] == "it was heard"
    assert json.loads(found["laptop/facts.json"])["facts"] == {"words": "heard"}
    assert found["laptop/probes/words.out"] == b"WIFI_PSK=***\nheard\n"
    run_folder = "laptop/run/20261121-100000-abcd"
    assert found[f"{run_folder}/logs/nav.log"].endswith(b"\n*** is what I was given\nplan found\n")
    assert json.loads(found[f"{run_folder}/run.json"])["environment"] == {"GITHUB_TOKEN": "***", "ROS_DOMAIN_ID": "7"}
    journal = found["laptop/playbooks/20261121-100000-pin-wifi.jsonl"].decode().splitlines()
    assert [json.loads(line)["event"] for line in journal] == ["start", "change", "output"]
    assert json.loads(journal[1])["before"] == "left out"
    assert b"127.0.0.1:1" in found["laptop/lupin/lupin.toml"]
    assert b"ROS_DISCOVERY_SERVER=10.42.0.1:11811" in found["laptop/dds/files.txt"]

    manifest = json.loads(found["manifest.json"])
    left_out = {each["path"]: each for each in manifest["left_out"]}
    assert left_out[f"{run_folder}/logs/pipe.log"]["kind"] == "unreadable"
    assert result.exit_code == summary["status"] == 1  # that log could not be read; everything else was
    assert manifest["masked"] == summary["masked"]
    assert summary["masked"]["authorization"] == 1


@pytest.mark.usefixtures("planted")
def test_summary_names_archive_and_masked_kinds(run: Run) -> None:
    result = run("--out", "b.tar.gz")
    assert "b.tar.gz: " in result.stdout
    assert "masked: 1 authorization, " in result.stdout
    assert "look through it before you send it" in result.stdout
    assert "masking ..." in result.stderr


@pytest.mark.usefixtures("planted")
def test_dry_run_lists_files_and_writes_nothing(run: Run, tmp_path: Path) -> None:
    result = run("--dry-run")
    assert "laptop/run/20261121-100000-abcd/logs/nav.log" in result.stdout
    assert "pipe.log: unreadable: " in result.stdout
    assert "nothing was written" in result.stdout
    assert "planted7" not in result.stdout
    assert list((tmp_path / "work").iterdir()) == []


def test_existing_archive_is_overwritten_only_with_force(run: Run, tmp_path: Path) -> None:
    existing = tmp_path / "work" / "b.tar.gz"
    existing.write_bytes(b"mine")
    result = run("--out", "b.tar.gz")
    assert (result.exit_code, existing.read_bytes()) == (2, b"mine")
    assert "--force" in result.stderr
    assert run("--out", "b.tar.gz", "--force").exit_code == 0
    assert "findings/laptop.json" in contents(existing)


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["--robot", "a", "--host", "b"], "exclude each other"),
        (["--all", "--robot", "a"], "--all and --robot exclude each other"),
        (["--since", "yesterday"], "90s, 30m, 1h or 2d"),
        (["--since", "0h"], "90s, 30m, 1h or 2d"),
        (["--out", "no/such/folder/b.tar.gz"], "there is no folder"),
        (["--all"], "has no robots"),
        (["--robot", "pto", "--config", "/no/lupin.toml"], "no such file"),
    ],
)
def test_usage_error_exits_before_any_probe(run: Run, words: list[str], hint: str, tmp_path: Path) -> None:
    result = run(*words)
    assert (result.exit_code, result.stdout) == (2, "")
    assert hint in result.stderr
    assert list((tmp_path / "work").iterdir()) == []


def test_unreachable_robot_is_named_and_rest_is_collected(run: Run) -> None:
    with socket.socket() as holder:  # bound but not listening: connections are refused, and no other program gets the port
        holder.bind(("127.0.0.1", 0))
        result = run("--host", f"127.0.0.1:{holder.getsockname()[1]}", "--out", "b.tar.gz", "--json")
    summary = json.loads(result.stdout)
    assert result.exit_code == summary["status"] == 3
    (robot,) = summary["robots"]
    assert robot["unreachable"] == "refused"
    found = contents(Path("b.tar.gz"))
    assert "laptop/facts.json" in found
    folder = f"robots/{robot['name']}"
    assert json.loads(found[f"{folder}/link.json"])["kind"] == "refused"
    assert {"path": folder, "kind": "unreachable", "reason": robot["message"]} in json.loads(found["manifest.json"])["left_out"]


def test_several_robots_are_collected_into_one_archive(run: Run, tmp_path: Path) -> None:
    inventory = tmp_path / "lupin.toml"
    names = ("pot-1", "pot-2", "tray")
    inventory.write_text("".join(f'[robots.{name}.addresses]\nwired = "127.0.0.1:1"\n' for name in names))
    result = run("--all", "--limit", "pot-*", "--config", str(inventory), "--out", "b.tar.gz", "--json")
    assert result.exit_code == 3
    found = contents(Path("b.tar.gz"))
    assert {name.split("/")[1] for name in found if name.startswith("robots/")} == {"pot-1", "pot-2"}
    assert {"findings/pot-1.md", "findings/pot-2.md"} <= set(found)


@pytest.mark.usefixtures("planted")
def test_logs_are_collected_if_doctor_fails(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("no doctor today")

    monkeypatch.setattr("lupin_cli.bundle.collect.DoctorSession.examine", broken)
    result = run("--out", "b.tar.gz")
    assert result.exit_code == 1
    assert "findings: failed: the doctor failed: RuntimeError: no doctor today" in result.stdout
    assert "laptop/run/20261121-100000-abcd/logs/nav.log" in contents(Path("b.tar.gz"))


@pytest.mark.usefixtures("planted")
def test_full_disk_exits_with_4_and_leaves_no_file(run: Run, tmp_path: Path) -> None:
    log = tmp_path / "state" / "lupin" / "runs" / "20261121-100000-abcd" / "logs" / "noise.log"
    log.write_bytes(random.Random(7).randbytes(600_000))  # incompressible
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, hard))  # simulates a full disk
    try:
        result = run("--out", "b.tar.gz", "--json")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert result.exit_code == json.loads(result.stdout)["error"]["exit_code"] == 4
    assert "b.tar.gz cannot be written: File too large" in result.stderr
    assert list((tmp_path / "work").iterdir()) == []


@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_bundle_leaves_no_file(signal_number: signal.Signals, tmp_path: Path) -> None:
    environment = {**os.environ, "HOME": str(tmp_path), "XDG_STATE_HOME": str(tmp_path / "state")}
    (tmp_path / "work").mkdir()
    process = subprocess.Popen(
        [sys.executable, "-m", "lupin_cli.app", "bundle", "--local"],
        cwd=tmp_path / "work",
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stderr is not None
        assert "running the doctor's probes" in process.stderr.readline()
        process.send_signal(signal_number)
        assert process.wait(60) == 130
    finally:
        process.kill()
        process.communicate()
    assert list((tmp_path / "work").iterdir()) == []


def test_typed_passwords_are_masked(tmp_path: Path) -> None:
    robot = Robot("pot", {"wired": "127.0.0.1:1"})
    collector = collect.Collector((), (), LocalTarget(), [robot], Config(tmp_path / "lupin.toml"), {"pot": "typed for sudo"})
    (session,) = collector.sessions
    snapshot = Snapshot(Facts("laptop", {}), None, Link("pot", "127.0.0.1"))
    collector._results[session] = DoctorResult(snapshot, diagnose((), snapshot))
    session._target = open_target(robot, Config(tmp_path / "lupin.toml"), sudo_password="typed at the login")
    assert set(collector.secrets) == {"typed for sudo", "typed at the login"}
    assert Redactor(collector.secrets).redact_text("(typed at the login) typed for sudo") == "(***) ***"
