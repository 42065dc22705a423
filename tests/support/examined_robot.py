"""A booted robot that checks examine over SSH, like the doctor."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lupin_cli.checks import Check
from lupin_cli.connection.destination import Destination
from lupin_cli.connection.host_keys import KnownHosts
from lupin_cli.connection.local import LocalTarget
from lupin_cli.connection.ssh import SshTarget
from lupin_cli.doctor.engine import diagnose
from lupin_cli.doctor.gathering import gather_snapshot
from lupin_cli.facts.link import Link

if TYPE_CHECKING:
    from lupin_cli.checks.base import Finding
    from lupin_sim.host import Host


class ExaminedRobot:
    """A booted robot, and the connection over which `checks` examine it from the laptop."""

    def __init__(self, host: Host, folder: Path, checks: tuple[Check, ...]) -> None:
        self.host, self.checks = host, checks
        destination = Destination("10.42.0.1", 22, "mirte", (str(host.key),), identities_only=True)
        self.target = SshTarget("robot", destination, KnownHosts(folder / "own", host.known_hosts))

    def run_as_root(self, script: str) -> str:
        """Run a shell script on the robot as root."""
        done = self.host.robot.run_as_root("sh", "-c", script, timeout_s=60.0)
        assert done.status == 0, done.stderr
        return str(done.stdout)

    def findings(self) -> list[Finding]:
        """Run the checks, and return the root causes. Fails the test if a check could not examine everything."""
        with self.host.on_laptop():
            snapshot = gather_snapshot(self.checks, LocalTarget(), lambda: (self.target, Link("robot", "10.42.0.1")))
        report = diagnose(self.checks, snapshot)
        assert snapshot.link is not None and snapshot.link.reachable
        assert report.check_errors == () and report.unknown == ()
        return [root.finding for root in report.roots]

    def root_causes(self) -> list[str]:
        return sorted(finding.id for finding in self.findings())

    def state(self, unit: str) -> str:
        done = self.host.robot.run_as_root("systemctl", "show", "-P", "ActiveState", unit)
        return str(done.stdout).strip()
