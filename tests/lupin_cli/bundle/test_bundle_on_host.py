"""`lupin bundle` of a simulated computer: it contains the robot's faults but no secrets, and changes nothing."""

from __future__ import annotations

import json
import shutil
import sys
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.bundle.collect import to_plain_data
from lupin_cli.checks.table import built_in
from lupin_cli.connection import Output
from lupin_cli.doctor.gathering import needed_facts
from lupin_sim.host import Host
from lupin_sim.host.host import PROJECT

pytestmark = pytest.mark.host

CONNECTION = "/etc/NetworkManager/system-connections/garden.nmconnection"
UNITS = ("lupin-planted", "wpa_supplicant")
PLANT = f"""
mkdir -p /etc/NetworkManager/system-connections
umask 077
printf '%s\\n' '[connection]' 'id=Garden of 5' type=wifi '[wifi]' ssid=Garden5Net mac-address=b8:27:eb:a1:b2:c3 \\
  '[wifi-security]' key-mgmt=wpa-psk 'psk=planted7 phrase' > {CONNECTION}
say() {{
  unit=$1; shift; printf '%s\\n' "$@" > /run/planted
  systemd-run --quiet --wait --collect --unit=$unit cat /run/planted
}}
say wpa_supplicant "wlan0: Trying to associate with b8:27:eb:a1:b2:c3 (SSID='Garden5Net' freq=2412 MHz)" \\
  "added 'psk' value 'planted7journal'" 'someone wrote planted7 phrase into the log'
say lupin-planted 'GET /climate Authorization: Bearer planted7token' 'joined Garden5Net' 'token planted7token was refused' \\
  '-----BEGIN OPENSSH PRIVATE KEY-----' planted7keyAAAAB3NzaC1yc2EAAAADAQABAAABgQ '-----END OPENSSH PRIVATE KEY-----'
rm /run/planted
"""
# Every file and folder except the kernel's, those in memory, and those that logins write.
STATE = (
    "find / -xdev \\( -path /proc -o -path /sys -o -path /dev -o -path /run -o -path /var/log \\) -prune -o "
    "-printf '%p %y %s %m %U %T@ %C@ %l\\n'"
)


@pytest.fixture
def planted(host: Host) -> Iterator[Host]:
    run_as_root = host.robot.run_as_root
    done = run_as_root("sh", "-ec", PLANT)
    assert done.status == 0, done.stderr
    yield host
    run_as_root("rm", "-r", "/etc/NetworkManager")


def bundle(host: Host, home: Path, *words: str) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Run `lupin bundle --json` for the robot with a user at `home`. Returns its output and the files of the archive."""
    ssh = home / ".ssh"
    ssh.mkdir(mode=0o700)
    shutil.copy(host.key, ssh / "id_ed25519")
    (ssh / "id_ed25519").chmod(0o600)
    shutil.copy(host.known_hosts, ssh / "known_hosts")
    command = [sys.executable, "-m", "lupin_cli.app", "bundle", "--host", "mirte@10.42.0.1", "--out", str(home / "b.tar.gz")]
    environment = {"PATH": "/usr/bin:/bin:/usr/sbin:/sbin", "HOME": str(home)}
    done = host.run([*command, "--json", *words], env=environment, cwd=str(PROJECT), timeout_s=120.0)
    assert done.stdout, done.stderr
    summary = json.loads(done.stdout)
    assert done.returncode == summary["status"]
    with tarfile.open(home / "b.tar.gz") as tar:
        return summary, {entry.name.split("/", 1)[1]: tar.extractfile(entry).read() for entry in tar}  # type: ignore[union-attr]


def logins(host: Host) -> int:
    return host.robot.run_as_root("journalctl", "-q", "-o", "cat", "-u", "ssh").stdout.count("Accepted publickey")


def test_bundle_has_faults_and_no_secrets_of_robot(planted: Host, tmp_path: Path) -> None:
    host = planted
    host.ssh("sudo -n true")  # the first sudo of a user creates ~/.sudo_as_admin_successful
    state, before = host.robot.run_as_root("sh", "-c", STATE).stdout, logins(host)
    assert CONNECTION in state
    summary, found = bundle(host, tmp_path)
    after = host.robot.run_as_root("sh", "-c", STATE).stdout
    assert set(after.splitlines()) ^ set(state.splitlines()) == set()  # nothing was changed
    assert logins(host) == before + 1

    for secret in (b"planted7", b"Garden5Net", b"Garden of 5", b"b8:27:eb:a1:b2:c3"):
        assert [name for name, data in found.items() if secret in data] == []
    robot = "robots/mirte@10.42.0.1"
    settings = found[f"{robot}/network/settings.txt"].decode()
    assert "psk=***\n" in settings and "key-mgmt=wpa-psk" in settings
    log = found[f"{robot}/journal/lupin.log"].decode()
    assert "token *** was refused" in log
    ssid, mac = (settings.partition(f"\n{key}=")[2].partition("\n")[0] for key in ("ssid", "mac-address"))
    network = found[f"{robot}/journal/network.log"].decode()
    assert f"Trying to associate with {mac} (SSID='{ssid}' freq" in network  # equal values have equal pseudonyms
    assert f"joined {ssid}" in log
    assert "someone wrote *** into the log" in network

    # Lupin was never deployed to this robot, and its chrony.conf is Debian's.
    causes = {finding["id"] for finding in json.loads(found["findings/mirte@10.42.0.1.json"])["findings"]}
    assert {"not-deployed", "chrony-stock-makestep"} <= causes
    assert b"not-deployed" in found["findings/mirte@10.42.0.1.md"]
    assert b"Server is running" in found[f"{robot}/journal/mirte-ros.log"]
    assert b"SUPER_CLIENT" in found[f"{robot}/dds/files.txt"]
    assert b"ExecStart=" in found[f"{robot}/units/installed.txt"]
    # A computer in a namespace can't read the kernel's ring buffer; everything else is there.
    assert {each["path"] for each in summary["left_out"] if each["kind"] != "absent"} == {f"{robot}/system/dmesg.txt"}
    assert summary["status"] == 1


def test_probes_in_archive_parse_to_archived_facts(host: Host, tmp_path: Path) -> None:
    _, found = bundle(host, tmp_path)
    for machine, folder in (("robot", "robots/mirte@10.42.0.1"), ("laptop", "laptop")):
        values = json.loads(found[f"{folder}/facts.json"])["facts"]
        index = json.loads(found[f"{folder}/probes/index.json"])
        read = 0
        for fact in needed_facts(built_in(), machine):
            output = found.get(f"{folder}/probes/{fact.name}.out")
            if output is not None and not index[fact.name]["unknown"]:
                value = fact.parse(Output(index[fact.name]["status"], output.decode(), index[fact.name]["stderr"]))
                assert json.loads(json.dumps(to_plain_data(value))) == values[fact.name], fact.name
                read += 1
        assert read >= 8


def test_bundle_without_sudo_has_what_user_can_read(fresh_host: Host, tmp_path: Path) -> None:
    run_as_root = fresh_host.robot.run_as_root
    assert run_as_root("sh", "-ec", "gpasswd --delete mirte sudo; rm -f /etc/sudoers.d/*mirte*").status == 0
    summary, found = bundle(fresh_host, tmp_path)
    left_out = {each["path"].removeprefix("robots/mirte@10.42.0.1/"): each for each in summary["left_out"]}
    assert left_out["journal/ssh.log"]["kind"] == "unreadable"
    assert "mirte has no permission to read it; root refused: " in left_out["journal/ssh.log"]["reason"]
    assert summary["status"] == 1
    # The user mirte may read the output of mirte's own processes.
    assert b"Server is running" in found["robots/mirte@10.42.0.1/journal/mirte-ros.log"]
    rows = {each["path"]: each for each in json.loads(found["manifest.json"])["files"]}
    assert "read as mirte (root refused: " in rows["robots/mirte@10.42.0.1/journal/mirte-ros.log"]["incomplete"]
    assert "findings/mirte@10.42.0.1.md" in found
