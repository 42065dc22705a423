"""What faults do inside a robot: shell scripts run in there as root, which is where an operator's hands would be."""

from __future__ import annotations

import subprocess

from lupin_sim.host.bench import Act, Bench, FaultError, Settings, inside
from lupin_sim.host.machine import Machine

DROP_IN = "/run/systemd/system/{unit}.service.d/fault.conf"
READ_ONLY = "/etc /home /opt /srv /usr /var"
HELD_PORT = "lupin-fault-port-"
RACE_LOST = "wasn't able to allocate the specified listening port"
RACE_LIMIT_S = 20


def script(text: str, *settings: str, timeout_s: float = 30.0) -> Act:
    """An act that is a shell script; the values of these settings are its `$1`..."""

    def act(_: Bench, machine: Machine, chosen: Settings) -> None:
        inside(machine, text, *(str(chosen[name]) for name in settings), timeout_s=timeout_s)

    return act


# -- the discovery server

HOLD_PORT = """
import socket, sys
held = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
held.bind(("0.0.0.0", 11811))
print("held", flush=True)
sys.stdin.read()
"""
END_SERVER = """
pkill -x fast-discovery- || true
for _ in $(seq 100); do pgrep -x fast-discovery- >/dev/null || break; sleep 0.1; done
"""
# As at a boot: a server that a cure started outlives a restart of the vendor's stack.
STOP_ROS = f"""
systemctl stop mirte-ros
{END_SERVER}"""
NO_PATH = f"""
{STOP_ROS}unit={DROP_IN.format(unit="mirte-ros")}
mkdir -p "$(dirname $unit)"
printf '[Service]\\nEnvironment=PATH=/usr/sbin\\n' > $unit
systemctl daemon-reload
systemctl start mirte-ros
"""
RESTART_ROS = f"""
{STOP_ROS}rm -f {DROP_IN.format(unit="mirte-ros")}
systemctl daemon-reload
systemctl reset-failed mirte-ros 2>/dev/null || true
systemctl start mirte-ros
"""
AWAIT_LOST_RACE = f"""
for _ in $(seq {RACE_LIMIT_S * 10}); do
  journalctl --unit=mirte-ros --since="$1" --output=cat --no-pager | grep -q "{RACE_LOST}" && exit
  sleep 0.1
done
echo "the server did not complain" >&2
exit 1
"""


def lose_race(_: Bench, machine: Machine, settings: Settings) -> None:
    """mirte-ros starts while its server can't: the port is taken for that moment, or PATH isn't complete yet."""
    if settings["cause"] == "path":
        inside(machine, NO_PATH)
        return
    if settings["cause"] != "port":
        raise FaultError(f"the race is lost by port or by path, not by {settings['cause']!r}")
    inside(machine, STOP_ROS)
    since = inside(machine, "date '+%Y-%m-%d %H:%M:%S'").strip()
    with machine.popen_inside(["python3", "-c", HOLD_PORT], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        if holder.stdout.readline() != b"held\n":
            raise FaultError("port 11811 is still taken by another: sudo ss -lnup on the robot says by whom")
        inside(machine, "systemctl start mirte-ros")
        inside(machine, AWAIT_LOST_RACE, since, timeout_s=RACE_LIMIT_S + 10.0)
        # Leaving the block closes its standard input: it ends, and the port is free again.


LATE_INTERFACE = """
systemctl stop mirte-wifi-watchdog mirte-ap
systemctl restart mirte-ros
sleep 1
systemctl start mirte-ap mirte-wifi-watchdog
"""

PINNED = "lupin-fault-server"
# As a profile left in its environment does it: the server answers on one of the robot's addresses only.
PIN_SERVER = f"""
{END_SERVER}
systemd-run --quiet --collect --unit={PINNED} --uid=mirte fast-discovery-server -i 0 -l "$1" -p 11811
for _ in $(seq 100); do ss -lnu | grep -q ':11811 ' && exit; sleep 0.1; done
exit 1
"""
UNPIN_SERVER = f"systemctl stop {PINNED}; {RESTART_ROS}"
SERVER_SIGNAL = "pkill -{signal} -x fast-discovery-"
TAKE_SERVER_PORT = f"""
{END_SERVER}
systemd-run --quiet --collect --unit={PINNED} python3 -c '
import signal, socket
held = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
held.bind(("0.0.0.0", 11811))
signal.pause()'
for _ in $(seq 100); do ss -lnu | grep -q ':11811 ' && exit; sleep 0.1; done
exit 1
"""

# -- shared memory

# A participant that a signal ends or stops as soon as it has its segment.
PARTICIPANT = """
import os, pathlib, time
import rclpy
rclpy.init()
node = rclpy.create_node("{name}")
end = time.monotonic() + 10.0
while "/dev/shm/fastrtps_" not in pathlib.Path("/proc/self/maps").read_text() and time.monotonic() < end:
    time.sleep(0.02)
os.kill(os.getpid(), {signal})
"""
ORPHAN = PARTICIPANT.format(name="killed", signal=9)
# One that hangs, as after a Ctrl-C that it didn't survive: it holds its ports and answers nobody.
ZOMBIE = PARTICIPANT.format(name="zombie", signal=19)
DDS_ENVIRONMENT = "env -i PATH=/usr/bin:/bin ROS_LOG_DIR=/tmp/lupin-fault-$1 RMW_IMPLEMENTATION=rmw_fastrtps_cpp"
LEAVE_ORPHANS = """
[ "$1" = mirte ] || systemctl stop mirte-ros # what another user left is in the way of those who start later
for _ in $(seq "$2"); do
  setpriv --reuid="$1" --regid="$1" --init-groups -- {environment} {python} -c "$3" >/dev/null 2>&1 || true
done
[ "$1" = mirte ] || systemctl start mirte-ros
find /dev/shm -user "$1" -name 'fastrtps_*_el' | grep -q .
"""
# Fast DDS holds a lock on NAME_el for as long as it uses NAME.
SWEEP = """
import fcntl, glob, os
for lock in glob.glob("/dev/shm/fastrtps_*_el"):
    try:
        with open(lock) as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        continue
    name = os.path.basename(lock)[:-3]
    for path in (lock, "/dev/shm/" + name, "/dev/shm/sem." + name + "_mutex"):
        if os.path.exists(path):
            os.remove(path)
"""


def orphan(_: Bench, machine: Machine, settings: Settings) -> None:
    """Kill real participants over their segments."""
    text = LEAVE_ORPHANS.format(environment=DDS_ENVIRONMENT, python=machine.project_python)
    inside(machine, text, settings["user"], str(settings["count"]), ORPHAN, timeout_s=60.0)


def sweep(before: str = "true", after: str = "true") -> Act:
    """Take back what killed participants left, between two shell scripts."""

    def act(_: Bench, machine: Machine, __: Settings) -> None:
        inside(machine, before)
        inside(machine, 'python3 -c "$1"', SWEEP)
        inside(machine, after)

    return act


def zombie(_: Bench, machine: Machine, settings: Settings) -> None:
    """Start participants that stop themselves."""
    for number in range(int(settings["count"])):
        options = f"--quiet --unit=lupin-fault-zombie-{number} --uid=mirte --setenv=ROS_LOG_DIR=/tmp/lupin-fault-mirte"
        inside(machine, f'systemd-run {options} {machine.project_python} -c "$1"', ZOMBIE)
    inside(
        machine,
        """
        for _ in $(seq 200); do
          stopped=$(ps -o stat= -C python,python3 | grep -c '^T') || true
          [ "$stopped" -ge "$1" ] && exit
          sleep 0.1
        done
        exit 1""",
        str(settings["count"]),
    )


# -- disk, programs, permissions

FILL_SHM = """
used=$(df --output=used -k /dev/shm | tail -n 1)
mount -o remount,size=$((used + 4))k /dev/shm
"""
MAKE_READ_ONLY = f"for folder in {READ_ONLY}; do mount --bind $folder $folder; mount -o remount,bind,ro $folder; done"
MAKE_WRITABLE = f"for folder in {READ_ONLY}; do umount --lazy $folder || true; done"
HIDE_PROGRAM = """
found=$(command -v "$1") || { echo "there is no $1 in PATH" >&2; exit 1; }
found=$(readlink -f "$found")
mv "$found" "$found.fault"
echo "$found" > "/run/lupin-fault-program-$1"
"""
SHOW_PROGRAM = 'found=$(cat "/run/lupin-fault-program-$1"); mv "$found.fault" "$found"'
ASK_PASSWORD = "rm -f /etc/sudoers.d/mirte"
REFUSE_SUDO = ASK_PASSWORD + "; gpasswd --delete mirte sudo >/dev/null"
ALLOW_SUDO = """
printf 'mirte ALL=(ALL) NOPASSWD:ALL\\n' > /etc/sudoers.d/mirte
chmod 440 /etc/sudoers.d/mirte
usermod --append --groups sudo mirte
"""
NEW_HOST_KEYS = """
mkdir -p /run/lupin-fault-keys
cp -p /etc/ssh/ssh_host_* /run/lupin-fault-keys
for kind in ed25519 ecdsa rsa; do
  rm -f /etc/ssh/ssh_host_${kind}_key*
  ssh-keygen -q -t $kind -N '' -f /etc/ssh/ssh_host_${kind}_key
done
systemctl restart ssh
"""
OLD_HOST_KEYS = "cp -p /run/lupin-fault-keys/* /etc/ssh; systemctl restart ssh"
SSHD = "kill -{signal} $(systemctl show --property=MainPID --value ssh)"

# -- services

FAIL_ONESHOT = f"""
if [ ! -e /etc/systemd/system/$1.service ]; then
  printf '[Unit]\\nDescription=fault\\n[Service]\\nType=oneshot\\nExecStart=/bin/true\\n' > /run/systemd/system/$1.service
fi
unit={DROP_IN.format(unit="$1")}
mkdir -p "$(dirname $unit)"
printf '[Service]\\nExecStart=\\nExecStart=/bin/false\\nRestart=no\\n' > $unit
systemctl daemon-reload
# One that has ended well counts as active, and a start of it does nothing. What it waits for may never come up.
systemctl restart --job-mode=ignore-dependencies $1 2>/dev/null || true
rm $unit
systemctl daemon-reload
systemctl is-failed --quiet $1
"""
MEND_ONESHOT = """
systemctl reset-failed $1 2>/dev/null || true
rm -f /run/systemd/system/$1.service
systemctl daemon-reload
[ ! -e /etc/systemd/system/$1.service ] || systemctl restart --no-block $1
"""
SETTINGS_FALSE = "echo 'export MIRTE_FASTDDS=false' > /home/mirte/.mirte_settings.sh; systemctl restart mirte-ros"
SETTINGS_TRUE = "echo 'export MIRTE_FASTDDS=true' > /home/mirte/.mirte_settings.sh; systemctl restart mirte-ros"
# What Debian and Ubuntu ship: it steps a live stack as soon as a source that is far off answers for the first time.
STEPPING = "sed -i '/makestep/d' /etc/chrony/chrony.conf; echo 'makestep 1 3' >> /etc/chrony/chrony.conf"
SLEWING = "sed -i 's/^ *makestep/#makestep/' /etc/chrony/chrony.conf"
UNIT_STATE = """
case $1 in
  stopped) systemctl stop "$2" ;;
  disabled) systemctl disable --quiet "$2" ;;
  masked) systemctl stop "$2"; mv "/etc/systemd/system/$2.service" /run/lupin-fault-$2; systemctl mask --quiet "$2" ;;
  failing)
    mkdir -p "/run/systemd/system/$2.service.d"
    cat > "/run/systemd/system/$2.service.d/fault.conf" <<UNIT
[Unit]
StartLimitIntervalSec=60
StartLimitBurst=2
[Service]
Type=simple
ExecStart=
ExecStart=/bin/false
Restart=on-failure
RestartSec=100ms
UNIT
    systemctl daemon-reload
    systemctl restart "$2" || true
    for _ in $(seq 100); do systemctl is-failed --quiet "$2" && exit; sleep 0.1; done
    exit 1 ;;
  *) echo "a unit is stopped, disabled, masked or failing, not $1" >&2; exit 1 ;;
esac
"""
MEND_UNIT = """
case $1 in
  disabled) systemctl enable --quiet "$2" ;;
  masked)
    systemctl unmask --quiet "$2"
    mv /run/lupin-fault-$2 "/etc/systemd/system/$2.service"
    systemctl enable --quiet "$2" ;;
  failing) rm -rf "/run/systemd/system/$2.service.d" ;;
esac
systemctl daemon-reload
systemctl reset-failed "$2" 2>/dev/null || true
systemctl start --no-block "$2"
"""
STRAY = "lupin-fault-camera"
HOLD_CAMERA = f"""
touch /dev/video0
systemd-run --quiet --collect --unit={STRAY} --uid=mirte sh -c 'exec sleep infinity < /dev/video0'
for _ in $(seq 100); do find /proc/[0-9]*/fd -lname /dev/video0 2>/dev/null | grep -q . && exit; sleep 0.1; done
exit 1
"""
FREE_CAMERA = f"systemctl stop {STRAY} 2>/dev/null || true; rm -f /dev/video0"
LOCK_HOME = "chown root: /home/mirte"
UNLOCK_HOME = "chown mirte: /home/mirte"
TAKE_PORT = f"systemd-run --quiet --unit={HELD_PORT}$1 /opt/mirte/hold-ports [::]:$1"
GIVE_PORT = f"systemctl stop {HELD_PORT}$1"
CONTROLLERS = """
[ -e /etc/mirte/robot ] || { echo "no robot runs on this host: boot it with --vendor-robot" >&2; exit 1; }
sed -i 's/ --controllers [a-z]*//; s/\\(ROBOT_ARGUMENTS=.*\\).$/\\1 --controllers '$1"'/" /etc/mirte/robot
systemctl restart mirte-ros
"""
