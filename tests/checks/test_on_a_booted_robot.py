"""Faults of a robot's health, made for real on one that boots: each is named as a cause and nothing else is.

Only these checks run here; the network's have tests of their own beside the doctor's.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from lupin_cli import __version__
from lupin_cli.checks import cameras, clocks, resources, services, software
from lupin_cli.checks.base import Finding
from lupin_cli.diagnosis import diagnose, gather
from lupin_cli.facts.link import Link
from lupin_cli.target.destination import Destination
from lupin_cli.target.local import LocalTarget
from lupin_cli.target.ssh import SshTarget
from lupin_cli.target.trust import Trust
from lupin_sim.host import Host
from lupin_sim.host.fixtures import start

pytestmark = pytest.mark.host

CHECKS = (*clocks.CHECKS, *services.CHECKS, *resources.CHECKS, *software.CHECKS, *cameras.CHECKS)
UNIT = """[Unit]
After={after}
PartOf=mirte-ros.service
StartLimitIntervalSec=60
StartLimitBurst=2
[Service]
Type={type}
RemainAfterExit={remain}
User=mirte
ExecStart={command}
Restart=on-failure
RestartSec=100ms
[Install]
WantedBy=multi-user.target
"""
ONBOARD = UNIT.format(after="mirte-ros.service", type="simple", remain="no", command="/bin/sh -c 'exec sleep infinity'")
AUTO_HOME = UNIT.format(
    after="lupin-onboard.service", type="oneshot", remain="yes", command="/bin/sh -c 'test ! -e /tmp/stuck'"
)
# What a deploy leaves on a robot, as far as these checks look at it; the deploy itself has tests of its own.
DEPLOYED = f"""set -e
mkdir -p /opt/lupin/releases/0a1b2c3d4e5f /opt/lupin/incoming
echo '{json.dumps({"version": __version__, "python": [3, 11]})}' > /opt/lupin/releases/0a1b2c3d4e5f/release.json
ln -sfn releases/0a1b2c3d4e5f /opt/lupin/current
cat > /etc/systemd/system/lupin-onboard.service <<'E'
{ONBOARD}E
cat > /etc/systemd/system/lupin-auto-home.service <<'E'
{AUTO_HOME}E
usermod -aG input mirte
sed -i 's/^makestep/#makestep/' /etc/chrony/chrony.conf
systemctl daemon-reload
systemctl restart chrony
systemctl enable -q --now lupin-onboard lupin-auto-home
"""


SYNCS_ITS_CLOCK = """set -e
echo 'server 10.42.0.2 iburst' > /etc/chrony/conf.d/laptop.conf
cat > /etc/systemd/system/lupin-clock-sync.service <<'E'
[Service]
Type=oneshot
RemainAfterExit=yes
ExecStart=/bin/true
[Install]
WantedBy=multi-user.target
E
systemctl daemon-reload
systemctl restart chrony
systemctl enable -q --now lupin-clock-sync
"""
SYNCS_NO_MORE = """systemctl disable -q --now lupin-clock-sync
rm /etc/systemd/system/lupin-clock-sync.service /etc/chrony/conf.d/laptop.conf
systemctl daemon-reload
systemctl restart chrony
"""
BENT = "/run/systemd/system/lupin-onboard.service.d"


class Looked:
    """A robot on which Lupin is deployed, and these checks, which look at it over one connection from the laptop."""

    def __init__(self, host: Host, folder: Path) -> None:
        self.host = host
        place = Destination("10.42.0.1", 22, "mirte", (str(host.key),), identities_only=True)
        self.target = SshTarget("robot", place, Trust(folder / "own", host.known_hosts))

    def root(self, script: str) -> str:
        """Run something on the robot as root."""
        done = self.host.robot.inside("sh", "-c", script, timeout_s=60.0)
        assert done.status == 0, done.stderr
        return str(done.stdout)

    def findings(self) -> list[Finding]:
        """The causes that are named; nothing may be left unexamined."""
        with self.host.on_laptop():
            evidence = gather(CHECKS, LocalTarget(), lambda: (self.target, Link("robot", "10.42.0.1")))
        told = diagnose(CHECKS, evidence)
        assert evidence.link is not None and evidence.link.reachable
        assert told.broken == () and told.unknown == ()
        return [root.finding for root in told.roots]

    def ids(self) -> list[str]:
        return sorted(finding.id for finding in self.findings())

    def until(self, condition: Callable[[], bool], what: str, limit_s: float = 60.0) -> None:
        deadline = time.monotonic() + limit_s
        while not condition():
            assert time.monotonic() < deadline, f"{what} did not come about within {limit_s:g} s"
            time.sleep(0.1)

    def state(self, unit: str) -> str:
        done = self.host.robot.inside("systemctl", "show", "-P", "ActiveState", unit)
        return str(done.stdout).strip()

    def let_onboard_die(self, *rules: str) -> None:
        """Start it anew as a service that ends with an error at once, under `rules` of its own."""
        text = "\\n".join(["[Service]", "ExecStart=", "ExecStart=/bin/false", *rules, ""])
        self.root(
            f"mkdir -p {BENT}; printf '{text}' > {BENT}/x.conf; "
            "systemctl daemon-reload; systemctl restart --no-block lupin-onboard"
        )

    def let_onboard_live(self) -> None:
        """As it was before it died."""
        self.root(
            f"rm -r {BENT}; systemctl daemon-reload; systemctl stop lupin-onboard; "
            "systemctl reset-failed lupin-onboard || true; systemctl start lupin-onboard; systemctl restart lupin-auto-home"
        )


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Looked]:
    with start() as host:
        looked = Looked(host, tmp_path_factory.mktemp("health"))
        looked.root(DEPLOYED)
        yield looked
        looked.target.close()


# Each test mends what it broke, and the next one sees that nothing was left.


def test_a_deployed_robot_gives_nothing(robot: Looked) -> None:
    assert robot.ids() == []


def test_a_failed_oneshot_is_named_with_its_last_words(robot: Looked) -> None:
    robot.root("touch /tmp/stuck; systemctl restart --no-block lupin-auto-home")
    robot.until(lambda: robot.state("lupin-auto-home") == "failed", "the oneshot's failure")
    (finding,) = robot.findings()
    assert finding.id == "oneshot-failed" and finding.fix.playbook == "heal"
    assert any("lupin-auto-home" in line and "Failed with result" in line for line in finding.evidence)
    robot.root("rm /tmp/stuck; systemctl reset-failed lupin-auto-home; systemctl start lupin-auto-home")


def test_a_service_that_fails_is_told_from_one_that_dies_again_and_again(robot: Looked) -> None:
    robot.let_onboard_die("Restart=no")
    robot.until(lambda: robot.state("lupin-onboard") == "failed", "the failure")
    assert robot.ids() == ["unit-failed"]
    robot.let_onboard_die("Restart=always", "RestartSec=60")
    robot.until(lambda: robot.state("lupin-onboard") == "activating", "the pause before it is started again")
    assert robot.ids() == ["unit-restarting"]
    robot.let_onboard_live()


def test_a_unit_that_a_deploy_left_out_is_named(robot: Looked) -> None:
    unit = "/etc/systemd/system/lupin-auto-home.service"
    robot.root(f"systemctl disable -q --now lupin-auto-home; mv {unit} /root/; systemctl daemon-reload")
    assert robot.ids() == ["unit-missing"]
    robot.root(f"mv /root/lupin-auto-home.service {unit}; systemctl daemon-reload; systemctl enable -q --now lupin-auto-home")


def test_a_service_that_hit_its_start_limit_is_told_from_one_that_was_stopped(robot: Looked) -> None:
    robot.root("systemctl stop lupin-onboard")
    assert robot.ids() == ["unit-not-running"]
    robot.let_onboard_die()
    robot.until(lambda: robot.state("lupin-onboard") == "failed", "the start limit")
    assert robot.ids() == ["unit-start-limit"]
    robot.let_onboard_live()


def test_a_unit_that_did_not_restart_with_the_vendors_is_named(robot: Looked) -> None:
    unit = "/etc/systemd/system/lupin-onboard.service"
    robot.root(f"sed -i /PartOf/d {unit}; systemctl daemon-reload; systemctl restart mirte-ros")
    (finding,) = robot.findings()
    assert finding.id == "unit-outlived-vendor" and "no PartOf=mirte-ros.service" in finding.cause
    robot.root(f"cat > {unit} <<'E'\n{ONBOARD}E\nsystemctl daemon-reload; systemctl restart lupin-onboard lupin-auto-home")


def test_a_stopped_vendor_takes_its_consequences_along(robot: Looked) -> None:
    robot.root("systemctl stop mirte-ros")
    found = robot.findings()
    assert [finding.id for finding in found] == ["vendor-service-down"]
    robot.root("systemctl start mirte-ros; systemctl start lupin-onboard; systemctl restart lupin-auto-home")


def test_a_disabled_unit_and_an_unread_change_are_named(robot: Looked) -> None:
    robot.root("systemctl disable -q lupin-onboard; sleep 1; touch /etc/systemd/system/lupin-onboard.service")
    assert robot.ids() == ["unit-not-enabled", "units-need-reload"]
    robot.root("systemctl daemon-reload; systemctl enable -q lupin-onboard")


@pytest.mark.parametrize("offset_s", [-16440.0, 12.5])
def test_a_clock_that_is_off_is_named_with_its_uncertainty(robot: Looked, offset_s: float) -> None:
    with robot.host.robot.broken("clock-wrong", offset_s=offset_s):
        (finding,) = robot.findings()
    assert finding.id == "clock-drift" and not finding.fix.safe
    told, bound = (
        float(word) for word in finding.cause.split("clock is ")[1].replace(" s", "").split(" against")[0].split(" ± ")
    )
    assert abs(told - offset_s) <= bound + 0.05


def test_a_drift_of_two_seconds_is_left_alone(robot: Looked) -> None:
    with robot.host.robot.broken("clock-wrong", offset_s=1.5):
        assert robot.ids() == []


def test_the_stock_makestep_is_named(robot: Looked) -> None:
    robot.root("sed -i 's/^#makestep/makestep/' /etc/chrony/chrony.conf")
    (finding,) = robot.findings()
    assert finding.id == "chrony-stock-makestep"
    assert any(line.endswith("makestep 1 3") for line in finding.evidence)
    robot.root("sed -i 's/^makestep/#makestep/' /etc/chrony/chrony.conf")


def test_a_stopped_chrony_is_named(robot: Looked) -> None:
    robot.root("systemctl stop chrony")
    assert robot.ids() == ["chrony-not-running"]
    robot.root("systemctl start chrony")


def test_a_laptop_that_serves_no_time_is_named_once_the_robot_counts_on_it(robot: Looked) -> None:
    robot.host.serve_ntp()
    robot.root(SYNCS_ITS_CLOCK)
    robot.until(lambda: robot.ids() == [], "an answer of the laptop's clock server")
    with robot.host.robot.broken("chrony-not-serving"):
        robot.root("systemctl restart chrony")  # a source that answered once counts as one that answers
        (finding,) = robot.findings()
    robot.host.serve_ntp("off")
    assert finding.id == "chrony-not-serving" and finding.where == "laptop"
    robot.root(SYNCS_NO_MORE)


def test_a_chrony_that_nobody_answers_and_one_that_is_gone_are_named(robot: Looked) -> None:
    robot.host.serve_ntp()
    robot.root(SYNCS_ITS_CLOCK.replace("10.42.0.2", "10.42.0.77"))
    assert robot.ids() == ["chrony-sources-silent"]
    with robot.host.robot.broken("program-missing", program="chronyd"):
        assert robot.ids() == ["chrony-missing"]
    robot.host.serve_ntp("off")
    robot.root(SYNCS_NO_MORE)


def test_full_shared_memory_is_named(robot: Looked) -> None:
    robot.root("dd if=/dev/zero of=/dev/shm/fill bs=1M 2>/dev/null || true")
    assert robot.ids() == ["shared-memory-full"]
    robot.root("rm /dev/shm/fill")


def test_a_full_disk_and_one_that_went_read_only_are_named(robot: Looked) -> None:
    with robot.host.robot.broken("disk-full"):
        assert robot.ids() == ["disk-full"]
    with robot.host.robot.broken("disk-read-only"):
        assert robot.ids() == ["filesystem-read-only"]


def test_a_file_system_without_inodes_is_told_from_a_full_one(robot: Looked) -> None:
    robot.root("mount -t tmpfs -o nr_inodes=100,size=600m tmpfs /boot; for i in $(seq 100); do touch /boot/$i || break; done")
    assert robot.ids() == ["inodes-used-up"]
    robot.root("umount /boot")


def test_a_camera_that_a_stray_holds_is_named_with_its_pid(robot: Looked) -> None:
    robot.root("touch /dev/video0; systemd-run -q --unit=stray --uid=mirte sh -c 'exec sleep 300 < /dev/video0'")
    (finding,) = robot.findings()
    assert finding.id == "camera-held" and "stray.service" in finding.cause
    robot.root("systemctl stop stray; rm /dev/video0")


def test_a_release_that_leads_nowhere_or_does_not_fit_is_named(robot: Looked) -> None:
    robot.root("mv /opt/lupin/releases/0a1b2c3d4e5f /opt/lupin/releases/away")
    assert robot.ids() == ["release-broken"]
    robot.root("mv /opt/lupin/releases/away /opt/lupin/releases/0a1b2c3d4e5f")
    file = "/opt/lupin/releases/0a1b2c3d4e5f/release.json"
    robot.root(f"sed -i 's/{__version__}/0.0.1/' {file}")
    assert robot.ids() == ["version-skew"]
    robot.root(f"sed -i 's/0.0.1/{__version__}/; s/3, 11/3, 9/' {file}")
    assert robot.ids() == ["python-changed"]
    robot.root(f"sed -i 's/3, 9/3, 11/' {file}")


@pytest.mark.parametrize(
    ("fault", "settings", "cause"),
    [
        ("home-locked", {}, "home-not-writable"),
        ("not-in-group", {}, "groups-missing"),
        ("program-missing", {"program": "python3"}, "python-missing"),
        ("stock-makestep", {}, "chrony-stock-makestep"),
        ("unit", {"state": "masked"}, "unit-not-enabled"),
    ],
)
def test_what_keeps_lupin_from_running_is_named(robot: Looked, fault, settings, cause) -> None:
    robot.target.close()  # groups are those of the login
    with robot.host.robot.broken(fault, **settings):
        assert robot.ids() == [cause]
    robot.target.close()


def test_faults_in_pairs_are_both_named(robot: Looked) -> None:
    robot.root("systemctl stop chrony; touch /tmp/stuck; systemctl restart --no-block lupin-auto-home")
    robot.until(lambda: robot.state("lupin-auto-home") == "failed", "the oneshot's failure")
    with robot.host.robot.broken("clock-wrong", offset_s=300.0):
        assert robot.ids() == ["chrony-not-running", "clock-drift", "oneshot-failed"]
    robot.root("systemctl start chrony; rm /tmp/stuck; systemctl reset-failed lupin-auto-home; systemctl start lupin-auto-home")


def test_a_mended_robot_is_healthy(robot: Looked) -> None:
    assert robot.ids() == []
