"""What `lupin deploy robot` finds unchanged, as pyinfra and Ansible would be told to look at it.

Three ways to look at the release, from the one that their manuals teach to the one that knows as much as ours:
  modules  their own modules for a folder: pyinfra's files.sync, Ansible's copy. They ask for each file by itself.
  rsync    one rsync of the folder, which compares sizes and times; the robot must have rsync. What experienced people do.
  link     nobody looks into the folder: the name of the release is given to them, and where `current` points is compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.peers.tools import Tools, Unsafe

WAYS = ("modules", "rsync", "link")
RSYNC = ("-rlptO", "--itemize-changes")


@dataclass(frozen=True)
class Wanted:
    """The state that is there already: a release's files in a folder here, and texts of files of root's."""

    release: str
    files: Path
    texts: Mapping[str, str]  # by path on the robot
    user: str

    @property
    def place(self) -> str:
        """Where the release lies on the robot."""
        return f"/opt/lupin/releases/{self.release}/"


def pyinfra(tools: Tools, wanted: Wanted, way: str) -> list[str]:
    """pyinfra's command. Operations that are one for several things are given them at once, as it likes it best."""
    look = {
        "modules": "files.sync(src=DATA['files'], dest=DATA['place'], add_deploy_dir=False)",
        "rsync": "files.rsync(src=DATA['files'] + '/', dest=DATA['place'] + '/', flags=DATA['rsync'])",
        "link": "files.link(path='/opt/lupin/current', target=DATA['link'], _sudo=True)",
    }[way]
    text = f"""
from io import StringIO
from pyinfra.operations import files, server, systemd
{look}
server.user(user=DATA['user'], groups=['input'], append=True, ensure_home=False, _sudo=True)
for path, content in DATA['texts'].items():
    files.put(src=StringIO(content), dest=path, mode='644', _sudo=True)
systemd.service(service='lupin-auto-home.service', running=None, enabled=True, _sudo=True)
systemd.service(service='lupin-onboard.service', running=True, enabled=True, _sudo=True)
"""
    return tools.pyinfra(f"deploy-{way}", text, _data(wanted))


def _data(wanted: Wanted) -> dict[str, Any]:
    return {
        "files": str(wanted.files),
        "place": wanted.place.rstrip("/"),
        "link": f"releases/{wanted.release}",
        "rsync": RSYNC,
        "user": wanted.user,
        "texts": dict(wanted.texts),
    }


def ansible(tools: Tools, wanted: Wanted, way: str) -> list[str]:
    """Ansible's command."""
    target = f"{wanted.user}@{tools.address}:{wanted.place}"
    # What ansible.posix.synchronize does, without that collection.
    rsync = ["rsync", *RSYNC, "-e", f"ssh {tools.ssh_options}"]
    looks: dict[str, dict[str, Any]] = {
        "modules": {
            "ansible.builtin.copy": {"src": f"{wanted.files}/", "dest": wanted.place, "mode": "preserve"},
            "become": False,
        },
        "rsync": {
            "ansible.builtin.command": {"argv": [*rsync, f"{wanted.files}/", target]},
            "delegate_to": "localhost",
            "become": False,
            "register": "synced",
            "changed_when": "synced.stdout != ''",
        },
        "link": {
            "ansible.builtin.file": {
                "path": "/opt/lupin/current",
                "src": f"releases/{wanted.release}",
                "state": "link",
                "follow": False,
            }
        },
    }
    tasks: list[dict[str, Any]] = [
        looks[way],
        {"ansible.builtin.user": {"name": wanted.user, "groups": ["input"], "append": True}},
        *(
            {"ansible.builtin.copy": {"content": Unsafe(content), "dest": path, "mode": "0644"}}
            for path, content in wanted.texts.items()
        ),
        {"ansible.builtin.systemd_service": {"name": "lupin-auto-home.service", "enabled": True}},
        {"ansible.builtin.systemd_service": {"name": "lupin-onboard.service", "enabled": True, "state": "started"}},
    ]
    return tools.ansible(f"deploy-{way}", {"robot": [{"become": True, **task} for task in tasks]})


def ansible_changed(stdout: str) -> int:
    """How many tasks changed something, by the recap; -1 without one."""
    line = next((line for line in stdout.splitlines() if line.startswith("robot ") and "changed=" in line), "")
    return int(line.split("changed=")[1].split()[0]) if line and "failed=0" in line and "unreachable=0" in line else -1


def pyinfra_changed(stdout: str, way: str) -> int:
    """How many operations changed something, by its table; -1 without one. rsync has no other word than `changed`."""
    line = next((line for line in stdout.splitlines() if line.strip().startswith("Grand total")), "")
    words = [word for word in line.replace("│", " ").split() if word.isdigit() or word == "-"]
    return (0 if words[1] == "-" else int(words[1])) - (way == "rsync") if len(words) > 2 else -1
