"""The faults of a simulated computer, its network and its laptop, as one table."""

from __future__ import annotations

from typing import Any

from lupin_runtime.ports import DISCOVERY_PORT, VIDEO_PORT
from lupin_sim.host import fault_scripts as scripts
from lupin_sim.host.computer import Computer
from lupin_sim.host.fault_injector import Fault, FaultAction, FaultError, FaultInjector, Settings
from lupin_sim.host.fault_scripts import script

__all__ = ["FAULTS", "FaultError", "list_faults", "parse_settings"]

WIRED, WIRELESS = {"link": "eth0"}, {"link": "wlan0"}
# Fast DDS sends unicast user data to 7411 and the odd ports after it (RTPS 2.2, 9.6.1.1); the even ones are for discovery.
USER_DATA_PORTS = (7411, 7447)


def _set_cable_cut(cut: bool) -> FaultAction:
    return lambda injector, computer, settings: injector.network.set_cable_cut(computer.identity, settings["link"], cut)


def _set_switch_dead(dead: bool) -> FaultAction:
    return lambda injector, _, settings: injector.network.set_switch_dead(settings["link"], dead)


def _set_laptop_away(away: bool) -> FaultAction:
    return lambda injector, _, settings: injector.network.set_laptop_away(settings["link"], away)


def _update_link(injector: FaultInjector, computer: Computer, settings: Settings) -> None:
    injector.update_link(computer, settings["link"])


def _set_dual_homed(away: bool) -> FaultAction:
    def action(injector: FaultInjector, computer: Computer, settings: Settings) -> None:
        injector.network.set_laptop_away("wlan0", away)
        injector.update_link(computer, settings["link"])

    return action


def _blocked_ports(settings: Settings) -> dict[str, tuple[int, int]]:
    directions = {"to-robot": "blocked_ports", "from-robot": "blocked_ports_from_a"}
    if settings["direction"] not in directions:
        raise FaultError(f"expected the direction to-robot or from-robot, found {settings['direction']!r}")
    return {directions[settings["direction"]]: (settings["first_port"], settings["last_port"])}


def _set_clock_offset(_: FaultInjector, computer: Computer, settings: Settings) -> None:
    computer.clock.disturb(offset_s=settings["offset_s"])


def _set_crystal(_: FaultInjector, computer: Computer, settings: Settings) -> None:
    computer.clock.disturb(crystal_ppm=settings["ppm"])


def _correct_clock(_: FaultInjector, computer: Computer, __: Settings) -> None:
    computer.clock.disturb(offset_s=0.0, crystal_ppm=0.0)


def _serve_ntp(mode: str) -> FaultAction:
    return lambda injector, _, __: injector.serve_ntp(mode)


def _reboot(_: FaultInjector, computer: Computer, __: Settings) -> None:
    computer.run_as_root(["systemctl", "--no-block", "reboot"])


def _activate_controllers(injector: FaultInjector, computer: Computer, _: Settings) -> None:
    script(scripts.SET_CONTROLLERS, "state")(injector, computer, {"state": "active"})


FAULTS: dict[str, Fault] = {
    # -- the network
    "cable-cut": Fault(
        "the cable is unplugged: both ends lose their carrier",
        inject=_set_cable_cut(True),
        undo=_set_cable_cut(False),
        settings=WIRED,
        external=True,
    ),
    "switch-dead": Fault(
        "the switch is dead, or WiFi is out of range: both ends keep their carrier, but no frame passes",
        inject=_set_switch_dead(True),
        undo=_set_switch_dead(False),
        settings=WIRED,
        external=True,
    ),
    "slow-link": Fault(
        "the link has latency in each direction, with jitter",
        inject=_update_link,
        undo=_update_link,
        settings={**WIRED, "delay_ms": 60.0, "jitter_ms": 10.0},
        external=True,
        link_settings=lambda settings: {"delay_ms": settings["delay_ms"], "jitter_ms": settings["jitter_ms"]},
    ),
    "narrow-link": Fault(
        "the link carries only so much, both directions together; what waits longer than its queue is lost",
        inject=_update_link,
        undo=_update_link,
        settings={**WIRED, "rate_mbit_s": 10.0, "queue_ms": 200.0},
        external=True,
        link_settings=lambda settings: {"rate_mbit_s": settings["rate_mbit_s"], "queue_ms": settings["queue_ms"]},
    ),
    "lossy-link": Fault(
        "the link loses a fraction of all frames",
        inject=_update_link,
        undo=_update_link,
        settings={**WIRED, "loss": 0.2},
        external=True,
        link_settings=lambda settings: {"loss": settings["loss"]},
    ),
    "corrupting-link": Fault(
        "the link flips a bit in a fraction of all frames, as a damaged cable does",
        inject=_update_link,
        undo=_update_link,
        settings={**WIRED, "fraction": 0.2},
        external=True,
        link_settings=lambda settings: {"corrupted": settings["fraction"]},
    ),
    "duplicating-link": Fault(
        "the link delivers a fraction of all frames twice",
        inject=_update_link,
        undo=_update_link,
        settings={**WIRED, "fraction": 0.2},
        external=True,
        link_settings=lambda settings: {"duplicated": settings["fraction"]},
    ),
    "filtered-link": Fault(
        "a device in the link drops UDP to a range of ports; direction is to-robot or from-robot",
        inject=_update_link,
        undo=_update_link,
        settings={**WIRED, "direction": "to-robot", "first_port": DISCOVERY_PORT, "last_port": DISCOVERY_PORT},
        external=True,
        link_settings=_blocked_ports,
    ),
    "no-multicast": Fault(
        "the link drops multicast, as many access points do",
        inject=_update_link,
        undo=_update_link,
        settings=WIRED,
        external=True,
        link_settings=lambda _: {"multicast": False},
    ),
    "wifi-roam": Fault(
        "the laptop's WiFi joined another network: it has no address and no route on the robot's",
        inject=_set_laptop_away(True),
        undo=_set_laptop_away(False),
        settings=WIRELESS,
        external=True,
    ),
    "dual-homed": Fault(
        "the laptop has no route to the robot's access point, which the robot still announces; DDS data to the robot is lost",
        inject=_set_dual_homed(True),
        undo=_set_dual_homed(False),
        settings=WIRED,
        external=True,
        link_settings=lambda _: {"blocked_ports": USER_DATA_PORTS},
    ),
    # -- the computer
    "power-cut": Fault(
        "the robot loses its power; --undo switches it on",
        inject=lambda _, computer, __: computer.power_cut(),
        undo=lambda _, computer, __: computer.power_on(),
    ),
    "reboot": Fault("the robot reboots cleanly", inject=_reboot, undo=None),
    "frozen": Fault(
        "the robot hangs: its network accepts connections, but no process responds",
        inject=lambda _, computer, __: computer.freeze(True),
        undo=lambda _, computer, __: computer.freeze(False),
        external=True,
    ),
    "sshd-hung": Fault(
        "sshd hangs: the port accepts connections but sends no banner",
        inject=script(scripts.SIGNAL_SSHD.format(signal="STOP")),
        undo=script(scripts.SIGNAL_SSHD.format(signal="CONT")),
    ),
    "sshd-down": Fault(
        "sshd is stopped: the port refuses connections",
        inject=script("systemctl stop ssh"),
        undo=script("systemctl start ssh"),
    ),
    "host-key-changed": Fault(
        "the robot has new SSH host keys", inject=script(scripts.NEW_HOST_KEYS), undo=script(scripts.OLD_HOST_KEYS)
    ),
    "sudo-password": Fault(
        "sudo asks for mirte's password", inject=script(scripts.ASK_PASSWORD), undo=script(scripts.ALLOW_SUDO)
    ),
    "sudo-refused": Fault("mirte may not use sudo", inject=script(scripts.REFUSE_SUDO), undo=script(scripts.ALLOW_SUDO)),
    "program-missing": Fault(
        "a program is missing from the robot",
        inject=script(scripts.HIDE_PROGRAM, "program"),
        undo=script(scripts.SHOW_PROGRAM, "program"),
        settings={"program": "python3"},
    ),
    "disk-full": Fault(
        "the disk is full",
        inject=lambda _, computer, __: computer.limit_disk(computer.disk_used_mb()),
        undo=lambda _, computer, __: computer.limit_disk(None),
    ),
    "disk-read-only": Fault(
        "the file systems became read-only", inject=script(scripts.MAKE_READ_ONLY), undo=script(scripts.MAKE_WRITABLE)
    ),
    "port-taken": Fault(
        "another program listens on a TCP port",
        inject=script(scripts.TAKE_PORT, "port"),
        undo=script(scripts.FREE_PORT, "port"),
        settings={"port": VIDEO_PORT},
    ),
    # -- clocks
    "clock-wrong": Fault(
        "the robot's clock is wrong, as on a board without an RTC",
        inject=_set_clock_offset,
        undo=_correct_clock,
        settings={"offset_s": -287.5},
    ),
    "clock-drifts": Fault(
        "the crystal of the robot's clock runs too fast", inject=_set_crystal, undo=_correct_clock, settings={"ppm": 120.0}
    ),
    "chrony-not-serving": Fault(
        "the laptop's chronyd runs but answers no requests; --undo makes it answer",
        inject=_serve_ntp("silent"),
        undo=_serve_ntp("serving"),
        external=True,
    ),
    "chrony-stopped": Fault(
        "the robot's chronyd is stopped", inject=script("systemctl stop chrony"), undo=script("systemctl start chrony")
    ),
    "stock-makestep": Fault(
        "chrony may step the clock under a live stack, which is how the distribution configures it",
        inject=script(scripts.ALLOW_STEPS),
        undo=script(scripts.FORBID_STEPS),
    ),
    # -- DDS
    "server-not-started": Fault(
        f"mirte-ros lost the race at boot: it is active, but nothing listens on port {DISCOVERY_PORT}; cause is port or path",
        inject=scripts.lose_boot_race,
        undo=script(scripts.RESTART_ROS),
        settings={"cause": "port"},
    ),
    "server-killed": Fault(
        "the discovery server was killed",
        inject=script("pkill -KILL -x fast-discovery-"),
        undo=scripts.remove_segments(scripts.RESTART_ROS),
    ),
    "server-pinned": Fault(
        "the discovery server answers on one address only",
        inject=script(scripts.PIN_SERVER, "address"),
        undo=scripts.remove_segments(scripts.UNPIN_SERVER),
        settings={"address": "192.168.42.1"},
    ),
    "server-stopped": Fault(
        "the discovery server hangs: it holds its port but does not respond",
        inject=script(scripts.SIGNAL_SERVER.format(signal="STOP")),
        undo=script(scripts.SIGNAL_SERVER.format(signal="CONT")),
    ),
    "server-port-taken": Fault(
        "another program holds the discovery server's port",
        inject=script(scripts.TAKE_SERVER_PORT),
        undo=scripts.remove_segments(scripts.UNPIN_SERVER),
    ),
    "dds-off": Fault(
        "mirte's settings disable the discovery server: MIRTE_FASTDDS=false",
        inject=script(scripts.DISABLE_DISCOVERY_SERVER),
        undo=script(scripts.ENABLE_DISCOVERY_SERVER),
    ),
    "interface-late": Fault(
        "wlan0 came up after mirte-ros, which therefore does not use it",
        inject=script(scripts.RAISE_INTERFACE_LATE),
        undo=script(scripts.RESTART_ROS),
    ),
    "zombies": Fault(
        "stopped DDS participants hold ports",
        inject=scripts.start_stopped_participants,
        undo=scripts.remove_segments("systemctl kill --signal=KILL 'lupin-fault-zombie-*'; sleep 0.2"),
        settings={"count": 2},
    ),
    "shm-orphans": Fault(
        "killed DDS participants left shared-memory segments",
        inject=scripts.leave_segments,
        undo=scripts.remove_segments(),
        settings={"user": "mirte", "count": 2},
    ),
    "shm-foreign": Fault(
        "killed DDS participants of root left segments that block mirte's",
        inject=scripts.leave_segments,
        undo=scripts.remove_segments("systemctl stop mirte-ros", "systemctl start mirte-ros"),
        settings={"user": "root", "count": 1},
    ),
    "shm-full": Fault("/dev/shm is full", inject=script(scripts.FILL_SHM), undo=script("mount -o remount,size=256M /dev/shm")),
    # -- services
    "oneshot-failed": Fault(
        "a oneshot unit failed, and nothing retries it",
        inject=script(scripts.FAIL_ONESHOT, "unit"),
        undo=script(scripts.RESTORE_ONESHOT, "unit"),
        settings={"unit": "lupin-auto-home"},
    ),
    "unit": Fault(
        "a unit is stopped, disabled, masked, or failing until systemd gives up",
        inject=script(scripts.UNIT_STATE, "state", "unit"),
        undo=script(scripts.RESTORE_UNIT, "state", "unit"),
        settings={"state": "stopped", "unit": "lupin-onboard"},
    ),
    "camera-held": Fault(
        "another process holds a camera", inject=script(scripts.HOLD_CAMERA), undo=script(scripts.FREE_CAMERA)
    ),
    "home-locked": Fault(
        "mirte may not write to its home folder", inject=script(scripts.LOCK_HOME), undo=script(scripts.UNLOCK_HOME)
    ),
    "not-in-group": Fault(
        "mirte is no longer in a group",
        inject=script('gpasswd --delete mirte "$1" >/dev/null', "group"),
        undo=script('usermod --append --groups "$1" mirte', "group"),
        settings={"group": "input"},
    ),
    "controllers-stuck": Fault(
        "the vendor's controllers start in another state: unloaded, unconfigured or inactive",
        inject=script(scripts.SET_CONTROLLERS, "state"),
        undo=_activate_controllers,
        settings={"state": "unconfigured"},
    ),
}


def list_faults() -> list[dict[str, Any]]:
    """Return all faults: name, summary, settings with their defaults, and whether the fault can be undone."""
    return [
        {"name": name, "summary": fault.summary, "settings": dict(fault.settings), "undo": fault.undo is not None}
        for name, fault in FAULTS.items()
    ]


def parse_settings(name: str, assignments: list[str]) -> dict[str, Any]:
    """Return the settings of fault `name` from words SETTING=VALUE, in the types of the defaults. Raises FaultError."""
    fault = FAULTS.get(name)
    if fault is None:
        raise FaultError(f"unknown fault {name!r}; expected one of: {', '.join(sorted(FAULTS))}")
    chosen: dict[str, Any] = {}
    for assignment in assignments:
        key, _, text = assignment.partition("=")
        if key not in fault.settings:
            raise FaultError(f"{name} has no setting {key!r}; it has: {', '.join(fault.settings) or 'none'}")
        default = fault.settings[key]
        try:
            chosen[key] = type(default)(text)
        except ValueError:
            raise FaultError(f"{key} of {name}: expected a number like {default}, found {text!r}") from None
    return chosen
