"""Faults of the robot's processes and units: stopped, killed, limited."""

from __future__ import annotations

import random
from dataclasses import dataclass, replace

from bench.faults.fault import RESTART_STACK, ROBOT, STACK_UNITS, Effect, Fault, Step, drop_in, harmless


@dataclass(frozen=True)
class _Process:
    """Processes of the robot: what prints their ids, where the root lies if they stop, and what brings them back."""

    text: str
    pids: str
    part: str
    layer: str
    revive: str
    effect: Effect = Effect.BREAKS
    hides_robot: bool = False


_MAIN = "systemctl show -P MainPID {}"
SERVER = _Process("discovery server", "pgrep -x fast-discovery-", "stack", "discovery", RESTART_STACK)
SIMULATED_ROBOT = _Process("vendor's stack", "pgrep -f '[-]m lupin_sim'", "stack", "processes", RESTART_STACK)
ONBOARD = _Process(
    "Lupin's supervisor on the robot",
    _MAIN.format("lupin-onboard"),
    "stack",
    "processes",
    "systemctl restart lupin-onboard",
    Effect.MAY_BREAK,
)
ONBOARD_CHILD = _Process(
    "a process of lupin-onboard",
    "pgrep -f '[l]upin_runtime.stack.process .*{}'",
    "stack",
    "processes",
    "systemctl restart lupin-onboard",
    Effect.MAY_BREAK,
)
SSHD = _Process("sshd", _MAIN.format("ssh"), "login", "login", "systemctl restart ssh", hides_robot=True)
CHRONY = _Process("chronyd", _MAIN.format("chrony"), "clock", "clock", "systemctl restart chrony", Effect.MAY_BREAK)
NEEDED_PROCESSES = (SERVER, SIMULATED_ROBOT, ONBOARD, SSHD, CHRONY)
UNUSED_UNITS = ("mirte-jupyter", "systemd-networkd")


def _draw_process(rng: random.Random) -> _Process:
    chosen = rng.choice((*NEEDED_PROCESSES, ONBOARD_CHILD))
    if chosen is not ONBOARD_CHILD:
        return chosen
    name = rng.choice(("drive", "estop", "body"))
    return replace(chosen, text=f"{name} of lupin-onboard", pids=chosen.pids.format(name))


def _signal(process: _Process, name: str) -> str:
    return f'pids=$({process.pids})\n[ -n "$pids" ]\nkill -{name} $pids'


def _process_fault(verb: str, process: _Process, make: str, undo: str) -> Fault:
    return Fault(
        verb,
        f"robot: {verb} {process.text}",
        process.part,
        process.layer,
        ROBOT,
        process.effect,
        (Step(ROBOT, make, undo),),
        hides_robot=process.hides_robot,
        restarts=process.part != "login",
    )


def stop_process(rng: random.Random) -> Fault:
    """A process that hangs: it keeps its ports, and does not respond."""
    process = _draw_process(rng)
    # A supervisor may have replaced it meanwhile: then there is nothing to continue.
    undo = f"kill -CONT $(cat /run/stopped-pids) 2>/dev/null || true\nrm -f /run/stopped-pids\n{process.revive}"
    if process in (SSHD, CHRONY):
        undo = "kill -CONT $(cat /run/stopped-pids) 2>/dev/null || true\nrm -f /run/stopped-pids"
    return _process_fault("stop", process, f"{_signal(process, 'STOP')}\necho $pids > /run/stopped-pids", undo)


def kill_process(rng: random.Random) -> Fault:
    """A process that is gone, unless something starts it again."""
    process = _draw_process(rng)
    if process is SSHD:  # systemd starts it again at once, so it is kept from that
        return _process_fault("kill", process, "systemctl stop ssh", "systemctl start ssh")
    return _process_fault("kill", process, _signal(process, rng.choice(("KILL", "TERM"))), process.revive)


def stop_unused_unit(rng: random.Random) -> Fault:
    """A unit that neither the operator nor the robot needs at this time."""
    unit = rng.choice(UNUSED_UNITS)
    return harmless("stop", f"robot: {unit}", Step(ROBOT, f"systemctl stop {unit}", f"systemctl start {unit}"))


# A container's root may lack CAP_SYS_RESOURCE, which it would need for the processes of other users.
_PRLIMIT = "runuser -u $(stat -c %U /proc/$pid) -- prlimit --pid $pid"


def limit_process(rng: random.Random) -> Fault:
    """A resource limit below what a process needs."""
    process = rng.choice((SIMULATED_ROBOT, ONBOARD))
    resource = rng.choice(("cpu=1:1", "as=1000000:1000000", "fsize=0:0"))
    wait = "sleep 4" if resource.startswith("cpu") else "sleep 1"
    make = f'pids=$({process.pids})\n[ -n "$pids" ]\nfor pid in $pids; do {_PRLIMIT} --{resource}; done\n{wait}'
    limited = replace(process, text=f"{resource} of {process.text}", effect=Effect.MAY_BREAK)
    return _process_fault("limit", limited, make, process.revive)


def throttle_stack(rng: random.Random) -> Fault:
    """A vendor's stack that gets a fraction of its time: every topic comes at a fraction of its rate."""
    percent = rng.choice((5, 10, 20))
    pause_s, run_s = 2.0 * (100 - percent) / 100, 2.0 * percent / 100
    name = f"t{rng.randrange(10**6)}"
    loop = f"while :; do p=$({SIMULATED_ROBOT.pids}); kill -STOP $p; sleep {pause_s}; kill -CONT $p; sleep {run_s}; done"
    make = f"cat > /run/{name}.sh <<'END'\n{loop}\nEND\nsystemd-run -q --unit={name} sh /run/{name}.sh\nsleep 3"
    undo = f"systemctl stop {name} || true\nrm -f /run/{name}.sh\nkill -CONT $({SIMULATED_ROBOT.pids}) || true\n{RESTART_STACK}"
    return _process_fault("limit", replace(SIMULATED_ROBOT, text=f"{percent} % of the time of the vendor's stack"), make, undo)


def break_unit(rng: random.Random) -> Fault:
    """A unit that never gets ready, or that systemd cannot load at its next start."""
    unit = rng.choice(STACK_UNITS)
    if rng.random() < 0.5:
        return drop_in("edit", unit, "[Service]\\nExecStartPre=/bin/sleep 900", "processes", "ExecStartPre=/bin/sleep 900")
    folder = f"/etc/systemd/system/{unit}.service.d"
    file = f"{folder}/local.conf"
    make = (
        f"systemctl stop {unit}\nmkdir -p {folder}\nprintf '[Service]\\nExecStart=\\n' > {file}\n"
        f"systemctl daemon-reload\nsystemctl start --no-block {unit} || true"
    )
    undo = f"rm -f {file}\nsystemctl daemon-reload\n{RESTART_STACK}\nsystemctl start --no-block lupin-onboard"
    step = Step(ROBOT, make, undo)
    return Fault("edit", f"robot: {unit}: no ExecStart", "stack", "processes", ROBOT, Effect.BREAKS, (step,), restarts=True)


def rename_unit(rng: random.Random) -> Fault:
    """A unit whose file has another name."""
    unit = rng.choice(STACK_UNITS)
    path = f"/etc/systemd/system/{unit}.service"
    make = f"systemctl stop {unit}\nmv {path} {path}.away\nsystemctl daemon-reload"
    undo = f"mv {path}.away {path}\nsystemctl daemon-reload\n{RESTART_STACK}\nsystemctl start --no-block lupin-onboard"
    return Fault(
        "rename", f"robot: {path} away", "stack", "processes", ROBOT, Effect.BREAKS, (Step(ROBOT, make, undo),), restarts=True
    )


def limit_files(rng: random.Random) -> Fault:
    """A unit that may open fewer files than it needs, from its next start on."""
    unit, count = rng.choice(STACK_UNITS), rng.choice((4, 8))
    return drop_in("limit", unit, f"[Service]\\nLimitNOFILE={count}", "processes", f"LimitNOFILE={count}")


def limit_unused(rng: random.Random) -> Fault:
    """A generous limit, or a low priority."""
    process = rng.choice((SERVER, SIMULATED_ROBOT, SSHD))
    resource = rng.choice(("nofile=4096:4096", "stack=8000000:unlimited", "core=0:0"))
    make = f"for pid in $({process.pids}); do {_PRLIMIT} --{resource}; done"
    undo = f"for pid in $({process.pids}); do {_PRLIMIT} --{resource.split('=')[0]}=unlimited:unlimited || true; done"
    return harmless("limit", f"robot: {resource} of {process.text}", Step(ROBOT, make, undo))
