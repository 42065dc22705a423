"""`lupin deploy robot` again, with nothing to do, against pyinfra and Ansible that look at the same robot and find the same.

A robot's computer is booted with the simulated robot on it and deployed to; then every tool finds the release, the user's
group, the pads' udev rule, the kernel's settings, both units' texts, and that they are enabled and run. Wall times of whole
commands, in turns; medians.

What is fair: all have the same laptop, cable, sshd and user. The peers are at their best: Ansible pipelines, gathers no facts,
knows the Python over there, and finds a connection that an earlier run left open; ours and pyinfra open theirs anew. They are
told where the release lies; ours asks the robot what it is and works out from this machine's files what its release would be.

What is not: the release is looked at in three ways (see peers/deploying.py). Both tools' own modules ask once or more for every
file, so `modules` is cut at a bound, and the ratio is then at least the one told. `rsync` compares all sizes and times at once,
with a program that the booted robot has not: it is lent this machine's. `link` compares a name only, as ours does, but is told
the name: the least that these tools can cost, not a way to sync a folder.

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

from bench.booted import SET_UP, Operator, load, median, operator, take_the_cores, tools_of
from bench.peers import deploying

LIMIT_S, PYINFRA_LIMIT, ANSIBLE_LIMIT = 1.5, 5.0, 20.0
FILES = ("/etc/udev/rules.d/70-lupin-pad.rules", "/etc/sysctl.d/60-lupin.conf", "/etc/systemd/logind.conf.d/60-lupin.conf")
# For the ways that ask once a file: long enough to see any ratio that is asked for.
CUT_S = 40.0


def wanted_state(someone: Operator) -> deploying.Wanted:
    """What the robot has after the deploy: the release's files laid out here, and root's files as they are there."""
    from lupin_cli.onboard import set_up
    from lupin_cli.release.contents import Robot, files
    from lupin_cli.release.manifest import Hashes, manifest_of
    from lupin_cli.units import robot_units

    inside = someone.host.robot.inside
    release = inside("readlink", "/opt/lupin/current").stdout.strip().rpartition("/")[2]
    machine = inside("uname", "-m").stdout.strip()
    robot = Robot(machine, (sys.version_info.major, sys.version_info.minor), "")
    manifest = manifest_of(files(robot), Hashes(someone.home / "hashes.json"))
    if manifest.id != release:
        raise SystemExit(f"not measured: the robot runs {release}, and this machine would make {manifest.id}")
    folder = someone.home.parent / "release"
    for entry in manifest.entries:
        path = folder / entry.path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(entry.read())
        path.chmod(0o755 if entry.executable else 0o644)
        os.utime(path, (0, 0))  # the time that every file of a release carries
    units = robot_units("mirte", "/opt/lupin/current", set_up(SET_UP))
    texts = {f"/etc/systemd/system/{name}": text for name, text in units.items()}
    texts |= {path: inside("cat", path).stdout for path in FILES}
    return deploying.Wanted(release, folder, texts, "mirte")


def lend_rsync(someone: Operator) -> bool:
    """Give the robot this machine's rsync with its libraries: both are of one Debian release. False where there is none."""
    program = shutil.which("rsync")
    if program is None:
        return False
    linked = subprocess.run(["ldd", program], capture_output=True, text=True, check=True).stdout
    libraries = [word for line in linked.splitlines() for word in line.split() if word.startswith("/")]
    packed = subprocess.run(["tar", "-chzf", "-", "-P", program, *libraries], capture_output=True, check=True).stdout
    put = someone.host.ssh_command("sudo tar -xzf - -P --skip-old-files && rsync --version")
    return someone.host.run(put, input=packed, text=False).returncode == 0


def once(someone: Operator) -> float:
    """Ours; ends the bench where it finds something to do."""
    ran = someone.must(someone.lupin("deploy", "robot", "--json"))
    told = json.loads(ran.stdout)
    if told["changed"] or told["state"] != "done":
        raise SystemExit(f"not measured: something changed at every deploy: {ran.stdout}")
    return ran.wall_s


def peers(someone: Operator, rounds: int, note: Any) -> dict[str, Any]:
    """Rounds of ours and the peers in turns, one way after the other."""
    wanted = wanted_state(someone)
    ways = [way for way in deploying.WAYS if way != "rsync" or lend_rsync(someone)]
    result: dict[str, Any] = {"files": sum(path.is_file() for path in wanted.files.rglob("*")), "ways": {}}
    if "rsync" not in ways:
        note("no rsync here (apt install rsync): that way is left out")
    with tools_of(someone) as tools:
        for way in ways:
            commands = {"pyinfra": deploying.pyinfra(tools, wanted, way), "ansible": deploying.ansible(tools, wanted, way)}
            walls: dict[str, list[float]] = {"lupin": [], **{name: [] for name in commands}}
            cut = set()
            for round_ in range(rounds + 1):
                walls["lupin"].append(once(someone))
                for name, command in commands.items():
                    if name in cut:
                        continue
                    ran = someone.run(command, tools.environment, CUT_S)
                    walls[name].append(ran.wall_s)
                    if ran.cut:
                        cut.add(name)
                        continue
                    told = ran.stdout + ran.stderr
                    changed = deploying.ansible_changed(told) if name == "ansible" else deploying.pyinfra_changed(told, way)
                    if changed != 0 or ran.status != 0:
                        raise SystemExit(f"not measured: {name} ({way}) changed {changed}, status {ran.status}\n{told}")
                note(f"{way}, round {round_}: " + ", ".join(f"{name} {w[-1]:.2f} s" for name, w in walls.items()))
                if len(cut) == len(commands):
                    break
            # The first round warms caches and Ansible's connection; a way that was cut has no other.
            settled = {name: w[1:] or w for name, w in walls.items()}
            ours = median(settled["lupin"])
            result["ways"][way] = {
                "lupin_s": ours,
                **{f"{name}_s": median(settled[name]) for name in commands},
                **{f"{name}_times": round(median(settled[name]) / ours, 1) for name in commands},
                "cut_at_bound": sorted(cut),
                "load": load(),
            }
    return result


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--no-peers", action="store_true", help="Ours alone; nothing is installed.")
    parser.add_argument("--busy", action="store_true", help="Others use this machine: run what is measured before their work.")
    parser.add_argument("--json", action="store_true", help="Print one line of JSON, alone on standard output.")
    options = parser.parse_args()

    def note(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    with operator(vendor_robot=True) as someone:
        first = someone.must(someone.lupin("deploy", "robot", "--no-check", "--json"))
        note(f"first deploy: {first.wall_s:.1f} s")
        if options.busy:
            take_the_cores(someone.host)
        once(someone)
        walls = [once(someone) for _ in range(max(options.rounds, 3))]
        result: dict[str, Any] = {
            "first_s": round(first.wall_s, 1),
            "again_s": median(walls),
            "again_worst_s": round(max(walls), 3),
            "limit_s": LIMIT_S,
            "load": load(),
        }
        if not options.no_peers:
            result |= peers(someone, options.rounds, note)
    if options.json:
        print(json.dumps(result))
    else:
        _print(result)
    return 0 if result["again_s"] <= LIMIT_S else 1


def _print(result: dict[str, Any]) -> None:
    print(
        f"deploy again, nothing to do: {result['again_s']:.2f} s (limit {LIMIT_S:g} s), worst {result['again_worst_s']:.2f} s"
    )
    for way, row in result.get("ways", {}).items():
        least = {name: "at least " if name in row["cut_at_bound"] else "" for name in ("pyinfra", "ansible")}
        print(
            f"  {way:8} of {result['files']} files: ours {row['lupin_s']:.2f} s; pyinfra {row['pyinfra_s']:.2f} s, "
            f"{least['pyinfra']}{row['pyinfra_times']} times (wanted {PYINFRA_LIMIT:g}); Ansible {row['ansible_s']:.2f} s, "
            f"{least['ansible']}{row['ansible_times']} times (wanted {ANSIBLE_LIMIT:g}); load {row['load']}"
        )


if __name__ == "__main__":
    sys.exit(main())
