"""Faults of files: edited, renamed, with other permissions, at either end."""

from __future__ import annotations

import random

from bench.faults.fault import (
    INVENTORY,
    LAPTOP,
    PROFILE,
    RESTART_STACK,
    ROBOT,
    SERVER_PORT,
    SSH,
    Effect,
    Fault,
    Step,
    file_step,
    harmless,
    rename_step,
)

NO_TRANSPORTS = "<useBuiltinTransports>false</useBuiltinTransports>"
OWN_ONLY = f"<userTransports><transport_id>own</transport_id></userTransports>{NO_TRANSPORTS}"
LOOPBACK_ONLY = (
    "<transport_descriptors><transport_descriptor><transport_id>own</transport_id><type>UDPv4</type>"
    "<interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList></transport_descriptor></transport_descriptors>"
)


def edit_profile(rng: random.Random) -> Fault:
    """A wrong value in the DDS profile of the laptop, or a damaged file."""
    text, change, effect = rng.choice(
        (
            ("port", f"sed -i 's/>{SERVER_PORT}</>{SERVER_PORT + rng.randrange(1, 99)}</' {{path}}", Effect.MAY_BREAK),
            ("address", f"sed -i 's/>10.42.0.1</>10.42.0.{rng.randrange(3, 250)}</' {{path}}", Effect.MAY_BREAK),
            ("prefix", f"sed -i 's/prefix=\"44/prefix=\"{rng.randrange(10, 44)}/' {{path}}", Effect.MAY_BREAK),
            ("mode", f"sed -i 's/SUPER_CLIENT/{rng.choice(('SIMPLE', 'CLIENT', 'SERVER'))}/' {{path}}", Effect.MAY_BREAK),
            ("default", 'sed -i \'s/is_default_profile="true"/is_default_profile="false"/\' {path}', Effect.MAY_BREAK),
            ("cut off", f"truncate -s {rng.randrange(0, 700)} {{path}}", Effect.MAY_BREAK),
            ("server removed", "sed -i '/<locator>/,/<.locator>/d' {path}", Effect.MAY_BREAK),
            ("no transports", f"sed -i 's,<rtps>,<rtps>{NO_TRANSPORTS},' {{path}}", Effect.MAY_BREAK),
            (
                "whitelist",
                f"sed -i 's,<profiles>,<profiles>{LOOPBACK_ONLY},; s,<rtps>,<rtps>{OWN_ONLY},' {{path}}",
                Effect.BREAKS,
            ),
        )
    )
    step = file_step(LAPTOP, PROFILE, change)
    return Fault("edit", f"laptop: profile: {text}: {change}", "dds", "profile", LAPTOP, effect, (step,))


def remove_profile(rng: random.Random) -> Fault:
    """A profile that has another name than the variable says."""
    del rng
    return Fault("rename", "laptop: profile away", "dds", "profile", LAPTOP, Effect.MAY_BREAK, (rename_step(LAPTOP, PROFILE),))


def edit_login(rng: random.Random) -> Fault:
    """A file without which nobody logs in, at either end."""
    garbage = f"printf 'x%s' {rng.randrange(10**9)} > {{path}}"
    where, path, change, after = rng.choice(
        (
            (LAPTOP, f"{SSH}/id_ed25519", garbage, ""),
            (LAPTOP, f"{SSH}/known_hosts", "sed -i 's/ AAAA/ AAAB/' {path}", ""),
            (ROBOT, "/home/mirte/.ssh/authorized_keys", rng.choice((garbage, ": > {path}")), ""),
            (ROBOT, "/home/mirte/.ssh", "chmod 0777 {path}", ""),
            (ROBOT, "/home/mirte/.ssh", "chown 4242 {path}", ""),
            (ROBOT, "/etc/passwd", "sed -i '/^mirte:/s,/bin/bash,/bin/false,' {path}", ""),
            (ROBOT, "/etc/ssh/sshd_config", f"sed -i '1i Port {rng.randrange(2000, 9000)}' {{path}}", "systemctl restart ssh"),
        )
    )
    verb = "chmod" if change.startswith("ch") else "edit"
    step = file_step(where, path, change, after)
    return Fault(verb, f"{where}: {path}: {change}", "login", "login", where, Effect.BREAKS, (step,), hides_robot=True)


def add_dead_proxy(rng: random.Random) -> Fault:
    """An SSH configuration that leads every login over a computer that does not exist."""
    make = f"printf 'Host *\\n  ProxyJump nobody@10.42.0.{rng.randrange(3, 250)}\\n' > {SSH}/config"
    step = Step(LAPTOP, make, f"rm {SSH}/config")
    return Fault("edit", f"laptop: {make}", "login", "login", LAPTOP, Effect.BREAKS, (step,), hides_robot=True)


def rename_login(rng: random.Random) -> Fault:
    """A file of the login that has another name."""
    where, path = rng.choice(((LAPTOP, f"{SSH}/id_ed25519"), (LAPTOP, f"{SSH}/known_hosts"), (ROBOT, "/home/mirte/.ssh")))
    step = rename_step(where, path)
    return Fault("rename", f"{where}: {path} away", "login", "login", where, Effect.BREAKS, (step,), hides_robot=True)


def edit_server_start(rng: random.Random) -> Fault:
    """A discovery server that the vendor's script starts elsewhere."""
    change = rng.choice(
        (
            f"sed -i 's/-p {SERVER_PORT}/-p {SERVER_PORT + rng.randrange(1, 90)}/' {{path}}",
            f"sed -i 's/-l 0.0.0.0/-l {rng.choice(('127.0.0.1', '192.168.42.1'))}/' {{path}}",
            f"sed -i 's/server -i 0/server -i {rng.randrange(1, 9)}/' {{path}}",
        )
    )
    step = file_step(ROBOT, "/opt/mirte/mirte_ros.sh", change, RESTART_STACK)
    return Fault("edit", f"robot: mirte_ros.sh: {change}", "stack", "discovery", ROBOT, Effect.BREAKS, (step,), restarts=True)


def edit_vendor_settings(rng: random.Random) -> Fault:
    """A value in the vendor's settings with which its script starts no discovery server."""
    value = rng.choice(("True", "yes", "1", "on", "TRUE", "false"))
    change = f"sed -i 's/MIRTE_FASTDDS=true/MIRTE_FASTDDS={value}/' {{path}}"
    step = file_step(ROBOT, "/home/mirte/.mirte_settings.sh", change, RESTART_STACK)
    text = f"robot: MIRTE_FASTDDS={value}"
    return Fault("edit", text, "stack", "discovery", ROBOT, Effect.BREAKS, (step,), restarts=True)


def edit_time_source(rng: random.Random) -> Fault:
    """A time source that does not exist, in the configuration of the robot's chrony."""
    address = f"10.42.0.{rng.randrange(3, 250)}"
    change = f"sed -i -E 's/^server +[0-9.]+/server {address}/' {{path}}"
    step = file_step(ROBOT, "/etc/chrony/conf.d/lupin.conf", change, "systemctl restart chrony")
    return Fault("edit", f"robot: chrony asks {address}", "clock", "clock", ROBOT, Effect.MAY_BREAK, (step,))


def edit_exports(rng: random.Random) -> Fault:
    """Exports of Lupin's set-up with which the next shell asks another server, or none."""
    change = rng.choice(
        (
            f"sed -i 's/10.42.0.1:/10.42.0.{rng.randrange(3, 250)}:/' {{path}}",
            "sed -i '/ROS_DISCOVERY_SERVER/d' {path}",
        )
    )
    step = file_step(LAPTOP, '"$HOME"/.config/lupin/ros-env.sh', change)
    return Fault("edit", f"laptop: ros-env.sh: {change}", "dds", "environment", LAPTOP, Effect.MAY_BREAK, (step,))


def break_vendor_file(rng: random.Random) -> Fault:
    """A file of the vendor's stack that cannot be run or found at its next start."""
    verb, path, layer = rng.choice(
        (
            ("chmod", "/usr/bin/fast-discovery-server", "discovery"),
            ("rename", "/usr/bin/fast-discovery-server", "discovery"),
            ("chmod", "/opt/mirte/launch-robot", "processes"),
            ("rename", "/opt/mirte/launch-robot", "processes"),
            ("chmod", "/opt/mirte/mirte_ros.sh", "processes"),
            ("rename", "/etc/mirte/robot", "processes"),
        )
    )
    after = RESTART_STACK + " || true"
    step = file_step(ROBOT, path, "chmod 0644 {path}", after) if verb == "chmod" else rename_step(ROBOT, path, after)
    return Fault(verb, f"robot: {verb} {path}", "stack", layer, ROBOT, Effect.BREAKS, (step,), restarts=True)


def break_release(rng: random.Random) -> Fault:
    """A release whose files were moved or damaged under the running units."""
    step = rng.choice(
        (
            rename_step(ROBOT, "/opt/lupin/current"),
            file_step(ROBOT, "/opt/lupin/current/release.json", f"truncate -s {rng.randrange(0, 12)} {{path}}"),
            rename_step(ROBOT, "/opt/lupin/current/venv"),
        )
    )
    return Fault("rename", f"robot: {step.make}", "release", "release", ROBOT, Effect.MAY_BREAK, (step,))


def rename_shared_memory(rng: random.Random) -> Fault:
    """Segments of shared memory that are gone under the processes that hold them."""
    del rng
    make = "mkdir -p /dev/shm/away\nmv /dev/shm/fastrtps_* /dev/shm/away"
    undo = "mv /dev/shm/away/* /dev/shm 2>/dev/null || true\nrm -rf /dev/shm/away"
    step = Step(ROBOT, make, undo)
    return Fault("rename", "robot: /dev/shm/fastrtps_* away", "stack", "shared-memory", ROBOT, Effect.MAY_BREAK, (step,))


def change_unused_file(rng: random.Random) -> Fault:
    """A file that nothing reads, or a change without meaning."""
    where, path, verb, change = rng.choice(
        (
            (LAPTOP, PROFILE, "edit", "printf '<!-- %s -->\\n' >> {path}"),
            (LAPTOP, PROFILE, "chmod", "chmod 0444 {path}"),
            (LAPTOP, INVENTORY, "edit", "printf '# %s\\n' >> {path}"),
            (LAPTOP, f"{SSH}/known_hosts", "edit", "printf '# %s\\n' >> {path}"),
            (ROBOT, "/etc/hosts", "edit", "printf '198.51.100.1 host%s\\n' >> {path}"),
            (ROBOT, "/home/mirte/.profile", "edit", "printf '# %s\\n' >> {path}"),
            (ROBOT, "/opt/mirte/wifi-watchdog", "edit", "printf '# %s\\n' >> {path}"),
            (ROBOT, "/etc/issue.net", "chmod", "chmod 0600 {path}"),
        )
    )
    change = change.replace("%s", str(rng.randrange(10**6)))
    return harmless(verb, f"{where}: {path}: {change}", file_step(where, path, change))
