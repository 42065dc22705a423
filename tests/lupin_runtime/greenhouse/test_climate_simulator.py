"""The greenhouse simulator: time, noise, files."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.greenhouse import climate_simulator as o
from lupin_runtime.greenhouse.climate_simulator import ClimateSimulator, GreenhouseConfigError, Overrides

DEBUG = Overrides(debug_time_of_day=12.0, debug_seed=7)


def layout(tmp_path: Path, **tags: Any) -> Path:
    path = tmp_path / "layout.json"
    document = {"units": "m", "tables": {}, "tags": tags or {"41": {"x": 0.2, "y": 0.3, "sensors": ["co2", "light"]}}}
    path.write_text(json.dumps(document, indent=1))
    return path


def config(tmp_path: Path, **time: Any) -> Path:
    path = tmp_path / "sim.yaml"
    sensor = {"value_at_midnight": 10, "value_at_noon": 20, "noise_sigma": 0, "dynamics": "uniform"}
    noisy = {**sensor, "noise_sigma": 3}
    path.write_text(yaml.safe_dump({"time": time, "sensors": {"co2": [sensor], "light": [noisy]}}))
    return path


def test_packaged_greenhouse_has_its_tags_and_sensors() -> None:
    greenhouse = ClimateSimulator(overrides=DEBUG)
    assert len(greenhouse.tags) == 29 and "8" not in greenhouse.tags
    assert set(greenhouse.sensors) == {"temperature", "humidity", "co2", "light", "soil_moisture"}
    reading = greenhouse.read("12")
    assert set(reading.values) == {"temperature", "humidity", "co2"}  # and no "timestamp"
    assert reading.time_of_day_s == 43200.0


def test_readings_equal_those_of_the_package(tmp_path: Path) -> None:
    """With the hour and seed of the package's debug mode, the first reading equals the package's."""
    from greenhouse_sim.simulator import GreenhouseSimulator
    from greenhouse_sim.tools.config_loader import CONFIG_DIR

    settings = yaml.safe_load((CONFIG_DIR / "greenhouse_config.yaml").read_text())
    settings["time"].update(debug_mode=True, debug_time_of_day=9.0, debug_seed=7)
    path = tmp_path / "sim.yaml"
    path.write_text(yaml.safe_dump(settings))
    theirs = GreenhouseSimulator(None, path).get_sensor_data("12")
    ours = ClimateSimulator(overrides=Overrides(debug_time_of_day=9.0, debug_seed=7)).read("12")
    assert dict(ours.values) == {k: v for k, v in theirs.items() if k != "timestamp"}


def test_noise_is_reproducible_by_its_seed() -> None:
    def series(seed: int) -> list[float]:
        greenhouse = ClimateSimulator(overrides=Overrides(debug_time_of_day=12.0, debug_seed=seed))
        return [greenhouse.read("21").values["co2"] for _ in range(5)]

    assert series(1) == series(1) != series(2)
    assert len(set(series(1))) == 5


def test_noise_leaves_the_global_random_state_alone() -> None:
    first, second = (ClimateSimulator(overrides=DEBUG) for _ in range(2))
    random.seed(123)
    expected = random.random()
    random.seed(123)
    alone = [first.read("21").values for _ in range(3)]
    assert random.random() == expected
    mixed = []
    for _ in range(3):
        random.random()
        mixed.append(second.read("21").values)
    assert alone == mixed


def test_time_runs_at_the_given_speed_and_wraps_at_midnight() -> None:
    now = {"s": 0.0}
    greenhouse = ClimateSimulator(overrides=Overrides(speedup_factor=3600.0), clock_s=lambda: now["s"])
    hours = []
    for now["s"] in (0.0, 1.0, 23.0, 24.0, 25.5):
        hours.append(greenhouse.read("6").time_of_day_s / 3600.0)
    assert hours == pytest.approx([0.0, 1.0, 23.0, 0.0, 1.5])


def test_default_day_lasts_48_seconds() -> None:
    now = {"s": 0.0}
    greenhouse = ClimateSimulator(clock_s=lambda: now["s"])
    now["s"] = 24.0
    assert greenhouse.time_of_day_s() == pytest.approx(43200.0)
    now["s"] = 48.0
    assert greenhouse.time_of_day_s() == pytest.approx(0.0)


def test_readings_change_with_the_hour() -> None:
    noon, midnight = (ClimateSimulator(overrides=Overrides(debug_time_of_day=h)).read("6") for h in (12.0, 0.0))
    assert noon.values["temperature"] > midnight.values["temperature"] + 1.0


@pytest.mark.parametrize("hour", [24.0, 25.0, 600.0])
def test_hour_beyond_the_day_is_wrapped(hour: float) -> None:
    assert ClimateSimulator(overrides=Overrides(debug_time_of_day=hour)).read("6").time_of_day_s == (hour % 24) * 3600


@given(st.floats(-1e12, 1e12))
def test_time_of_day_is_always_within_the_day(time_s: float) -> None:
    assert 0.0 <= o._wrapped(time_s) < 86400.0


def test_unknown_tag_error_lists_the_known_tags(tmp_path: Path) -> None:
    greenhouse = ClimateSimulator(layout(tmp_path), config(tmp_path))
    with pytest.raises(o.UnknownTag, match="no tag '8' in the greenhouse; it has 41"):
        greenhouse.read("8")


def test_debug_mode_prints_nothing_to_stdout(capsys: pytest.CaptureFixture[str]) -> None:
    ClimateSimulator(overrides=DEBUG)
    assert capsys.readouterr().out == ""


def test_import_loads_no_gui_or_plotting_library() -> None:
    code = (
        "import sys; from lupin_runtime.greenhouse.climate_simulator import *; ClimateSimulator(overrides=Overrides(12.0)); "
        "print([m for m in ('tkinter', 'matplotlib', 'numpy', 'greenhouse_sim.cli') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{", r"layout\.json:1: not JSON"),
        ('{"tags": {\n  "1": {"x": 1,\n "y": }}}', r"layout\.json:3: not JSON"),
        ("[]", r"layout\.json:1: the file must be an object, found \[\]"),
        ("{}", r"layout\.json:1: tags must be an object, found nothing"),
        ('{"tags": []}', r"layout\.json:1: tags must be an object, found \[\]"),
        ('{"tags": {\n"1": 3}}', r"layout\.json:2: tags\.1 must be an object, found 3"),
        ('{"tags": {\n\n"1": {"x": "a", "y": 1, "sensors": []}}}', r"layout\.json:3: tags\.1\.x must be a number, found 'a'"),
        ('{"tags": {"1": {"x": NaN, "y": 1, "sensors": []}}}', r"layout\.json:1: tags\.1\.x must be a number, found nan"),
        ('{"tags": {"1": {"x": 1, "y": 1}}}', r"layout\.json:1: tags\.1\.sensors must be a list of names, found nothing"),
        ('{"tags": {\n"1": {"x": 1, "y": 1, "sensors": ["ph"]}}}', r"layout\.json:2: tag 1 has the sensor 'ph'"),
    ],
)
def test_bad_layout_error_names_file_and_line(tmp_path: Path, text: str, problem: str) -> None:
    path = tmp_path / "layout.json"
    path.write_text(text)
    with pytest.raises(GreenhouseConfigError, match=problem):
        ClimateSimulator(path)
    assert path.read_text() == text


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("time: [", r"sim\.yaml:1: the simulator configuration is not YAML"),
        ("time: {}\nsensors:\n  co2: {", r"sim\.yaml:3: the simulator configuration is not YAML"),
        ("", r"sim\.yaml:1: the file must be a mapping"),
        ("- 3", r"sim\.yaml:1: the file must be a mapping"),
        ("time: {}", r"sim\.yaml:1: the simulator configuration has no section 'sensors'"),
        ("sensors:\n  co2: 4", r"sim\.yaml:2: sensor co2 must be a list"),
        ("sensors:\n  co2: []", r"sim\.yaml:2: sensor co2 must be a list"),
        ("sensors:\n  co2:\n  - 4", r"sim\.yaml:3: sensor co2 must be a mapping"),
        ("sensors:\n  ph: [{}]", r"sim\.yaml:2: no sensor 'ph'; there are temperature, "),
        ("time:\n  speedup_factor: fast\nsensors: {}", r"sim\.yaml:2: time.speedup_factor is 'fast', expected a positive"),
        ("time:\n  speedup_factor: 0\nsensors: {}", r"sim\.yaml:2: time.speedup_factor is 0, expected a positive"),
        ("sensors:\n  co2:\n  - noise_sigma: loud", r"sim\.yaml:3: sensor co2: noise_sigma is 'loud', expected a number"),
        ("sensors:\n  co2:\n  - decay_distance: 0", r"sim\.yaml:3: sensor co2: decay_distance is 0, expected a positive"),
        ("sensors:\n  co2:\n  - position: [1]", r"sim\.yaml:3: sensor co2: position is \[1\], expected a point"),
        ("sensors:\n  co2:\n  - {dynamics: odd}", r"sim\.yaml:3: sensor co2: dynamics is 'odd', .*uniform, linear, radial"),
        ("time: 3\nsensors: {}", r"sim\.yaml:1: time must be a mapping"),
    ],
)
def test_bad_configuration_error_names_file_and_line(tmp_path: Path, text: str, problem: str) -> None:
    path = tmp_path / "sim.yaml"
    path.write_text(text)
    with pytest.raises(GreenhouseConfigError, match=problem):
        ClimateSimulator(layout(tmp_path), path)


def test_missing_file_is_an_error_not_an_empty_greenhouse(tmp_path: Path) -> None:
    with pytest.raises(GreenhouseConfigError, match=r"gone\.json: the layout cannot be read: .*No such file"):
        ClimateSimulator(tmp_path / "gone.json")
    with pytest.raises(GreenhouseConfigError, match=r"gone\.yaml: cannot read the simulator configuration"):
        ClimateSimulator(None, tmp_path / "gone.yaml")


def test_configuration_without_times_runs_at_default_speed(tmp_path: Path) -> None:
    now = {"s": 12.0}
    path = tmp_path / "sim.yaml"
    path.write_text("sensors:\n  co2: [{value_at_noon: 5}]\n")
    tags = layout(tmp_path, **{"1": {"x": 0, "y": 0, "sensors": ["co2"]}})
    assert ClimateSimulator(tags, path, clock_s=lambda: now["s"]).read("1").time_of_day_s == pytest.approx(21600.0)
