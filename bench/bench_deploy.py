"""A repeated `lupin deploy robot` with nothing to do, compared with pyinfra and Ansible that check the same state of the robot.

The benchmark boots a simulated computer with the simulated robot and deploys to it. Then each tool checks the release, the
user's group, the pads' udev rule, the kernel's settings, the text of both units, and that they are enabled and active. It
measures wall times of whole commands in turns, and reports medians.

The comparison is fair in this: all tools have the same laptop, cable, sshd and user. The peers have their best settings:
Ansible uses pipelining, gathers no facts, has the path of the robot's Python, and reuses a connection from an earlier run;
lupin and pyinfra open a new one. The peers are given the path of the release; lupin probes the robot and computes the release
for it.

It is not fair in this: the peers check the release by one of three methods (see peers/deploying.py). With `modules`, the
tools' own modules need at least one request per file; they are stopped at a limit, and the ratio is then a lower bound.
`rsync` compares all sizes and times at once, with a program that the robot lacks; it is copied from this machine. `link`
compares only the name of the release, as lupin does, but is given the name: the minimum cost of these tools, not a method to
synchronize a folder.

    python -m bench.bench_deploy [--rounds N] [--no-peers] [--busy] [--json]      needs root, as the host's tests do
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from typing import Any

from bench.booted import SETUP_LINES, Operator, booted_operator, load, median, peer_tools, raise_priority
from bench.peers import deploying

LIMIT_S, PYINFRA_LIMIT, ANSIBLE_LIMIT = 1.5, 5.0, 20.0
FILES = ("/etc/udev/rules.d/70-lupin-pad.rules", "/etc/sysctl.d/60-lupin.conf", "/etc/systemd/logind.conf.d/60-lupin.conf")
# Limit for the methods with one request per file; long enough to show the required ratios.
PEER_LIMIT_S = 40.0


def wanted_state(operator: Operator) -> deploying.Wanted:
    """The state of the robot after the deploy: a local copy of the release's files, and the texts of root's files."""
    from lupin_cli.release.contents import RobotPlatform, release_files
    from lupin_cli.release.manifest import HashCache, build_manifest
    from lupin_cli.release.paths import setup_lines
    from lupin_cli.systemd.units import robot_units

    inside = operator.host.robot.inside
    release = inside("readlink", "/opt/lupin/current").stdout.strip().rpartition("/")[2]
    machine = inside("uname", "-m").stdout.strip()
    robot = RobotPlatform(machine, (sys.version_info.major, sys.version_info.minor), "")
    manifest = build_manifest(release_files(robot), HashCache(operator.home / "hashes.json"))
    if manifest.id != release:
        raise SystemExit(f"not measured: the robot runs {release}, and this machine would build {manifest.id}")
    folder = operator.home.parent / "release"
    for entry in manifest.entries:
        path = folder / entry.path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(entry.read())
        path.chmod(0o755 if entry.executable else 0o644)
        os.utime(path, (0, 0))  # the time that every file of a release carries
    units = robot_units("mirte", "/opt/lupin/current", setup_lines(SETUP_LINES))
    texts = {f"/etc/systemd/system/{name}": text for name, text in units.items()}
    texts |= {path: inside("cat", path).stdout for path in FILES}
    return deploying.Wanted(release, folder, texts, "mirte")


def copy_rsync(operator: Operator) -> bool:
    """Copy this machine's rsync with its libraries to the robot, which has the same Debian release. False if there is none."""
    program = shutil.which("rsync")
    if program is None:
        return False
    linked = subprocess.run(["ldd", program], capture_output=True, text=True, check=True).stdout
    libraries = [word for line in linked.splitlines() for word in line.split() if word.startswith("/")]
    packed = subprocess.run(["tar", "-chzf", "-", "-P", program, *libraries], capture_output=True, check=True).stdout
    put = operator.host.ssh_command("sudo tar -xzf - -P --skip-old-files && rsync --version")
    return operator.host.run(put, input=packed, text=False).returncode == 0


def deploy_once(operator: Operator) -> float:
    """Time one `lupin deploy robot`; stops the benchmark if it changes anything."""
    ran = operator.require(operator.lupin("deploy", "robot", "--json"))
    output = json.loads(ran.stdout)
    if output["changed"] or output["state"] != "done":
        raise SystemExit(f"not measured: a repeated deploy changed something: {ran.stdout}")
    return ran.wall_s


def peers(operator: Operator, rounds: int, note: Any) -> dict[str, Any]:
    """Measure lupin and the peers in turns, one method after the other."""
    wanted = wanted_state(operator)
    methods = [method for method in deploying.METHODS if method != "rsync" or copy_rsync(operator)]
    result: dict[str, Any] = {"files": sum(path.is_file() for path in wanted.files.rglob("*")), "ways": {}}
    if "rsync" not in methods:
        note("this machine lacks rsync (apt install rsync): method skipped")
    with peer_tools(operator) as tools:
        for method in methods:
            commands = {
                "pyinfra": deploying.pyinfra(tools, wanted, method),
                "ansible": deploying.ansible(tools, wanted, method),
            }
            walls: dict[str, list[float]] = {"lupin": [], **{name: [] for name in commands}}
            cut = set()
            for round_ in range(rounds + 1):
                walls["lupin"].append(deploy_once(operator))
                for name, command in commands.items():
                    if name in cut:
                        continue
                    ran = operator.run(command, tools.environment, PEER_LIMIT_S)
                    walls[name].append(ran.wall_s)
                    if ran.cut:
                        cut.add(name)
                        continue
                    output = ran.stdout + ran.stderr
                    changed = (
                        deploying.ansible_changed(output) if name == "ansible" else deploying.pyinfra_changed(output, method)
                    )
                    if changed != 0 or ran.status != 0:
                        raise SystemExit(f"not measured: {name} ({method}) changed {changed}, status {ran.status}\n{output}")
                note(f"{method}, round {round_}: " + ", ".join(f"{name} {w[-1]:.2f} s" for name, w in walls.items()))
                if len(cut) == len(commands):
                    break
            # The first round warms caches and Ansible's connection; a method that was cut has no other round.
            settled = {name: w[1:] or w for name, w in walls.items()}
            ours = median(settled["lupin"])
            result["ways"][method] = {
                "lupin_s": ours,
                **{f"{name}_s": median(settled[name]) for name in commands},
                **{f"{name}_times": round(median(settled[name]) / ours, 1) for name in commands},
                "cut_at_bound": sorted(cut),
                "load": load(),
            }
    return result


def main() -> int:
    """Time repeated deploys by Lupin and its peers; return 1 if Lupin's exceeds the limit."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--no-peers", action="store_true", help="Measure lupin only; install nothing.")
    parser.add_argument("--busy", action="store_true", help="Give the measured processes real-time priority on a busy machine.")
    parser.add_argument("--json", action="store_true", help="Print one line of JSON, alone on standard output.")
    options = parser.parse_args()

    def note(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    with booted_operator(vendor_robot=True) as operator:
        first = operator.require(operator.lupin("deploy", "robot", "--no-check", "--json"))
        note(f"first deploy: {first.wall_s:.1f} s")
        if options.busy:
            raise_priority(operator.host)
        deploy_once(operator)
        walls = [deploy_once(operator) for _ in range(max(options.rounds, 3))]
        result: dict[str, Any] = {
            "first_s": round(first.wall_s, 1),
            "again_s": median(walls),
            "again_worst_s": round(max(walls), 3),
            "limit_s": LIMIT_S,
            "load": load(),
        }
        if not options.no_peers:
            result |= peers(operator, options.rounds, note)
    if options.json:
        print(json.dumps(result))
    else:
        _print(result)
    return 0 if result["again_s"] <= LIMIT_S else 1


def _print(result: dict[str, Any]) -> None:
    print(
        f"deploy again, nothing to do: {result['again_s']:.2f} s (limit {LIMIT_S:g} s), worst {result['again_worst_s']:.2f} s"
    )
    for method, row in result.get("ways", {}).items():
        least = {name: "at least " if name in row["cut_at_bound"] else "" for name in ("pyinfra", "ansible")}
        print(
            f"  {method:8} of {result['files']} files: ours {row['lupin_s']:.2f} s; pyinfra {row['pyinfra_s']:.2f} s, "
            f"{least['pyinfra']}{row['pyinfra_times']} times (wanted {PYINFRA_LIMIT:g}); Ansible {row['ansible_s']:.2f} s, "
            f"{least['ansible']}{row['ansible_times']} times (wanted {ANSIBLE_LIMIT:g}); load {row['load']}"
        )


if __name__ == "__main__":
    sys.exit(main())
