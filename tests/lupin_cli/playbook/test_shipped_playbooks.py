"""The shipped playbooks are valid, and every name in them exists."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.connection.local import LocalTarget
from lupin_cli.package_data import shipped_folder
from lupin_cli.playbook import Playbook, list_shipped, load, play
from lupin_cli.playbook.binding import Binding
from lupin_cli.playbook.templates import names_in

EXPECTED = {
    "deploy-robot", "remove-robot", "deploy-laptop", "remove-laptop", "sync-clock", "install-clock-sync", "recover-discovery",
    "single-home", "demo-wired", "demo-router", "demo-access-point", "sweep", "heal", "pin-wifi",
}  # fmt: skip


def test_expected_playbooks_are_shipped() -> None:
    assert {path.stem for path in list_shipped()} >= EXPECTED


@pytest.mark.parametrize("path", list_shipped(), ids=lambda path: path.stem)
def test_shipped_playbook_is_valid(path: Path) -> None:
    book = load(path)
    assert book.description.endswith(".") and len(book.description) < 128
    names = [step.name for step in book.steps]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("path", list_shipped(), ids=lambda path: path.stem)
def test_shipped_playbook_defaults_are_valid_arguments(path: Path) -> None:
    book = load(path)
    samples = {"text": "some", "secret": "long enough", "address": "10.0.0.7", "integer": 4711, "list": ["source ~/setup.bash"]}
    given = {variable.name: samples[variable.type] for variable in book.variables if not variable.has_default}
    Binding(book, given, {"robot": LocalTarget("robot"), "laptop": LocalTarget()})


def test_playbooks_named_by_findings_are_shipped() -> None:
    checks = shipped_folder("playbooks").parent / "lupin_cli" / "checks"
    named = {name for path in checks.glob("*.py") for name in re.findall(r'playbook="([^"]+)"', path.read_text())}
    assert named and named <= {path.stem for path in list_shipped()}


SCRIPTS = ("run", "unless", "reverse", "creates")
WITHOUT_SPECIAL_CHARACTERS = ("address", "integer", "network", "number", "truth")


def names_in_scripts(book: Playbook) -> Iterator[tuple[str, str, str]]:
    """Yield step, argument and type of each variable that enters a script as text; a result has the type `result`."""
    for step in book.steps:
        types = {variable.name: variable.type for variable in step.frame.variables}
        for argument in set(SCRIPTS) & set(step.arguments) if step.operation.name in ("probe", "command") else ():
            for name in names_in(step.arguments[argument][0]):
                yield step.name, argument, types.get(name.path[0], "result")


@pytest.mark.parametrize("path", list_shipped(), ids=lambda path: path.stem)
def test_no_text_of_an_operator_becomes_part_of_a_script(path: Path) -> None:
    """A WiFi may be called Ada's pot. Such text goes into `arguments`, which are quoted."""
    assert [each for each in names_in_scripts(load(path)) if each[2] not in WITHOUT_SPECIAL_CHARACTERS] == []


def script_of(playbook: str, step_name: str, results: dict[str, dict[str, Any]], **variables: Any) -> str:
    """Return the script of a step, after earlier steps with these results."""
    book = load(playbook)
    binding = Binding(book, variables, {"robot": LocalTarget("robot"), "laptop": LocalTarget()})
    for each in book.steps:
        if each.result in results:
            binding.remember(each, results[each.result])
    (step,) = (each for each in book.steps if each.name.endswith(step_name))
    script = binding.operation(step).probe()
    assert script is not None
    return script.text


def test_allowed_networks_are_kept_without_what_is_none(tmp_path: Path) -> None:
    file = tmp_path / "lupin-server.conf"
    conf = {"folder": str(tmp_path), "main": ""}
    script = script_of("serve-clock", "Read which networks are allowed, with this one", {"conf": conf}, network="10.42.0.9/24")
    assert subprocess.check_output(["sh", "-c", script], text=True) == "allow 10.42.0.0/24\n"
    lines = ["192.168.42.0/24", "10.42.0.0/33", "10.42.0/24", "10.256.0.0/16", "pot", "10.42.0.0/24", "172.16.0.0/9 x"]
    file.write_text("# ours\n" + "".join(f"allow {line}\n" for line in lines) + "local stratum 10\n")
    printed = subprocess.check_output(["sh", "-c", script], text=True)
    assert printed == "allow 10.42.0.0/24\nallow 192.168.42.0/24\n"


NMCLI = r"""#!/bin/sh
case $* in
  *"RUNNING general") echo running ;;
  "-g connection.id connection show id Ada's pot: 2") echo "Ada's pot: 2" ;;
  *"connection show id Ada's pot: 2") echo 0 ;;
  *) exit 10 ;;
esac
"""


@pytest.mark.parametrize(
    ("ssid", "state"), [("Ada's pot: 2", "would-change"), ("Ada", "skipped"), ("x'; touch /x; '", "skipped")]
)
def test_wifi_of_any_name_is_found(ssid: str, state: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "nmcli").write_text(NMCLI)
    (tmp_path / "nmcli").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    planned = play("pin-wifi", {"laptop": LocalTarget()}, {"connection": ssid}, dry_run=True)
    assert (planned.state, planned.steps[-1].state) == ("done", state), planned.message


def test_stack_is_started_whatever_happens_to_the_board() -> None:
    steps = load("recover-board").steps
    names = [step.operation.name for step in steps]
    restart = names.index("motor-board")
    stop, start = steps[restart - 1], steps[restart + 1]
    assert (stop.name, start.name) == ("Stop the vendor's stack", "Start the vendor's stack")
    assert stop.confirm is not None and all(step.always for step in steps[restart + 1 : -1])


def test_stopped_process_continues_by_its_number() -> None:
    assert "kill -CONT 4711\n" in f"{script_run('resume-process', pid=4711)}\n"


def script_run(playbook: str, **variables: Any) -> str:
    book = load(playbook)
    operation: Any = Binding(book, variables, {"robot": LocalTarget("robot")}).operation(book.steps[0])
    return str(operation.run)
