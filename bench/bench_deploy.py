"""A repeated `lupin deploy robot` with nothing to do, compared with pyinfra and Ansible, which check the same state.

The benchmark boots a simulated computer with the simulated robot and deploys to it. Then lupin and its peers, pyinfra and
Ansible, check the result in rounds, and the medians of the wall times of whole commands are reported. The peers check the
release, the user's group, the texts of the three units and of FILES, that lupin-onboard is enabled and active, and that
lupin-auto-home is enabled; lupin checks all steps of its playbook `deploy-robot`.

The comparison is fair in these points: all three use the same laptop, cable, sshd and user. The peers have their best settings:
Ansible uses pipelining, gathers no facts, has the path of the robot's Python, and reuses a connection from an earlier run;
lupin and pyinfra open a new one. The peers are given the path of the release; lupin probes the robot and computes the release
for it.

It is unfair in one point: the peers check the release by one of three methods (see peers/deploying.py). With `modules`, the
peers' own modules need at least one request per file; they are stopped after PEER_TIMEOUT_S, and the ratio is then a lower
bound. `rsync` compares all sizes and times at once, with a program that the robot lacks; it is copied from this machine. `link`
compares only the target of the symbolic link /opt/lupin/current, as lupin does, but is given the expected name: it shows the
minimum cost of the peers, and cannot synchronize a folder.

Needs root, as the tests on booted hosts do.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from typing import Any

from bench.booted import (
    SETUP_LINES,
    Operator,
    booted_operator,
    load_average,
    median,
    peer_tools,
    raise_priority,
)
from bench.peers import deploying
from bench.runner import Busy, Figures, NoPeers, Rounds, benchmark, note

# Expected ratios of the peers' times to lupin's. They are only printed; the exit status does not depend on them.
EXPECTED_PYINFRA_RATIO, EXPECTED_ANSIBLE_RATIO = 5.0, 20.0
FILES = (
    "/etc/lupin/release-signers",
    "/usr/local/lib/lupin/verify-release",
    "/etc/udev/rules.d/70-lupin-pad.rules",
    "/etc/sysctl.d/60-lupin.conf",
    "/etc/systemd/logind.conf.d/60-lupin.conf",
)
# Only the peers' method `modules`, with one request per file, takes so long. Long enough to show the expected ratios.
PEER_TIMEOUT_S = 40.0


def build_expected_state(operator: Operator) -> deploying.InstalledState:
    """Build the robot's release and the texts of its units on this machine, and read FILES from the robot, for the peers."""
    from lupin_cli.release.contents import RobotPlatform, release_files
    from lupin_cli.release.manifest import HashCache, build_manifest
    from lupin_cli.release.paths import setup_lines
    from lupin_cli.systemd.units import robot_units

    run_as_root = operator.host.robot.run_as_root
    release = run_as_root("readlink", "/opt/lupin/current").stdout.strip().rpartition("/")[2]
    architecture = run_as_root("uname", "-m").stdout.strip()
    platform = RobotPlatform(architecture, (sys.version_info.major, sys.version_info.minor), "")
    manifest = build_manifest(release_files(platform), HashCache(operator.home / "hashes.json"))
    if manifest.id != release:
        raise SystemExit(f"not measured: the robot runs {release}, and this machine would build {manifest.id}")
    folder = operator.home.parent / "release"
    for entry in manifest.entries:
        path = folder / entry.path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(entry.read())
        path.chmod(0o755 if entry.executable else 0o644)
        os.utime(path, (0, 0))  # every file of a release has this time
    units = robot_units("mirte", "/opt/lupin/current", setup_lines(SETUP_LINES))
    texts = {f"/etc/systemd/system/{name}": text for name, text in units.items()}
    texts |= {path: run_as_root("cat", path).stdout for path in FILES}
    return deploying.InstalledState(release, folder, texts, "mirte")


def copy_rsync(operator: Operator) -> bool:
    """Copy this machine's rsync and its libraries to the robot, which runs the same Debian; return whether rsync runs there."""
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


def compare_with_peers(operator: Operator, rounds: int) -> dict[str, Any]:
    """Measure lupin and the peers in rounds, one method after the other."""
    expected = build_expected_state(operator)
    methods = [method for method in deploying.METHODS if method != "rsync" or copy_rsync(operator)]
    result: dict[str, Any] = {"files": sum(path.is_file() for path in expected.files.rglob("*")), "methods": {}}
    if "rsync" not in methods:
        note("rsync does not run on the robot or is not installed here (apt install rsync): method skipped")
    with peer_tools(operator) as tools:
        for method in methods:
            commands = {
                "pyinfra": deploying.pyinfra_command(tools, expected, method),
                "ansible": deploying.ansible_command(tools, expected, method),
            }
            walls: dict[str, list[float]] = {"lupin": [], **{name: [] for name in commands}}
            timed_out = set()
            for round_ in range(rounds + 1):
                walls["lupin"].append(deploy_once(operator))
                for name, command in commands.items():
                    if name in timed_out:
                        continue
                    ran = operator.run(command, tools.environment, PEER_TIMEOUT_S)
                    walls[name].append(ran.wall_s)
                    if ran.timed_out:
                        timed_out.add(name)
                        continue
                    output = ran.stdout + ran.stderr
                    changed = (
                        deploying.ansible_changed(output) if name == "ansible" else deploying.pyinfra_changed(output, method)
                    )
                    if changed != 0 or ran.status != 0:
                        raise SystemExit(f"not measured: {name} ({method}) changed {changed}, status {ran.status}\n{output}")
                note(f"{method}, round {round_}: " + ", ".join(f"{name} {w[-1]:.2f} s" for name, w in walls.items()))
                if len(timed_out) == len(commands):
                    break
            # The first round warms caches and Ansible's connection; a tool that timed out in it has no other round.
            warm = {name: w[1:] or w for name, w in walls.items()}
            lupin_s = median(warm["lupin"])
            result["methods"][method] = {
                "lupin_s": lupin_s,
                **{f"{name}_s": median(warm[name]) for name in commands},
                **{f"{name}_ratio": median(warm[name]) / lupin_s for name in commands},
                "pyinfra_expected_ratio": EXPECTED_PYINFRA_RATIO,
                "ansible_expected_ratio": EXPECTED_ANSIBLE_RATIO,
                "timed_out": sorted(timed_out),
                "load_average": load_average(),
            }
    return result


@benchmark(at_most={"again_s": 1.5})
def main(rounds: Rounds = 5, no_peers: NoPeers = False, busy: Busy = False) -> Figures:
    """Time repeated deploys by lupin, in at least 3 rounds, and by its peers."""
    with booted_operator(vendor_robot=True) as operator:
        first = operator.require(operator.lupin("deploy", "robot", "--no-check", "--json"))
        note(f"first deploy: {first.wall_s:.1f} s")
        if busy:
            raise_priority(operator.host)
        deploy_once(operator)
        walls = [deploy_once(operator) for _ in range(max(rounds, 3))]
        figures = {
            "first_s": first.wall_s,
            "again_s": median(walls),
            "again_worst_s": max(walls),
            "load_average": load_average(),
        }
        return figures if no_peers else figures | compare_with_peers(operator, rounds)


if __name__ == "__main__":
    sys.exit(main())
