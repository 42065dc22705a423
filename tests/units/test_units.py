"""What systemd itself says of the rendered units, and what the robot's other services need of them."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from lupin_cli import onboard, units

# systemd-analyze security, 0 safe to 10: what each may stay at, and no more. The reasons for the rest are in the templates.
EXPOSURE_LIMIT = {"lupin-onboard.service": 2.0, "lupin-auto-home.service": 2.0, "lupin-clock-sync.service": 2.7}


def directives(text: str) -> dict[str, list[str]]:
    """Every assignment of a unit file, by name."""
    found: dict[str, list[str]] = {}
    for line in text.splitlines():
        name, separator, value = line.partition("=")
        if separator and not line.startswith("#"):
            found.setdefault(name, []).append(value)
    return found


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """All units in a folder, with a clock script that is really there and the vendor's service beside them."""
    folder = tmp_path_factory.mktemp("units")
    script = folder / "clock-sync"
    script.write_text(units.clock_sync_script())
    script.chmod(0o755)
    (folder / "mirte-ros.service").write_text("[Service]\nExecStart=/bin/sleep infinity\n")
    made = {
        **units.robot_units("mirte", "/opt/lupin/current", onboard.set_up()),
        "lupin-clock-sync.service": units.clock_sync_unit("10.42.0.2", str(script)),
    }
    for name, text in made.items():
        (folder / name).write_text(text)
    return {name: folder / name for name in made}


def analyze(*arguments: object) -> subprocess.CompletedProcess[str]:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is missing: apt-get install systemd")
    return subprocess.run(["systemd-analyze", *map(str, arguments)], capture_output=True, text=True, timeout=60)


def test_systemd_has_nothing_to_say_against_any_of_them(rendered) -> None:
    said = analyze("verify", *rendered.values())
    assert (said.returncode, said.stdout, said.stderr) == (0, "", "")


def test_systemd_would_have_something_to_say_against_a_misspelt_directive(rendered, tmp_path: Path) -> None:
    wrong = tmp_path / "lupin-onboard.service"
    wrong.write_text(rendered["lupin-onboard.service"].read_text().replace("MemoryMax=", "MemoryLimitMax="))
    assert "MemoryLimitMax" in analyze("verify", wrong).stderr


@pytest.mark.parametrize("unit", EXPOSURE_LIMIT)
def test_none_is_more_exposed_than_its_reasons_allow(rendered, unit: str) -> None:
    said = analyze("security", "--offline=true", "--no-pager", rendered[unit]).stdout
    (exposure,) = re.findall(r"Overall exposure level for \S+: ([0-9.]+)", said)
    assert float(exposure) <= EXPOSURE_LIMIT[unit], said


def test_the_units_stop_with_the_vendors_and_start_after_it(rendered) -> None:
    onboard = directives(rendered["lupin-onboard.service"].read_text())
    assert onboard["After"] == onboard["Wants"] == ["mirte-ros.service network-online.target"]
    assert onboard["PartOf"] == ["mirte-ros.service"]
    home = directives(rendered["lupin-auto-home.service"].read_text())
    assert home["After"] == home["Wants"] == ["lupin-onboard.service"] and home["PartOf"] == ["mirte-ros.service"]


def test_restarts_and_memory_are_bounded_as_promised(rendered) -> None:
    onboard = directives(rendered["lupin-onboard.service"].read_text())
    assert onboard["Restart"] == ["on-failure"] and onboard["RestartSec"] == ["4"] and onboard["MemoryMax"] == ["256M"]
    home = directives(rendered["lupin-auto-home.service"].read_text())
    assert home["Type"] == ["oneshot"] and home["RemainAfterExit"] == ["yes"]
    assert home["Restart"] == ["on-failure"] and home["RestartSec"] == ["15"] and home["StartLimitBurst"] == ["4"]


def test_four_tries_of_auto_home_lie_within_its_start_limit_even_where_nothing_answers(rendered) -> None:
    home = directives(rendered["lupin-auto-home.service"].read_text())
    attempt_s = int(home["TimeoutStartSec"][0]) + int(home["RestartSec"][0])
    assert int(home["StartLimitIntervalSec"][0]) >= int(home["StartLimitBurst"][0]) * attempt_s


def test_auto_home_waits_for_less_than_its_unit_allows() -> None:
    from lupin_runtime.arm.auto_home import Limits

    template = directives((units.TEMPLATES / "lupin-auto-home.service.in").read_text())
    assert Limits().longest_s < int(template["TimeoutStartSec"][0])


def test_the_clock_is_set_before_the_vendors_stack_and_never_by_the_others(rendered) -> None:
    clock = directives(rendered["lupin-clock-sync.service"].read_text())
    assert clock["Before"] == ["mirte-ros.service"] and "chrony.service" in clock["After"][0]
    assert "PartOf" not in clock and clock["Type"] == ["oneshot"] and clock["TimeoutStartSec"] == ["40"]
    assert all(directives(path.read_text())["ProtectClock"] == ["yes"] for path in rendered.values())


def test_the_vendors_environment_script_can_write_its_profile(rendered) -> None:
    for unit in ("lupin-onboard.service", "lupin-auto-home.service"):
        found = directives(rendered[unit].read_text())
        assert found["ProtectSystem"] != ["strict"] and "ProtectHome" not in found


def test_the_drive_bus_may_ask_to_be_served_first(rendered) -> None:
    from lupin_runtime.ros.priority import NICE, REALTIME_PRIORITY

    onboard = directives(rendered["lupin-onboard.service"].read_text())
    assert onboard["LimitRTPRIO"] == [str(REALTIME_PRIORITY)] and onboard["LimitNICE"] == [str(NICE)]
    assert "RestrictRealtime" not in onboard


def test_a_stop_reaches_the_supervisor_alone_and_leaves_it_time(rendered) -> None:
    from lupin_runtime.stack.supervisor import STOP_GRACE_S

    onboard = directives(rendered["lupin-onboard.service"].read_text())
    assert onboard["KillMode"] == ["mixed"] and onboard["Type"] == ["notify"]
    assert int(onboard["TimeoutStopSec"][0]) > 3 * STOP_GRACE_S


def test_the_clock_script_is_plain_posix_shell() -> None:
    said = subprocess.run(["dash", "-n", units.TEMPLATES / "lupin-clock-sync.sh"], capture_output=True, text=True, timeout=10)
    assert (said.returncode, said.stderr) == (0, "")
