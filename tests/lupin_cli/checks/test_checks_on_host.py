"""Faults of a robot's health, injected into a booted robot: each is named as a root cause, and nothing else.

Only the health checks run; the network checks have tests beside the doctor's. Each test repairs what it broke.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli import __version__
from lupin_cli.checks import cameras, clocks, resources, services, software
from lupin_sim.host.fixtures import boot_or_skip
from tests.support.examined_robot import ExaminedRobot
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    pass

pytestmark = pytest.mark.host

LIMIT_S = 60.0

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
# What a deploy leaves on a robot, as far as these checks read it; the deploy has its own tests.
DEPLOY = f"""set -e
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


INSTALL_CLOCK_SYNC = """set -e
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
REMOVE_CLOCK_SYNC = """systemctl disable -q --now lupin-clock-sync
rm /etc/systemd/system/lupin-clock-sync.service /etc/chrony/conf.d/laptop.conf
systemctl daemon-reload
systemctl restart chrony
"""
DROP_IN = "/run/systemd/system/lupin-onboard.service.d"


class DeployedRobot(ExaminedRobot):
    """A booted robot with a deployed release."""

    def fail_onboard(self, *rules: str) -> None:
        """Restart the onboard unit as a service that fails at once, with the additional settings `rules`."""
        text = "\\n".join(["[Service]", "ExecStart=", "ExecStart=/bin/false", *rules, ""])
        self.run_as_root(
            f"mkdir -p {DROP_IN}; printf '{text}' > {DROP_IN}/x.conf; "
            "systemctl daemon-reload; systemctl restart --no-block lupin-onboard"
        )

    def restore_onboard(self) -> None:
        """Undo `fail_onboard`."""
        self.run_as_root(
            f"rm -r {DROP_IN}; systemctl daemon-reload; systemctl stop lupin-onboard; "
            "systemctl reset-failed lupin-onboard || true; systemctl start lupin-onboard; systemctl restart lupin-auto-home"
        )


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DeployedRobot]:
    with boot_or_skip() as host:
        deployed = DeployedRobot(host, tmp_path_factory.mktemp("health"), CHECKS)
        deployed.run_as_root(DEPLOY)
        yield deployed
        deployed.target.close()


def test_deployed_robot_has_no_findings(robot: DeployedRobot) -> None:
    assert robot.root_causes() == []


def test_failed_oneshot_shows_its_journal_lines(robot: DeployedRobot) -> None:
    robot.run_as_root("touch /tmp/stuck; systemctl restart --no-block lupin-auto-home")
    wait_until(lambda: robot.state("lupin-auto-home") == "failed", "the failure of the oneshot", LIMIT_S)
    (finding,) = robot.findings()
    assert finding.id == "oneshot-failed" and finding.fix.playbook == "heal"
    assert any("lupin-auto-home" in line and "Failed with result" in line for line in finding.evidence)
    robot.run_as_root("rm /tmp/stuck; systemctl reset-failed lupin-auto-home; systemctl start lupin-auto-home")


def test_failed_unit_differs_from_restarting_unit(robot: DeployedRobot) -> None:
    robot.fail_onboard("Restart=no")
    wait_until(lambda: robot.state("lupin-onboard") == "failed", "the failure", LIMIT_S)
    assert robot.root_causes() == ["unit-failed"]
    robot.fail_onboard("Restart=always", "RestartSec=60")
    wait_until(lambda: robot.state("lupin-onboard") == "activating", "the pause before it is started again", LIMIT_S)
    assert robot.root_causes() == ["unit-restarting"]
    robot.restore_onboard()


def test_unit_missing_after_deploy_is_named(robot: DeployedRobot) -> None:
    unit = "/etc/systemd/system/lupin-auto-home.service"
    robot.run_as_root(f"systemctl disable -q --now lupin-auto-home; mv {unit} /root/; systemctl daemon-reload")
    assert robot.root_causes() == ["unit-missing"]
    robot.run_as_root(
        f"mv /root/lupin-auto-home.service {unit}; systemctl daemon-reload; systemctl enable -q --now lupin-auto-home"
    )
    service = "/opt/lupin/current/venv/lib/python3.11/site-packages/lupin_runtime/cameras/service.py"
    robot.run_as_root(f"mkdir -p $(dirname {service}); touch {service}")
    (finding,) = robot.findings()
    assert finding.id == "unit-missing" and "lupin-cameras.service" in finding.cause, "this release has the camera service"
    robot.run_as_root("rm -r /opt/lupin/current/venv")


def test_start_limit_differs_from_stopped_unit(robot: DeployedRobot) -> None:
    robot.run_as_root("systemctl stop lupin-onboard")
    assert robot.root_causes() == ["unit-not-running"]
    robot.fail_onboard()
    wait_until(lambda: robot.state("lupin-onboard") == "failed", "the start limit", LIMIT_S)
    assert robot.root_causes() == ["unit-start-limit"]
    robot.restore_onboard()


def test_unit_not_restarted_with_vendor_is_named(robot: DeployedRobot) -> None:
    unit = "/etc/systemd/system/lupin-onboard.service"
    robot.run_as_root(f"sed -i /PartOf/d {unit}; systemctl daemon-reload; systemctl restart mirte-ros")
    (finding,) = robot.findings()
    assert finding.id == "unit-outlived-vendor" and "no PartOf=mirte-ros.service" in finding.cause
    robot.run_as_root(
        f"cat > {unit} <<'E'\n{ONBOARD}E\nsystemctl daemon-reload; systemctl restart lupin-onboard lupin-auto-home"
    )


def test_stopped_vendor_service_explains_its_consequences(robot: DeployedRobot) -> None:
    robot.run_as_root("systemctl stop mirte-ros")
    found = robot.findings()
    assert [finding.id for finding in found] == ["vendor-service-down"]
    robot.run_as_root("systemctl start mirte-ros; systemctl start lupin-onboard; systemctl restart lupin-auto-home")


def test_disabled_unit_and_unread_unit_file_are_named(robot: DeployedRobot) -> None:
    robot.run_as_root("systemctl disable -q lupin-onboard; sleep 1; touch /etc/systemd/system/lupin-onboard.service")
    assert robot.root_causes() == ["unit-not-enabled", "units-need-reload"]
    robot.run_as_root("systemctl daemon-reload; systemctl enable -q lupin-onboard")


@pytest.mark.parametrize("offset_s", [-16440.0, 12.5])
def test_clock_offset_is_named_with_its_uncertainty(robot: DeployedRobot, offset_s: float) -> None:
    with robot.host.robot.with_fault("clock-wrong", offset_s=offset_s):
        (finding,) = robot.findings()
    assert finding.id == "clock-drift" and not finding.fix.safe
    reported_s, bound_s = (
        float(word) for word in finding.cause.split("clock is ")[1].replace(" s", "").split(" relative")[0].split(" ± ")
    )
    assert abs(reported_s - offset_s) <= bound_s + 0.05


def test_small_clock_offset_is_slewed_or_ignored(robot: DeployedRobot) -> None:
    with robot.host.robot.with_fault("clock-wrong", offset_s=2.6):
        (finding,) = robot.findings()
        assert finding.id == "clock-drift" and finding.fix.playbook == "install-clock-sync"
    with robot.host.robot.with_fault("clock-wrong", offset_s=0.7):
        assert robot.root_causes() == []


def test_stock_makestep_is_named(robot: DeployedRobot) -> None:
    robot.run_as_root("sed -i 's/^#makestep/makestep/' /etc/chrony/chrony.conf")
    (finding,) = robot.findings()
    assert finding.id == "chrony-stock-makestep"
    assert any(line.endswith("makestep 1 3") for line in finding.evidence)
    robot.run_as_root("sed -i 's/^makestep/#makestep/' /etc/chrony/chrony.conf")


def test_stopped_chrony_is_named(robot: DeployedRobot) -> None:
    robot.run_as_root("systemctl stop chrony")
    assert robot.root_causes() == ["chrony-not-running"]
    robot.run_as_root("systemctl start chrony")


def test_laptop_not_serving_time_is_named(robot: DeployedRobot) -> None:
    robot.host.serve_ntp()
    robot.run_as_root(INSTALL_CLOCK_SYNC)
    wait_until(lambda: robot.root_causes() == [], "an answer of the laptop's NTP server", LIMIT_S)
    with robot.host.robot.with_fault("chrony-not-serving"):
        robot.run_as_root("systemctl restart chrony")  # chrony counts a source that answered once as reachable
        (finding,) = robot.findings()
    robot.host.serve_ntp("off")
    assert finding.id == "chrony-not-serving" and finding.where == "laptop"
    robot.run_as_root(REMOVE_CLOCK_SYNC)


def test_silent_time_source_and_missing_chrony_are_named(robot: DeployedRobot) -> None:
    robot.host.serve_ntp()
    robot.run_as_root(INSTALL_CLOCK_SYNC.replace("10.42.0.2", "10.42.0.77"))
    assert robot.root_causes() == ["chrony-sources-silent"]
    with robot.host.robot.with_fault("program-missing", program="chronyd"):
        assert robot.root_causes() == ["chrony-missing"]
    robot.host.serve_ntp("off")
    robot.run_as_root(REMOVE_CLOCK_SYNC)


def test_full_shared_memory_is_named(robot: DeployedRobot) -> None:
    robot.run_as_root("dd if=/dev/zero of=/dev/shm/fill bs=1M 2>/dev/null || true")
    assert robot.root_causes() == ["shared-memory-full"]
    robot.run_as_root("rm /dev/shm/fill")


def test_full_disk_and_read_only_disk_are_named(robot: DeployedRobot) -> None:
    with robot.host.robot.with_fault("disk-full"):
        assert robot.root_causes() == ["disk-full"]
    with robot.host.robot.with_fault("disk-read-only"):
        assert robot.root_causes() == ["filesystem-read-only"]


def test_used_up_inodes_are_named(robot: DeployedRobot) -> None:
    robot.run_as_root(
        "mount -t tmpfs -o nr_inodes=100,size=600m tmpfs /boot; for i in $(seq 100); do touch /boot/$i || break; done"
    )
    assert robot.root_causes() == ["inodes-used-up"]
    robot.run_as_root("umount /boot")


def test_stray_camera_holder_is_named_with_its_pid(robot: DeployedRobot) -> None:
    robot.run_as_root("touch /dev/video0; systemd-run -q --unit=stray --uid=mirte sh -c 'exec sleep 300 < /dev/video0'")
    (finding,) = robot.findings()
    assert finding.id == "camera-held" and "stray.service" in finding.cause
    robot.run_as_root("systemctl stop stray; rm /dev/video0")


def test_broken_and_mismatched_release_are_named(robot: DeployedRobot) -> None:
    robot.run_as_root("mv /opt/lupin/releases/0a1b2c3d4e5f /opt/lupin/releases/away")
    assert robot.root_causes() == ["release-broken"]
    robot.run_as_root("mv /opt/lupin/releases/away /opt/lupin/releases/0a1b2c3d4e5f")
    file = "/opt/lupin/releases/0a1b2c3d4e5f/release.json"
    robot.run_as_root(f"sed -i 's/{__version__}/0.0.1/' {file}")
    assert robot.root_causes() == ["version-skew"]
    robot.run_as_root(f"sed -i 's/0.0.1/{__version__}/; s/3, 11/3, 9/' {file}")
    assert robot.root_causes() == ["python-changed"]
    robot.run_as_root(f"sed -i 's/3, 9/3, 11/' {file}")


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
def test_missing_prerequisites_of_lupin_are_named(robot: DeployedRobot, fault: Any, settings: Any, cause: Any) -> None:
    robot.target.close()  # the groups of a user are those of its login
    with robot.host.robot.with_fault(fault, **settings):
        assert robot.root_causes() == [cause]
    robot.target.close()


def test_simultaneous_health_faults_are_each_named(robot: DeployedRobot) -> None:
    robot.run_as_root("systemctl stop chrony; touch /tmp/stuck; systemctl restart --no-block lupin-auto-home")
    wait_until(lambda: robot.state("lupin-auto-home") == "failed", "the failure of the oneshot", LIMIT_S)
    with robot.host.robot.with_fault("clock-wrong", offset_s=300.0):
        assert robot.root_causes() == ["chrony-not-running", "clock-drift", "oneshot-failed"]
    robot.run_as_root(
        "systemctl start chrony; rm /tmp/stuck; systemctl reset-failed lupin-auto-home; systemctl start lupin-auto-home"
    )


def test_repaired_robot_has_no_findings(robot: DeployedRobot) -> None:
    assert robot.root_causes() == []
