"""A `lupin deploy robot` with nothing to do, as a pyinfra deploy and as an Ansible playbook: they check an installed release.

Three methods to check the release, from the one that the manuals teach to the one that knows as much as Lupin:
  modules  the tools' own modules for a folder: pyinfra's files.sync, Ansible's copy. They check each file separately.
  rsync    one rsync of the folder, as experienced users do; it compares sizes and times. The robot must have rsync.
  link     no file is checked: the release's name is given, and compared with the target of the symlink `current`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.peers.pyinfra_and_ansible import PeerTools, Unsafe

METHODS = ("modules", "rsync", "link")
RSYNC = ("-rlptO", "--itemize-changes")


@dataclass(frozen=True)
class InstalledState:
    """What the robot has installed: a release, whose files are also in the local folder `files`, and root's text files."""

    release: str
    files: Path
    texts: Mapping[str, str]  # by path on the robot
    user: str

    @property
    def folder(self) -> str:
        """The release's folder on the robot."""
        return f"/opt/lupin/releases/{self.release}/"


def pyinfra_command(tools: PeerTools, installed: InstalledState, method: str) -> list[str]:
    """Return pyinfra's command."""
    check = {
        "modules": "files.sync(src=DATA['files'], dest=DATA['folder'], add_deploy_dir=False)",
        "rsync": "files.rsync(src=DATA['files'] + '/', dest=DATA['folder'] + '/', flags=DATA['rsync'])",
        "link": "files.link(path='/opt/lupin/current', target=DATA['link'], _sudo=True)",
    }[method]
    text = f"""
from io import StringIO
from pyinfra.operations import files, server, systemd
{check}
server.user(user=DATA['user'], groups=['input'], append=True, ensure_home=False, _sudo=True)
for path, content in DATA['texts'].items():
    files.put(src=StringIO(content), dest=path, mode='644', _sudo=True)
systemd.service(service='lupin-auto-home.service', running=None, enabled=True, _sudo=True)
systemd.service(service='lupin-onboard.service', running=True, enabled=True, _sudo=True)
"""
    return tools.pyinfra_command(f"deploy-{method}", text, _data(installed))


def _data(installed: InstalledState) -> dict[str, Any]:
    return {
        "files": str(installed.files),
        "folder": installed.folder.rstrip("/"),
        "link": f"releases/{installed.release}",
        "rsync": RSYNC,
        "user": installed.user,
        "texts": dict(installed.texts),
    }


def ansible_command(tools: PeerTools, installed: InstalledState, method: str) -> list[str]:
    """Return Ansible's command."""
    target = f"{installed.user}@{tools.address}:{installed.folder}"
    # The same as ansible.posix.synchronize, which is not in ansible-core.
    rsync = ["rsync", *RSYNC, "-e", f"ssh {tools.ssh_options}"]
    checks: dict[str, dict[str, Any]] = {
        "modules": {
            "ansible.builtin.copy": {"src": f"{installed.files}/", "dest": installed.folder, "mode": "preserve"},
            "become": False,
        },
        "rsync": {
            "ansible.builtin.command": {"argv": [*rsync, f"{installed.files}/", target]},
            "delegate_to": "localhost",
            "become": False,
            "register": "synced",
            "changed_when": "synced.stdout != ''",
        },
        "link": {
            "ansible.builtin.file": {
                "path": "/opt/lupin/current",
                "src": f"releases/{installed.release}",
                "state": "link",
                "follow": False,
            }
        },
    }
    tasks: list[dict[str, Any]] = [
        checks[method],
        {"ansible.builtin.user": {"name": installed.user, "groups": ["input"], "append": True}},
        *(
            {"ansible.builtin.copy": {"content": Unsafe(content), "dest": path, "mode": "0644"}}
            for path, content in installed.texts.items()
        ),
        {"ansible.builtin.systemd_service": {"name": "lupin-auto-home.service", "enabled": True}},
        {"ansible.builtin.systemd_service": {"name": "lupin-onboard.service", "enabled": True, "state": "started"}},
    ]
    return tools.ansible_command(f"deploy-{method}", {"robot": [{"become": True, **task} for task in tasks]})


def ansible_changed(stdout: str) -> int:
    """Return how many tasks changed something according to Ansible's recap; -1 without a recap."""
    line = next((line for line in stdout.splitlines() if line.startswith("robot ") and "changed=" in line), "")
    return int(line.split("changed=")[1].split()[0]) if line and "failed=0" in line and "unreachable=0" in line else -1


def pyinfra_changed(stdout: str, method: str) -> int:
    """Return how many operations changed something according to pyinfra's table; -1 without a table.

    pyinfra always reports an rsync as a change.
    """
    line = next((line for line in stdout.splitlines() if line.strip().startswith("Grand total")), "")
    words = [word for word in line.replace("│", " ").split() if word.isdigit() or word == "-"]
    return (0 if words[1] == "-" else int(words[1])) - (method == "rsync") if len(words) > 2 else -1
