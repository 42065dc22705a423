"""Readings of the greenhouse simulator `mdp-greenhouse`, with work-arounds for its faults up to version 1.0.8.

- a tag file given as a string crashes (it calls `.exists()` on it), and a missing one becomes an empty greenhouse: paths are
  Path objects here, and files are checked first, with file and line in the message;
- `current_time()` has been wrong by a factor 24, in debug mode and live: times are wrapped into [0, 86400);
- its clock is the wall's time of day times the speed-up, cut to whole seconds, so that at the default speed-up readings jump
  by half an hour and midnight breaks them: time is counted here, and passed in for each reading;
- the seed of its noise is applied by the constructor only, to the global state of the `random` module, and debug mode prints a
  banner on standard output: the noise has its own state here, seeded after the overrides are applied;
- a configuration without `time.debug_mode` crashes the constructor, and wrong settings crash a reading: the file is checked
  and applied here;
- a tag with a sensor that the configuration lacks fails at the reading (KeyError): it is an error at the start;
- its command line imports GUI toolkits: only `greenhouse_sim.simulator` is imported here.
"""

from __future__ import annotations

import contextlib
import io
import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from lupin_runtime.bounded_file import read_bounded_text
from lupin_runtime.layout import LayoutError, LayoutText
from lupin_runtime.yaml_text import compose_yaml, load_yaml, where_and_why

DAY_S = 86400.0
DEFAULT_SPEEDUP = 1800.0  # a day in 48 s

# The expected value of each setting with which the package would fail at a reading otherwise.
SETTINGS = {
    "speedup_factor": "a positive number",
    "debug_time_of_day": "a number",
    "value_at_midnight": "a number",
    "value_at_noon": "a number",
    "noise_sigma": "a number",
    "angle": "a number",
    "decay_distance": "a positive number",
    "position": "a point [x, y] in meters",
    "dynamics": "the name of a dynamics",
}


class GreenhouseConfigError(ValueError):
    """A layout or configuration file that cannot be used; the message names file and line."""


class UnknownTag(LookupError):
    """The greenhouse has no tag of that id; the message lists those it has."""


@dataclass(frozen=True)
class Overrides:
    """The operator's values in place of the configuration file's; the defaults keep those of the file."""

    debug_time_of_day: float = -1.0  # hour, >= 0: debug mode, frozen there
    speedup_factor: float = 0.0  # simulated seconds a real one, > 0
    debug_seed: int = -1  # >= 0: debug mode, with this seed


@dataclass(frozen=True)
class Reading:
    """One tag's sensors at one simulated time of day, s in [0, 86400)."""

    time_of_day_s: float
    values: Mapping[str, float]


class ClimateSimulator:
    """Gives the readings of a tag. Not thread-safe: the noise has one state."""

    def __init__(
        self,
        tag_file: Path | None = None,
        sim_config_file: Path | None = None,
        overrides: Overrides | None = None,
        clock_s: Callable[[], float] | None = None,
    ) -> None:
        """A file of None is the packaged one. `clock_s` returns real time in seconds since the start of a day; it is needed
        unless debug mode fixes the hour. Raises GreenhouseConfigError."""
        overrides = overrides or Overrides()
        layout = _read_layout(tag_file) if tag_file is not None else None
        if sim_config_file is not None:
            check_config_file(sim_config_file)
        self._simulator = _construct(tag_file, sim_config_file)
        time = self._simulator.sim_config["time"] = dict(self._simulator.sim_config.get("time") or {})
        time.setdefault("debug_mode", False)
        if overrides.debug_time_of_day >= 0.0:
            time.update(debug_mode=True, debug_time_of_day=overrides.debug_time_of_day)
        if overrides.debug_seed >= 0:
            time.update(debug_mode=True, debug_seed=overrides.debug_seed)
        if overrides.speedup_factor > 0.0:
            time.update(speedup_factor=overrides.speedup_factor)
        self._debug = bool(time.get("debug_mode", False))
        self._frozen_s = float(time.get("debug_time_of_day", 12.0)) * 3600.0 if self._debug else None
        self._speedup = float(time.get("speedup_factor", DEFAULT_SPEEDUP))
        self._clock_s = clock_s
        self._noise = random.Random(time.get("debug_seed")) if self._debug else random.Random()
        self._check_sensors(layout)

    @property
    def tags(self) -> tuple[str, ...]:
        """Tag ids, in the order of the layout."""
        return tuple(self._simulator.tags())

    @property
    def sensors(self) -> tuple[str, ...]:
        """Sensor names of the configuration."""
        return tuple(self._simulator.sensors())

    def time_of_day_s(self) -> float:
        """The simulated time of day, [0, 86400)."""
        if self._frozen_s is not None:
            return _wrapped(self._frozen_s)
        return _wrapped(self._clock_s() * self._speedup) if self._clock_s else _wrapped(float(self._simulator.current_time()))

    def read(self, tag_id: str) -> Reading:
        """Read the sensors at a tag. Raises UnknownTag."""
        if tag_id not in self.tags:
            raise UnknownTag(f"no tag {tag_id!r} in the greenhouse; it has {', '.join(self.tags) or 'none'}")
        now_s = self.time_of_day_s()
        # The package asks its instance for the time at each reading.
        self._simulator.current_time = lambda: now_s
        shared = random.getstate()
        random.setstate(self._noise.getstate())
        try:
            data = self._simulator.get_sensor_data(tag_id)
        finally:
            self._noise.setstate(random.getstate())
            random.setstate(shared)
        # `timestamp` is in the same dictionary and is not a sensor.
        return Reading(now_s, {name: float(value) for name, value in data.items() if name != "timestamp"})

    def _check_sensors(self, layout: LayoutText | None) -> None:
        for tag_id, tag in self._simulator.tag_manager.get_tags().items():
            missing = [name for name in tag.get("sensors", ()) if name not in self.sensors]
            if missing:
                has = f"it has {', '.join(self.sensors)}"
                problem = f"tag {tag_id} has the sensor {missing[0]!r}, which the configuration lacks; {has}"
                located = layout.error(tag_id, problem) if layout is not None else f"the packaged layout: {problem}"
                raise GreenhouseConfigError(str(located))


def _wrapped(time_s: float) -> float:
    wrapped = time_s % DAY_S
    return wrapped if wrapped < DAY_S else 0.0  # a tiny negative number wraps to the modulus itself


def _construct(tag_file: Path | None, sim_config_file: Path | None) -> Any:
    from greenhouse_sim.simulator import GreenhouseSimulator, SensorRegistry

    # In debug mode the package prints a banner, which would break JSON on our standard output, and seeds the global `random`.
    shared = random.getstate()
    with contextlib.redirect_stdout(io.StringIO()):
        simulator = GreenhouseSimulator(tag_file, None)
    random.setstate(shared)
    if sim_config_file is not None:
        # The constructor requires keys for which its accessors have defaults, so the configuration is replaced afterwards.
        simulator.sim_config = load_yaml(read_bounded_text(sim_config_file))
        simulator.sensor_registry = SensorRegistry(simulator.sim_config)
    return simulator


def _read_layout(path: Path) -> LayoutText:
    """Return the text of a layout that has the sensors of each tag. Raises GreenhouseConfigError."""
    try:
        text = LayoutText.read(path)
        text.parse()
        text.sensors()
    except LayoutError as error:
        raise GreenhouseConfigError(str(error)) from error
    return text


def check_config_file(path: Path) -> None:
    """Raise GreenhouseConfigError unless `path` holds a configuration: a mapping `sensors` of lists of settings."""
    text = _text(path)
    try:
        root = compose_yaml(text)
    except yaml.YAMLError as error:
        line, problem = where_and_why(error)
        raise GreenhouseConfigError(f"{path}:{line or 1}: the simulator configuration is {problem}") from error
    sections = _section(path, "the file", root)
    if "sensors" not in sections:
        raise GreenhouseConfigError(f"{path}:1: the simulator configuration has no section 'sensors'")
    from greenhouse_sim.dynamics import AVAILABLE_DYNAMICS
    from greenhouse_sim.sensors import AVAILABLE_SENSORS

    for name, node in _section(path, "sensors", sections["sensors"]).items():
        line = node.start_mark.line + 1
        if name not in AVAILABLE_SENSORS:
            raise GreenhouseConfigError(f"{path}:{line}: no sensor {name!r}; there are {', '.join(AVAILABLE_SENSORS)}")
        if not isinstance(node, yaml.SequenceNode) or not node.value:
            raise GreenhouseConfigError(f"{path}:{line}: sensor {name} must be a list of at least one field of settings")
        for field in node.value:
            for key, value in _section(path, f"sensor {name}", field).items():
                _check_setting(path, f"sensor {name}: {key}", key, value, tuple(AVAILABLE_DYNAMICS))
    time = sections.get("time")
    for key, node in _section(path, "time", time).items() if time is not None else ():
        _check_setting(path, f"time.{key}", key, node, ())


def _check_setting(path: Path, name: str, key: str, node: yaml.Node, dynamics: tuple[str, ...]) -> None:
    """Refuse a value with which the package would fail at a reading."""
    wanted = SETTINGS.get(key)
    if wanted is None:
        return
    value = load_yaml(yaml.serialize(node))
    good: dict[str, Callable[[], bool]] = {
        "a number": lambda: _is_number(value),
        "a positive number": lambda: _is_number(value) and value > 0,
        "a point [x, y] in meters": lambda: isinstance(value, list) and len(value) == 2 and all(map(_is_number, value)),
        "the name of a dynamics": lambda: value in dynamics,
    }
    if not good[wanted]():
        known = f" ({', '.join(dynamics)})" if wanted == "the name of a dynamics" else ""
        raise GreenhouseConfigError(f"{path}:{node.start_mark.line + 1}: {name} is {value!r}, expected {wanted}{known}")


def _section(path: Path, name: str, node: yaml.Node | None) -> dict[str, yaml.Node]:
    if not isinstance(node, yaml.MappingNode):
        line = node.start_mark.line + 1 if node is not None else 1
        raise GreenhouseConfigError(f"{path}:{line}: {name} must be a mapping of names to values")
    return {str(key.value): value for key, value in node.value}


def _text(path: Path) -> str:
    try:
        return read_bounded_text(path)
    except OSError as error:
        raise GreenhouseConfigError(f"{path}: cannot read the simulator configuration: {error.strerror or error}") from error


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
