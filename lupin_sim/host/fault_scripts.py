"""The faults inside a robot: shell scripts that run there as root and do what a real cause would do."""

from __future__ import annotations

import subprocess

from lupin_runtime.ports import DISCOVERY_PORT
from lupin_sim.host.computer import Computer
from lupin_sim.host.fault_injector import FaultAction, FaultError, FaultInjector, Settings, run_script

DROP_IN = "/run/systemd/system/{unit}.service.d/fault.conf"
READ_ONLY = "/etc /home /opt /srv /usr /var"
PORT_HOLDER_UNIT = "lupin-fault-port-"
RACE_LOST = "wasn't able to allocate the specified listening port"
RACE_TIMEOUT_S = 20


def script(text: str, *settings: str, timeout_s: float = 30.0) -> FaultAction:
    """Return the action that runs a shell script on the robot, with the values of the named settings as `$1`..."""

    def run(_: FaultInjector, computer: Computer, chosen: Settings) -> None:
        run_script(computer, text, *(str(chosen[name]) for name in settings), timeout_s=timeout_s)

    return run


# -- the discovery server

HOLD_PORT = f"""
import socket, sys
server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
server.bind(("0.0.0.0", {DISCOVERY_PORT}))
print("bound", flush=True)
sys.stdin.read()
"""
KILL_SERVER = """
pkill -x fast-discovery- || true
for _ in $(seq 100); do pgrep -x fast-discovery- >/dev/null || break; sleep 0.1; done
"""
# Terminates the server too, as a reboot would: a server that a fix started outlives a restart of the vendor's stack.
STOP_ROS = f"""
systemctl stop mirte-ros
{KILL_SERVER}"""
START_WITHOUT_SERVER_IN_PATH = f"""
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
WAIT_FOR_LOST_RACE = f"""
for _ in $(seq {RACE_TIMEOUT_S * 10}); do
  journalctl --unit=mirte-ros --since="$1" --output=cat --no-pager | grep -q "{RACE_LOST}" && exit
  sleep 0.1
done
echo "the server did not report that its port is taken" >&2
exit 1
"""


def lose_boot_race(_: FaultInjector, computer: Computer, settings: Settings) -> None:
    """Start mirte-ros while its server cannot start: the port is taken for that moment, or PATH lacks the server."""
    if settings["cause"] == "path":
        run_script(computer, START_WITHOUT_SERVER_IN_PATH)
        return
    if settings["cause"] != "port":
        raise FaultError(f"expected the cause port or path, found {settings['cause']!r}")
    run_script(computer, STOP_ROS)
    since = run_script(computer, "date '+%Y-%m-%d %H:%M:%S'").strip()
    with computer.popen_as_root(["python3", "-c", HOLD_PORT], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as port_holder:
        assert port_holder.stdout is not None
        if port_holder.stdout.readline() != b"bound\n":
            raise FaultError(f"port {DISCOVERY_PORT} is still taken; to see by what, run on the robot: sudo ss -lnup")
        run_script(computer, "systemctl start mirte-ros")
        run_script(computer, WAIT_FOR_LOST_RACE, since, timeout_s=RACE_TIMEOUT_S + 10.0)
        # Leaving the block closes the holder's standard input, which terminates it and frees the port.


RAISE_INTERFACE_LATE = """
systemctl stop mirte-wifi-watchdog mirte-ap
systemctl restart mirte-ros
sleep 1
systemctl start mirte-ap mirte-wifi-watchdog
"""

SERVER_UNIT = "lupin-fault-server"
# A DDS profile left in the server's environment has this effect: the server answers on only one of the robot's addresses.
PIN_SERVER = f"""
{KILL_SERVER}
systemd-run --quiet --collect --unit={SERVER_UNIT} --uid=mirte fast-discovery-server -i 0 -l "$1" -p {DISCOVERY_PORT}
for _ in $(seq 100); do ss -lnu | grep -q ':{DISCOVERY_PORT} ' && exit; sleep 0.1; done
exit 1
"""
UNPIN_SERVER = f"systemctl stop {SERVER_UNIT}; {RESTART_ROS}"
SIGNAL_SERVER = "pkill -{signal} -x fast-discovery-"
TAKE_SERVER_PORT = f"""
{KILL_SERVER}
systemd-run --quiet --collect --unit={SERVER_UNIT} python3 -c '
import signal, socket
server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
server.bind(("0.0.0.0", {DISCOVERY_PORT}))
signal.pause()'
for _ in $(seq 100); do ss -lnu | grep -q ':{DISCOVERY_PORT} ' && exit; sleep 0.1; done
exit 1
"""

# -- shared memory

# A DDS participant that sends itself a signal as soon as it has mapped a shared-memory segment.
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
KILLED_PARTICIPANT = PARTICIPANT.format(name="killed", signal=9)
# Hangs like a program after a failed Ctrl-C: it holds its ports and does not respond.
STOPPED_PARTICIPANT = PARTICIPANT.format(name="zombie", signal=19)
DDS_ENVIRONMENT = "env -i PATH=/usr/bin:/bin ROS_LOG_DIR=/tmp/lupin-fault-$1 RMW_IMPLEMENTATION=rmw_fastrtps_cpp"
LEAVE_ORPHANS = """
[ "$1" = mirte ] || systemctl stop mirte-ros # another user's segments block only processes that start after them
for _ in $(seq "$2"); do
  setpriv --reuid="$1" --regid="$1" --init-groups -- {environment} {python} -c "$3" >/dev/null 2>&1 || true
done
[ "$1" = mirte ] || systemctl start mirte-ros
find /dev/shm -user "$1" -name 'fastrtps_*_el' | grep -q .
"""
# Fast DDS holds a lock on NAME_el for as long as it uses segment NAME.
REMOVE_STALE_SEGMENTS = """
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


def leave_segments(_: FaultInjector, computer: Computer, settings: Settings) -> None:
    """Kill real DDS participants, which leaves their shared-memory segments behind."""
    text = LEAVE_ORPHANS.format(environment=DDS_ENVIRONMENT, python=computer.project_python)
    run_script(computer, text, settings["user"], str(settings["count"]), KILLED_PARTICIPANT, timeout_s=60.0)


def remove_segments(before: str = "true", after: str = "true") -> FaultAction:
    """Return the action that removes the segments of dead participants, between two shell scripts."""

    def run(_: FaultInjector, computer: Computer, __: Settings) -> None:
        run_script(computer, before)
        run_script(computer, 'python3 -c "$1"', REMOVE_STALE_SEGMENTS)
        run_script(computer, after)

    return run


def start_stopped_participants(_: FaultInjector, computer: Computer, settings: Settings) -> None:
    """Start DDS participants that stop themselves (SIGSTOP), and wait until they have."""
    for number in range(int(settings["count"])):
        options = f"--quiet --unit=lupin-fault-zombie-{number} --uid=mirte --setenv=ROS_LOG_DIR=/tmp/lupin-fault-mirte"
        run_script(computer, f'systemd-run {options} {computer.project_python} -c "$1"', STOPPED_PARTICIPANT)
    run_script(
        computer,
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
ASK_PASSWORD = "rm -f /etc/sudoers.d/mirte"  # noqa: S105 -- no password
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
SIGNAL_SSHD = "kill -{signal} $(systemctl show --property=MainPID --value ssh)"

# -- services

FAIL_ONESHOT = f"""
if [ ! -e /etc/systemd/system/$1.service ]; then
  printf '[Unit]\\nDescription=fault\\n[Service]\\nType=oneshot\\nExecStart=/bin/true\\n' > /run/systemd/system/$1.service
fi
unit={DROP_IN.format(unit="$1")}
mkdir -p "$(dirname $unit)"
printf '[Service]\\nExecStart=\\nExecStart=/bin/false\\nRestart=no\\n' > $unit
systemctl daemon-reload
# A oneshot that succeeded counts as active, and a start would do nothing. Its dependencies may never come up.
systemctl restart --job-mode=ignore-dependencies $1 2>/dev/null || true
rm $unit
systemctl daemon-reload
systemctl is-failed --quiet $1
"""
RESTORE_ONESHOT = """
systemctl reset-failed $1 2>/dev/null || true
rm -f /run/systemd/system/$1.service
systemctl daemon-reload
[ ! -e /etc/systemd/system/$1.service ] || systemctl restart --no-block $1
"""
DISABLE_DISCOVERY_SERVER = "echo 'export MIRTE_FASTDDS=false' > /home/mirte/.mirte_settings.sh; systemctl restart mirte-ros"
ENABLE_DISCOVERY_SERVER = "echo 'export MIRTE_FASTDDS=true' > /home/mirte/.mirte_settings.sh; systemctl restart mirte-ros"
# As Debian and Ubuntu configure it: chrony steps the clock under a live stack if a source's first answers are far off.
ALLOW_STEPS = "sed -i '/makestep/d' /etc/chrony/chrony.conf; echo 'makestep 1 3' >> /etc/chrony/chrony.conf"
FORBID_STEPS = "sed -i 's/^ *makestep/#makestep/' /etc/chrony/chrony.conf"
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
  *) echo "expected the state stopped, disabled, masked or failing, found $1" >&2; exit 1 ;;
esac
"""
RESTORE_UNIT = """
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
CAMERA_HOLDER_UNIT = "lupin-fault-camera"
HOLD_CAMERA = f"""
touch /dev/video0
systemd-run --quiet --collect --unit={CAMERA_HOLDER_UNIT} --uid=mirte sh -c 'exec sleep infinity < /dev/video0'
for _ in $(seq 100); do find /proc/[0-9]*/fd -lname /dev/video0 2>/dev/null | grep -q . && exit; sleep 0.1; done
exit 1
"""
FREE_CAMERA = f"systemctl stop {CAMERA_HOLDER_UNIT} 2>/dev/null || true; rm -f /dev/video0"
LOCK_HOME = "chown root: /home/mirte"
UNLOCK_HOME = "chown mirte: /home/mirte"
TAKE_PORT = f"systemd-run --quiet --unit={PORT_HOLDER_UNIT}$1 /opt/mirte/hold-ports [::]:$1"
FREE_PORT = f"systemctl stop {PORT_HOLDER_UNIT}$1"
SET_CONTROLLERS = """
[ -e /etc/mirte/robot ] || { echo "this host runs no simulated robot: boot it with --vendor-robot" >&2; exit 1; }
sed -i 's/ --controllers [a-z]*//; s/\\(ROBOT_ARGUMENTS=.*\\).$/\\1 --controllers '$1"'/" /etc/mirte/robot
systemctl restart mirte-ros
"""
