"""pyinfra and Ansible, installed once into a cache folder, and configured to be as fast as possible with one robot."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

REQUIREMENTS = Path(__file__).with_name("requirements.lock")
INSTALL_TIMEOUT_S = 900.0


def install_tools() -> Path:
    """Install both tools on first use, which takes a minute; return the folder with their programs.

    The name of its parent contains a hash of the pinned versions. Exits with the reason if they cannot be installed.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "lupin-bench"
    cache.mkdir(parents=True, exist_ok=True)
    pins_hash = hashlib.sha256(REQUIREMENTS.read_bytes() + sys.version.encode()).hexdigest()[:12]
    folder = cache / f"peers-{pins_hash}"
    with os.fdopen(os.open(cache / "lock", os.O_WRONLY | os.O_CREAT, 0o600), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "complete").exists():
            print(
                f"installing pyinfra and Ansible into {folder}; this takes a minute, and happens once",
                file=sys.stderr,
                flush=True,
            )
            pip = [str(folder / "bin" / "python"), "-m", "pip", "install", "-q", "--disable-pip-version-check"]
            pip += ["--no-deps", "--require-hashes"]
            for command in (
                [sys.executable, "-m", "venv", "--clear", str(folder)],
                [*pip, "-r", str(REQUIREMENTS)],
            ):
                done = subprocess.run(command, capture_output=True, text=True, timeout=INSTALL_TIMEOUT_S, check=False)
                if done.returncode != 0:
                    raise SystemExit(
                        "pyinfra and Ansible could not be installed, so nothing was measured. To measure without them, add "
                        f"--no-peers.\n{done.stderr[-800:]}"
                    )
            (folder / "complete").touch()
    return folder / "bin"


@dataclass(frozen=True)
class PeerTools:
    """pyinfra and Ansible, configured for one robot.

    Their programs are in `bin_folder`; their configuration, caches and output are in `folder`.
    """

    bin_folder: Path
    folder: Path
    address: str
    user: str
    key: Path
    known_hosts: Path

    def __post_init__(self) -> None:
        for name, text in (
            ("ansible.cfg", self._ansible_cfg()),
            ("hosts.ini", self._hosts()),
            *(
                (f"inventory-{'-'.join(machines)}.py", self._inventory(machines))
                for machines in (("robot",), ("robot", "laptop"))
            ),
        ):
            (self.folder / name).write_text(text)

    @property
    def ssh_options(self) -> str:
        """Options of OpenSSH: one shared connection, which is opened before a tool runs and stays open after it."""
        shared = f"-o ControlMaster=auto -o ControlPersist=600s -o ControlPath={self.folder}/m"
        return f"-F none -i {self.key} -o IdentitiesOnly=yes -o UserKnownHostsFile={self.known_hosts} {shared}"

    def _ansible_cfg(self) -> str:
        # No gathering of Ansible's own facts, no temporary files on the robot, no search for Python, one connection.
        return f"""[defaults]
inventory = {self.folder}/hosts.ini
gathering = explicit
interpreter_python = /usr/bin/python3
local_tmp = {self.folder}/ansible-tmp
home = {self.folder}/ansible-home
retry_files_enabled = False
nocows = True
[connection]
pipelining = True
[ssh_connection]
pipelining = True
ssh_args = {self.ssh_options}
"""

    def _hosts(self) -> str:
        return f"robot ansible_host={self.address} ansible_user={self.user}\nlaptop ansible_connection=local\n"

    def _inventory(self, machines: Sequence[str]) -> str:
        data: dict[str, Any] = {"ssh_user": self.user, "ssh_key": str(self.key), "ssh_known_hosts_file": str(self.known_hosts)}
        data |= {"ssh_allow_agent": False, "ssh_look_for_keys": False}
        hosts = {"robot": f"({self.address!r}, {data!r})", "laptop": "'@local'"}
        return f"hosts = [{', '.join(hosts[machine] for machine in machines)}]\n"

    @property
    def environment(self) -> dict[str, str]:
        """The environment of both tools; it contains nothing of this project."""
        return {
            "PATH": f"{self.bin_folder}:/usr/bin:/bin:/usr/sbin:/sbin",
            "HOME": str(self.folder),
            "LC_ALL": "C.UTF-8",
            "ANSIBLE_CONFIG": str(self.folder / "ansible.cfg"),
        }

    def pyinfra_command(self, name: str, text: str, data: Mapping[str, Any], machines: Sequence[str] = ("robot",)) -> list[str]:
        """Return the command that runs the deploy `text` on these machines; the deploy finds `data` as DATA."""
        path = self.folder / f"{name}.py"
        path.write_text(f"import json\nDATA = json.loads({json.dumps(data)!r})\n{text}")
        return [str(self.bin_folder / "pyinfra"), "-y", str(self.folder / f"inventory-{'-'.join(machines)}.py"), str(path)]

    def ansible_command(self, name: str, plays: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[str]:
        """Return the command that runs a playbook of these tasks, which are grouped by host pattern."""
        path = self.folder / f"{name}.yml"
        path.write_text(
            yaml.dump([{"hosts": h, "gather_facts": False, "tasks": list(t)} for h, t in plays.items()], Dumper=_Dumper)
        )
        return [str(self.bin_folder / "ansible-playbook"), str(path)]

    def shared_connection_command(self, verb: str) -> list[str]:
        """Return the command that opens the shared connection ("open") or closes it ("exit").

        After "open", ssh runs on in the background with its standard streams open: do not wait for the end of its output.
        """
        action = ["-fN"] if verb == "open" else ["-O", verb]
        return ["ssh", *self.ssh_options.split(), *action, f"{self.user}@{self.address}"]


class Unsafe(str):
    """Text that Ansible must not treat as a template."""


class _Dumper(yaml.SafeDumper):
    pass


_Dumper.add_representer(Unsafe, lambda dumper, text: dumper.represent_scalar("!unsafe", str(text), style="|"))
