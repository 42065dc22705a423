"""The rendered units: systemd accepts them, and they fit the robot's other services."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from lupin_cli.package_data import shipped_folder
from lupin_cli.release import paths
from lupin_cli.systemd import units

# Limits of `systemd-analyze security`, from 0 (safe) to 10. The templates give the reasons for the remaining exposure.
EXPOSURE_LIMIT = {"lupin-onboard.service": 2.2, "lupin-auto-home.service": 2.0, "lupin-clock-sync.service": 2.7}


def directives(text: str) -> dict[str, list[str]]:
    """Return every assignment of a unit file, by name."""
    found: dict[str, list[str]] = {}
    for line in text.splitlines():
        name, separator, value = line.partition("=")
        if separator and not line.startswith("#"):
            found.setdefault(name, []).append(value)
    return found


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Write all units into one folder, with the clock script and a stand-in for the vendor's service."""
    folder = tmp_path_factory.mktemp("units")
    script = folder / "clock-sync"
    script.write_text(units.clock_sync_script())
    script.chmod(0o755)
    (folder / "mirte-ros.service").write_text("[Service]\nExecStart=/bin/sleep infinity\n")
    texts = {
        **units.robot_units("mirte", "/opt/lupin/current", paths.setup_lines()),
        "lupin-clock-sync.service": units.clock_sync_unit("10.42.0.2", str(script)),
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    return {name: folder / name for name in texts}


def analyze(*arguments: object) -> subprocess.CompletedProcess[str]:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is missing: apt-get install systemd")
    return subprocess.run(["systemd-analyze", *map(str, arguments)], capture_output=True, text=True, timeout=60)


def test_systemd_accepts_all_units(rendered: dict[str, Path]) -> None:
    result = analyze("verify", *rendered.values())
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


def test_systemd_reports_a_misspelled_directive(rendered: dict[str, Path], tmp_path: Path) -> None:
    wrong = tmp_path / "lupin-onboard.service"
    wrong.write_text(rendered["lupin-onboard.service"].read_text().replace("MemoryMax=", "MemoryLimitMax="))
    assert "MemoryLimitMax" in analyze("verify", wrong).stderr


@pytest.mark.parametrize("unit", EXPOSURE_LIMIT)
def test_exposure_of_a_unit_is_within_its_limit(rendered: dict[str, Path], unit: str) -> None:
    output = analyze("security", "--offline=true", "--no-pager", rendered[unit]).stdout
    (exposure,) = re.findall(r"Overall exposure level for \S+: ([0-9.]+)", output)
    assert float(exposure) <= EXPOSURE_LIMIT[unit], output


def test_units_stop_with_the_vendors_unit_and_start_after_it(rendered: dict[str, Path]) -> None:
    onboard = directives(rendered["lupin-onboard.service"].read_text())
    assert onboard["After"] == onboard["Wants"] == ["mirte-ros.service network-online.target"]
    assert onboard["PartOf"] == ["mirte-ros.service"]
    home = directives(rendered["lupin-auto-home.service"].read_text())
    assert home["After"] == home["Wants"] == ["lupin-onboard.service"] and home["PartOf"] == ["mirte-ros.service"]


def test_units_verify_the_release_before_they_start_it(rendered: dict[str, Path]) -> None:
    verifier = "/usr/local/lib/lupin/verify-release"
    for unit in (unit.name for unit in units.LUPIN_UNITS.values() if unit.in_release):
        found = directives(rendered[unit].read_text())
        options = "" if unit == units.ONBOARD else "--quick "  # one start reads every file, which takes seconds on an SD card
        assert found["ExecStartPre"] == [f"/usr/bin/python3 -I {verifier} {options}/opt/lupin/current"], unit
    installed = (shipped_folder("playbooks") / "deploy-robot.yaml").read_text()
    assert installed.index(f"path: {verifier}\n") < installed.index("name: Install the release\n")


def test_restarts_and_memory_are_bounded(rendered: dict[str, Path]) -> None:
    onboard = directives(rendered["lupin-onboard.service"].read_text())
    assert onboard["Restart"] == ["on-failure"] and onboard["RestartSec"] == ["4"] and onboard["MemoryMax"] == ["320M"]
    home = directives(rendered["lupin-auto-home.service"].read_text())
    assert home["Type"] == ["oneshot"] and home["RemainAfterExit"] == ["yes"]
    assert home["Restart"] == ["on-failure"] and home["RestartSec"] == ["15"] and home["StartLimitBurst"] == ["4"]


def test_start_limit_of_auto_home_allows_four_full_attempts(rendered: dict[str, Path]) -> None:
    home = directives(rendered["lupin-auto-home.service"].read_text())
    attempt_s = int(home["TimeoutStartSec"][0]) + int(home["RestartSec"][0])
    assert int(home["StartLimitIntervalSec"][0]) >= int(home["StartLimitBurst"][0]) * attempt_s


def test_auto_home_waits_less_than_its_start_timeout() -> None:
    from lupin_runtime.arm.auto_home import Limits

    template = directives((units.TEMPLATES / "lupin-auto-home.service.in").read_text())
    assert Limits().total_s < int(template["TimeoutStartSec"][0])


def test_clock_unit_runs_once_before_the_stack(rendered: dict[str, Path]) -> None:
    clock = directives(rendered["lupin-clock-sync.service"].read_text())
    assert clock["Before"] == ["mirte-ros.service"] and "chrony.service" in clock["After"][0]
    assert "PartOf" not in clock and clock["Type"] == ["oneshot"] and clock["TimeoutStartSec"] == ["40"]


def test_no_unit_may_set_the_clock_itself(rendered: dict[str, Path]) -> None:
    assert all(directives(path.read_text())["ProtectClock"] == ["yes"] for path in rendered.values())


def test_vendors_setup_script_can_write_its_profile(rendered: dict[str, Path]) -> None:
    for unit in ("lupin-onboard.service", "lupin-auto-home.service"):
        found = directives(rendered[unit].read_text())
        assert found["ProtectSystem"] != ["strict"] and "ProtectHome" not in found


def test_drive_bus_may_use_realtime_priority(rendered: dict[str, Path]) -> None:
    from lupin_runtime.ros.priority import NICE, REALTIME_PRIORITY

    onboard = directives(rendered["lupin-onboard.service"].read_text())
    assert onboard["LimitRTPRIO"] == [str(REALTIME_PRIORITY)] and onboard["LimitNICE"] == [str(NICE)]
    assert "RestrictRealtime" not in onboard


def test_onboard_may_open_input_devices_and_no_others(rendered: dict[str, Path]) -> None:
    onboard = directives(rendered["lupin-onboard.service"].read_text())
    assert onboard["DeviceAllow"] == ["char-input rw"] and onboard["DevicePolicy"] == ["closed"]
    assert "PrivateDevices" not in onboard  # it would hide /dev/input


def test_stop_signals_only_the_supervisor_and_leaves_it_time(rendered: dict[str, Path]) -> None:
    from lupin_runtime.stack.supervisor import STOP_GRACE_S

    onboard = directives(rendered["lupin-onboard.service"].read_text())
    assert onboard["KillMode"] == ["mixed"] and onboard["Type"] == ["notify"]
    assert int(onboard["TimeoutStopSec"][0]) > 3 * STOP_GRACE_S


def test_clock_script_is_posix_shell() -> None:
    result = subprocess.run(["dash", "-n", units.TEMPLATES / "lupin-clock-sync.sh"], capture_output=True, text=True, timeout=60)
    assert (result.returncode, result.stderr) == (0, "")
