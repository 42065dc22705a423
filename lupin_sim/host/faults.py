"""Everything that can be broken, as a table."""

from __future__ import annotations

from typing import Any

from lupin_sim.host import damage
from lupin_sim.host.bench import Act, Bench, Fault, FaultError, Settings
from lupin_sim.host.damage import script
from lupin_sim.host.machine import Machine

__all__ = ["FAULTS", "FaultError", "listing", "parse"]

WIRED, WIRELESS = {"link": "eth0"}, {"link": "wlan0"}
# Where Fast DDS's unicast user data goes: 7411 and the odd ports after it (RTPS 2.2, 9.6.1.1); 7410 and the even are discovery.
USER_DATA_PORTS = (7411, 7447)


def _cable(is_cut: bool) -> Act:
    return lambda bench, machine, settings: bench.wire.cut(machine.identity, settings["link"], is_cut)


def _switch(dead: bool) -> Act:
    return lambda bench, _, settings: bench.wire.switch(settings["link"], dead)


def _laptop(away: bool) -> Act:
    return lambda bench, _, settings: bench.wire.laptop_link(settings["link"], away)


def _pump(bench: Bench, machine: Machine, settings: Settings) -> None:
    bench.pump(machine, settings["link"])


def _dual_home(away: bool) -> Act:
    def act(bench: Bench, machine: Machine, settings: Settings) -> None:
        bench.wire.laptop_link("wlan0", away)
        bench.pump(machine, settings["link"])

    return act


def _clock(offset_s: bool, crystal: bool) -> Act:
    def act(_: Bench, machine: Machine, settings: Settings) -> None:
        machine.clock.make_wrong(settings["offset_s"] if offset_s else None, settings["ppm"] if crystal else None)

    return act


def _right_clock(_: Bench, machine: Machine, __: Settings) -> None:
    machine.clock.make_wrong(0.0, 0.0)


def _ntp(mode: str) -> Act:
    return lambda bench, _, __: bench.serve_ntp(mode)


def _reboot(_: Bench, machine: Machine, __: Settings) -> None:
    machine.inside(["systemctl", "--no-block", "reboot"])


FAULTS: dict[str, Fault] = {
    # -- the wire
    "cable-cut": Fault("the cable is pulled: both ends lose their carrier", _cable(True), _cable(False), WIRED, True),
    "switch-dead": Fault(
        "the switch died, or WiFi is out of range: carrier stays, nothing passes", _switch(True), _switch(False), WIRED, True
    ),
    "slow-link": Fault(
        *("latency each way, and jitter around it", _pump, _pump),
        *({**WIRED, "delay_ms": 60.0, "jitter_ms": 10.0}, True),
        lambda s: {"delay_ms": s["delay_ms"], "jitter_ms": s["jitter_ms"]},
    ),
    "lossy-link": Fault(
        *("a share of all frames is lost", _pump, _pump, {**WIRED, "loss": 0.2}, True), lambda s: {"loss": s["loss"]}
    ),
    "no-multicast": Fault(
        *("multicast is dropped, as many access points do", _pump, _pump, WIRED, True), lambda _: {"multicast": False}
    ),
    "wifi-roam": Fault(
        "the laptop's WiFi went elsewhere: no address and no route there", _laptop(True), _laptop(False), WIRELESS, True
    ),
    "dual-homed": Fault(
        "the laptop has no route to the robot's AP, which the robot still announces; data to the robot doesn't arrive",
        *(_dual_home(True), _dual_home(False), WIRED, True),
        lambda _: {"deaf_ports": USER_DATA_PORTS},
    ),
    # -- the computer
    "power-cut": Fault(
        "the plug is pulled; undone, it is switched on",
        lambda _, machine, __: machine.power_cut(),
        lambda _, machine, __: machine.power_on(),
    ),
    "reboot": Fault("it reboots in good order", _reboot, None),
    "frozen": Fault(
        "it hangs: the network takes connections, nothing in there answers",
        lambda _, machine, __: machine.freeze(True),
        lambda _, machine, __: machine.freeze(False),
        outside=True,
    ),
    "sshd-hung": Fault(
        "sshd hangs: the port accepts, no banner comes",
        script(damage.SSHD.format(signal="STOP")),
        script(damage.SSHD.format(signal="CONT")),
    ),
    "sshd-down": Fault(
        "sshd is off: the port refuses",
        script("systemctl stop ssh"),
        script("systemctl start ssh"),
    ),
    "host-key-changed": Fault("it shows other host keys", script(damage.NEW_HOST_KEYS), script(damage.OLD_HOST_KEYS)),
    "sudo-password": Fault("sudo asks for mirte's password", script(damage.ASK_PASSWORD), script(damage.ALLOW_SUDO)),
    "sudo-refused": Fault("mirte may not sudo", script(damage.REFUSE_SUDO), script(damage.ALLOW_SUDO)),
    "program-missing": Fault(
        "a program isn't there",
        script(damage.HIDE_PROGRAM, "program"),
        script(damage.SHOW_PROGRAM, "program"),
        {"program": "python3"},
    ),
    "disk-full": Fault(
        "nothing more fits on the disk",
        lambda _, machine, __: machine.limit_disk(machine.disk_used_mb()),
        lambda _, machine, __: machine.limit_disk(None),
    ),
    "disk-read-only": Fault("the file systems went read-only", script(damage.MAKE_READ_ONLY), script(damage.MAKE_WRITABLE)),
    "port-taken": Fault(
        "another program listens there", script(damage.TAKE_PORT, "port"), script(damage.GIVE_PORT, "port"), {"port": 8091}
    ),
    # -- clocks
    "clock-wrong": Fault(
        "its clock is off, as of a board without an RTC", _clock(True, False), _right_clock, {"offset_s": -287.5}
    ),
    "clock-drifts": Fault("its crystal runs too fast", _clock(False, True), _right_clock, {"ppm": 120.0}),
    "chrony-not-serving": Fault(
        "the laptop's chronyd runs and answers nobody; undone, it serves", _ntp("refusing"), _ntp("serving"), outside=True
    ),
    "chrony-stopped": Fault("the robot's chronyd is off", script("systemctl stop chrony"), script("systemctl start chrony")),
    "stock-makestep": Fault(
        "chrony may step the clock under a live stack, as the distribution has it",
        script(damage.STEPPING),
        script(damage.SLEWING),
    ),
    # -- DDS
    "server-not-started": Fault(
        "the cold-boot race is lost: mirte-ros is active, nothing is bound to 11811; cause is port or path",
        damage.lose_race,
        script(damage.RESTART_ROS),
        {"cause": "port"},
    ),
    "server-killed": Fault(
        "the discovery server is killed", script("pkill -KILL -x fast-discovery-"), damage.sweep(damage.RESTART_ROS)
    ),
    "server-pinned": Fault(
        "the discovery server answers on one address only",
        *(script(damage.PIN_SERVER, "address"), damage.sweep(damage.UNPIN_SERVER), {"address": "192.168.42.1"}),
    ),
    "server-stopped": Fault(
        "the discovery server hangs: it holds its port and answers nobody",
        script(damage.SERVER_SIGNAL.format(signal="STOP")),
        script(damage.SERVER_SIGNAL.format(signal="CONT")),
    ),
    "server-port-taken": Fault(
        "another program holds the discovery server's port",
        script(damage.TAKE_SERVER_PORT),
        damage.sweep(damage.UNPIN_SERVER),
    ),
    "dds-off": Fault(
        "mirte's settings say multicast: MIRTE_FASTDDS=false", script(damage.SETTINGS_FALSE), script(damage.SETTINGS_TRUE)
    ),
    "interface-late": Fault(
        "wlan0 came up after mirte-ros, which doesn't know it", script(damage.LATE_INTERFACE), script(damage.RESTART_ROS)
    ),
    "zombies": Fault(
        "stopped participants hold DDS ports",
        damage.zombie,
        damage.sweep("systemctl kill --signal=KILL 'lupin-fault-zombie-*'; sleep 0.2"),
        {"count": 2},
    ),
    "shm-orphans": Fault("segments of killed participants", damage.orphan, damage.sweep(), {"user": "mirte", "count": 2}),
    "shm-foreign": Fault(
        "segments that root's killed participants left are in the way of mirte's",
        *(damage.orphan, damage.sweep("systemctl stop mirte-ros", "systemctl start mirte-ros"), {"user": "root", "count": 1}),
    ),
    "shm-full": Fault("nothing more fits in /dev/shm", script(damage.FILL_SHM), script("mount -o remount,size=256M /dev/shm")),
    # -- services
    "oneshot-failed": Fault(
        "a oneshot failed, and nothing retries it",
        script(damage.FAIL_ONESHOT, "unit"),
        script(damage.MEND_ONESHOT, "unit"),
        {"unit": "lupin-auto-home"},
    ),
    "unit": Fault(
        "a unit is stopped, disabled, masked, or failing until systemd gives up",
        script(damage.UNIT_STATE, "state", "unit"),
        script(damage.MEND_UNIT, "state", "unit"),
        {"state": "stopped", "unit": "lupin-onboard"},
    ),
    "camera-held": Fault("a stray process holds a camera", script(damage.HOLD_CAMERA), script(damage.FREE_CAMERA)),
    "home-locked": Fault("mirte may not write to his home", script(damage.LOCK_HOME), script(damage.UNLOCK_HOME)),
    "not-in-group": Fault(
        "mirte lost a group",
        *(script('gpasswd --delete mirte "$1" >/dev/null', "group"), script('usermod --append --groups "$1" mirte', "group")),
        {"group": "input"},
    ),
    "controllers-stuck": Fault(
        "the vendor's controllers boot into another state: unloaded, unconfigured or inactive",
        script(damage.CONTROLLERS, "state"),
        lambda bench, machine, _: script(damage.CONTROLLERS, "state")(bench, machine, {"state": "active"}),
        {"state": "unconfigured"},
    ),
}


def listing() -> list[dict[str, Any]]:
    """All faults, for those who choose one: name, summary, settings with their defaults, whether it can be taken back."""
    return [
        {"name": name, "summary": fault.summary, "settings": dict(fault.settings), "undo": fault.undo is not None}
        for name, fault in FAULTS.items()
    ]


def parse(name: str, assignments: list[str]) -> dict[str, Any]:
    """Settings out of SETTING=VALUE, each of the kind of its default. Raises FaultError."""
    fault = FAULTS.get(name)
    if fault is None:
        raise FaultError(f"there is no fault {name!r}; there are: {', '.join(sorted(FAULTS))}")
    chosen: dict[str, Any] = {}
    for assignment in assignments:
        key, _, text = assignment.partition("=")
        if key not in fault.settings:
            raise FaultError(f"{name} knows no {key!r}; it takes {', '.join(fault.settings) or 'no settings'}")
        default = fault.settings[key]
        try:
            chosen[key] = type(default)(text)
        except ValueError:
            raise FaultError(f"{key} of {name} is a number like {default}, and {text!r} is not") from None
    return chosen
