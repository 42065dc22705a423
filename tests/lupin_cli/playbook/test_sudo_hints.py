"""What an operator is told to type when sudo needs a password: another thing on the laptop than on a robot."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from lupin_cli.connection.base import RootRefused
from lupin_cli.connection.local import LocalTarget
from lupin_cli.operations.shell import query
from lupin_cli.playbook import Playbook, find_playbook_run, play
from lupin_cli.playbook.undo import undo
from lupin_cli.printed_commands import complete

LoadPlaybook = Callable[..., Playbook]
Targets = dict[str, LocalTarget]
SUDO = "#!/bin/sh\n[ -e {folder}/asked ] || {{ echo 'sudo: a password is required' >&2; exit 1; }}\nexit 0\n"
AS_ROOT = """
steps:
- name: become root
  on: MACHINE
  file: {path: FOLDER/file, content: x, root: true}
"""
BY_COMMAND = """
steps:
- name: become root
  on: MACHINE
  command: {run: touch FOLDER/file, creates: FOLDER/file, reverse: rm FOLDER/file, root: true}
"""


@pytest.fixture
def refusing_sudo(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A user whose sudo needs a password that nobody has typed."""
    program = tmp_path / "bin" / "sudo"
    program.parent.mkdir()
    program.write_text(SUDO.format(folder=tmp_path))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    id_program = tmp_path / "bin" / "id"
    id_program.write_text("#!/bin/sh\necho 1000\n")
    id_program.chmod(0o755)


class Robot(LocalTarget):
    """This machine as a robot that others log in to."""

    def __init__(self) -> None:
        super().__init__("pot")
        self.login_command = "ssh mirte@10.42.0.1"


@pytest.mark.usefixtures("refusing_sudo")
def test_refused_probe_names_what_helps_on_its_machine() -> None:
    for target, expected in ((LocalTarget(), "sudo -v"), (Robot(), "lupin robots check pot --ask-sudo-password")):
        with pytest.raises(RootRefused, match="a password is required") as refused:
            query(target, "true", root=True)
        assert refused.value.next_command == expected


@pytest.mark.usefixtures("refusing_sudo")
@pytest.mark.parametrize("body", [AS_ROOT, BY_COMMAND])
@pytest.mark.parametrize("machine", ["laptop", "robot"])
def test_refused_step_names_what_helps_on_its_machine(
    load_playbook: LoadPlaybook, tmp_path: Path, body: str, machine: str
) -> None:
    playbook = load_playbook(body.replace("MACHINE", machine).replace("FOLDER", str(tmp_path)))
    targets = {"laptop": LocalTarget(), "robot": Robot()}
    result = play(playbook, targets, journal=tmp_path / "journal")
    again = f"lupin play {tmp_path}/book.yaml --robot pot --resume"
    expected = f"sudo -v && {again}" if machine == "laptop" else f"{again} --ask-sudo-password"
    assert (result.state, result.next_command) == ("failed", expected), result.message
    assert complete(result.next_command) == expected, "it is printed as it is"


@pytest.mark.parametrize("body", [AS_ROOT, BY_COMMAND])
@pytest.mark.parametrize("machine", ["laptop", "robot"])
def test_refused_undo_names_what_helps_on_its_machine(
    load_playbook: LoadPlaybook, tmp_path: Path, body: str, machine: str, request: pytest.FixtureRequest
) -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root, to make the change")
    playbook = load_playbook(body.replace("MACHINE", machine).replace("FOLDER", str(tmp_path)))
    targets = {"laptop": LocalTarget(), "robot": Robot()}
    run = find_playbook_run(play(playbook, targets, journal=tmp_path / "journal").run, tmp_path / "journal")
    assert (tmp_path / "file").exists()
    request.getfixturevalue("refusing_sudo")
    refused = undo(run, targets, journal=tmp_path / "journal")
    again = f"lupin play {tmp_path}/book.yaml --robot pot --undo {run.run}"
    expected = f"sudo -v && {again}" if machine == "laptop" else f"{again} --ask-sudo-password"
    assert (refused.state, refused.next_command) == ("failed", expected), refused.message
