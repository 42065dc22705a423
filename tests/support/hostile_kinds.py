"""The kinds of hostile inputs: the files that each needs, which of them are damaged, and what reads them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from lupin_cli.connection import destination
from lupin_cli.connection.base import TargetError
from lupin_cli.connection.host_keys import KnownHosts
from lupin_cli.facts.dds_profiles import parse_profile
from lupin_runtime.arm.store import LibraryStore
from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.bounded_file import read_bounded_text
from lupin_runtime.cameras.configuration import read_configuration
from lupin_runtime.console.locations import all_locations
from lupin_runtime.console.sessions import Sessions
from lupin_runtime.console.settings import stored_settings
from lupin_runtime.layout import LayoutError, load_layout
from lupin_runtime.mission.overrides import OverridesError, load_overrides
from lupin_runtime.stack.runs import Run
from tests.support import hostile_samples as samples

_PLAN = ("--from", "0,0", "--to", "0.2,0.2")
_RUN = f"state/lupin/runs/{samples.RUN_ID}"


@dataclass(frozen=True)
class Kind:
    """One kind of input: how its files are written, which of them are damaged, and what reads them.

    `commands` are words after `lupin`; `read` is called with the folder instead, for files that only the runtime reads, and may
    raise `expected`. A command that `changes` a file may do so if it succeeds.
    """

    name: str
    write: Callable[[Path], object]
    targets: tuple[str, ...]
    commands: tuple[tuple[str, ...], ...] = ()
    read: Callable[[Path], object] | None = None
    expected: tuple[type[Exception], ...] = (OSError, MalformedFile)
    changes: bool = False
    weight: int = 4


def _file(name: str, text: Callable[[], str]) -> Callable[[Path], object]:
    def write(folder: Path) -> None:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text())

    return write


def _write_playbooks(folder: Path) -> None:
    (folder / "sample.yaml").write_text(samples.PLAYBOOK)
    (folder / "inner.yaml").write_text(samples.INNER_PLAYBOOK)
    (folder / "deploy-robot.yaml").write_text(samples.shipped_playbook("deploy-robot.yaml"))


def _write_picture_and_camera(folder: Path) -> None:
    samples.write_maps(folder)
    (folder / "camera.yaml").write_text(samples.CALIBRATION)


def _write_everything(folder: Path) -> None:
    _write_playbooks(folder)
    samples.write_maps(folder)
    samples.write_run(folder / "state")


def _write_ssh(folder: Path) -> None:
    ssh = folder / "home/.ssh"
    (ssh / "config.d").mkdir(parents=True)
    (ssh / "config").write_text(samples.SSH_CONFIG)
    (ssh / "config.d/extra").write_text("Host extra\n    Port 2222\n")
    (ssh / "known_hosts").write_text(f"# keys\n127.0.0.1,greenhouse ssh-ed25519 {samples.HOST_KEY}\n@revoked * ssh-rsa AAAA\n")
    _file("config/lupin/lupin.toml", lambda: samples.INVENTORY)(folder)
    _file("config/lupin/known_hosts", lambda: f"pot-2 ssh-ed25519 {samples.HOST_KEY}\n")(folder)


def _write_shell(folder: Path) -> None:
    _file("home/.bashrc", lambda: "# shell\nexport PATH=$PATH\n")(folder)
    _file("config/lupin/ros-env.sh", lambda: "export ROS_DISCOVERY_SERVER=10.42.0.1:11811\nexport ROS_DOMAIN_ID=0\n")(folder)


def _look_up_host(folder: Path) -> None:
    path = folder / "home/.ssh/config"
    for host in ("greenhouse", "jump", "other"):
        found = destination.resolve(host, config_path=path)
        KnownHosts(folder / "config/lupin/known_hosts", folder / "home/.ssh/known_hosts").key_types("pot-2", found)


def _read_state(folder: Path) -> None:
    from lupin_cli.run.live_view import run_view
    from lupin_cli.safe_console import SafeConsole

    console = SafeConsole()
    console.print(run_view(Run(folder / _RUN).state(), console))


KINDS = (
    Kind(
        "map",
        samples.write_maps,
        ("map.yaml", "map.pgm"),
        (("map", "plan", "map.yaml", *_PLAN), ("map", "plan", "map.yaml", *_PLAN, "--json")),
    ),
    Kind("plain map", samples.write_maps, ("plain.yaml", "plain.pgm"), (("map", "plan", "plain.yaml", *_PLAN),)),
    Kind("map as PNG", samples.write_maps, ("picture.yaml", "picture.png"), (("map", "plan", "picture.yaml", *_PLAN),)),
    Kind("picture", samples.write_maps, ("picture.png",), (("tags", "detect", "picture.png"),), weight=2),
    Kind(
        "calibration",
        _write_picture_and_camera,
        ("camera.yaml",),
        (("tags", "detect", "--pose", "--camera", "camera.yaml", "picture.png"),),
    ),
    Kind(
        "pose graph",
        lambda folder: samples.write_graph(folder / "graph.g2o"),
        ("graph.g2o",),
        (("map", "optimize", "graph.g2o"), ("map", "optimize", "graph.g2o", "--json")),
    ),
    Kind(
        "log",
        lambda folder: samples.write_carmen(folder / "log.clf"),
        ("log.clf",),
        (("map", "build", "log.clf", "--out", "out"),),
        weight=1,
    ),
    Kind("playbook", _write_playbooks, ("sample.yaml",), (("play", "--list", "sample.yaml"),), weight=7),
    Kind("included playbook", _write_playbooks, ("inner.yaml",), (("play", "--list", "sample.yaml"),), weight=2),
    Kind("shipped playbook", _write_playbooks, ("deploy-robot.yaml",), (("play", "--list", "deploy-robot.yaml"),), weight=2),
    Kind(
        "inventory",
        _file("lupin.toml", lambda: samples.INVENTORY),
        ("lupin.toml",),
        (("robots", "list", "--config", "lupin.toml"), ("robots", "list", "--json", "--config", "lupin.toml")),
    ),
    Kind(
        "changed inventory",
        _file("lupin.toml", lambda: samples.INVENTORY),
        ("lupin.toml",),
        (
            ("robots", "add", "new", "mirte@10.0.0.9", "--config", "lupin.toml"),
            ("robots", "remove", "pot-2", "--config", "lupin.toml"),
            ("robots", "rename", "pot-2", "pot-3", "--config", "lupin.toml"),
        ),
        changes=True,
    ),
    Kind(
        "journal",
        lambda folder: samples.write_journal(folder / "state/lupin/journal"),
        ("state/lupin/journal/*.jsonl",),
        (
            ("journal", "show", "latest"),
            ("journal", "list"),
            ("journal", "show", "sample", "--json"),
        ),
        weight=7,
    ),
    Kind(
        "run",
        lambda folder: samples.write_run(folder / "state"),
        tuple(f"{_RUN}/{name}" for name in samples.run_files()),
        (
            ("status",),
            ("status", "--json"),
            ("runs", "list"),
            ("runs", "--json"),
            ("env",),
            ("down",),
            ("runs", "prune", "--dry-run"),
            ("mission", "status"),
        ),
        weight=8,
    ),
    Kind("state", lambda folder: samples.write_run(folder / "state"), (f"{_RUN}/state.json",), read=_read_state, weight=5),
    Kind(
        "process log",
        lambda folder: samples.write_run(folder / "state"),
        (f"{_RUN}/logs/nav.log",),
        (("logs",), ("logs", "nav", "--level", "warn", "--json")),
        weight=2,
    ),
    Kind(
        "recording",
        lambda folder: samples.write_recording(folder / "recording.mcap"),
        ("recording.mcap",),
        (("replay", "--info", "recording.mcap"), ("replay", "--info", "--json", "recording.mcap")),
        weight=6,
    ),
    Kind(
        "rosbag2 folder",
        lambda folder: samples.write_bag(folder / "bag"),
        ("bag/metadata.yaml", "bag/bag_0.mcap", "bag/bag_1.mcap.zstd"),
        (("replay", "--info", "bag"), ("replay", "--info", "--json", "bag")),
    ),
    Kind(
        "reported recording",
        lambda folder: samples.write_recording(folder / "recording.mcap"),
        ("recording.mcap",),
        (("report", "recording.mcap", "--out", "out"),),
        weight=1,
    ),
    Kind(
        "reported run",
        lambda folder: samples.write_run(folder / "state"),
        tuple(f"{_RUN}/{name}" for name in ("run.json", "state.json", "result.json", "recording.mcap")),
        (("report", "latest", "--out", "out"),),
        weight=1,
    ),
    Kind("SSH", _write_ssh, ("home/.ssh/config", "home/.ssh/config.d/extra"), read=_look_up_host, expected=(TargetError,)),
    Kind(
        "host keys",
        _write_ssh,
        ("home/.ssh/known_hosts", "config/lupin/known_hosts"),
        read=_look_up_host,
        expected=(TargetError,),
        weight=3,
    ),
    Kind(
        "robot's keys",
        _write_ssh,
        ("home/.ssh/config", "config/lupin/known_hosts"),
        (("robots", "forget", "pot-2"), ("robots", "rename", "pot-2", "pot-3")),
        changes=True,
        weight=1,
    ),
    Kind(
        "shell",
        _write_shell,
        ("home/.bashrc", "config/lupin/ros-env.sh"),
        (("dds", "setup", "10.42.0.2", "--dry-run"), ("dds", "remove", "--dry-run"), ("dds", "remove")),
        changes=True,
        weight=2,
    ),
    Kind(
        "DDS profile",
        _file("profile.xml", samples.dds_profile),
        ("profile.xml",),
        read=lambda folder: parse_profile("profile.xml", read_bounded_text(folder / "profile.xml", errors="surrogateescape")),
        weight=2,
    ),
    Kind(
        "settings",
        _file("settings.json", samples.settings_text),
        ("settings.json",),
        read=lambda folder: stored_settings(folder / "settings.json"),
    ),
    Kind(
        "locations",
        _file("locations.json", samples.locations_text),
        ("locations.json",),
        read=lambda folder: all_locations(folder / "locations.json"),
    ),
    Kind(
        "sessions",
        _file("sessions.json", samples.sessions_text),
        ("sessions.json",),
        read=lambda folder: Sessions(folder / "sessions.json").refresh(),
        weight=2,
    ),
    Kind(
        "arm library",
        _file("library.json", samples.library_text),
        ("library.json",),
        read=lambda folder: LibraryStore(folder / "library.json").listing(),
        weight=3,
    ),
    Kind(
        "layout",
        _file("layout.json", samples.layout_text),
        ("layout.json",),
        read=lambda folder: load_layout(folder / "layout.json"),
        expected=(LayoutError,),
        weight=3,
    ),
    Kind(
        "overrides",
        lambda folder: samples.write_approach_overrides(folder / "overrides.yaml"),
        ("overrides.yaml",),
        read=lambda folder: load_overrides(folder / "overrides.yaml"),
        expected=(OverridesError,),
        weight=3,
    ),
    Kind(
        "cameras",
        _file("cameras.yaml", lambda: samples.CAMERAS),
        ("cameras.yaml",),
        read=lambda folder: read_configuration(folder / "cameras.yaml"),
        weight=2,
    ),
    Kind(
        "arguments",
        _write_everything,
        (),
        (
            ("map", "plan", "{}", *_PLAN),
            ("map", "plan", "map.yaml", "--from", "{}", "--to", "0,0"),
            ("map", "plan", "map.yaml", *_PLAN, "--radius", "{}"),
            ("map", "optimize", "{}"),
            ("map", "build", "{}", "--out", "out"),
            ("map", "build", "map.yaml", "--out", "{}"),
            ("play", "--list", "{}"),
            ("play", "--list", "sample.yaml", "--tag", "{}"),
            ("play", "{}", "--dry-run", "--robot", "127.0.0.1:9"),
            ("play", "sample.yaml", "--dry-run", "--robot", "127.0.0.1:9", "-v", "{}"),
            ("play", "sample", "--undo", "{}", "--robot", "127.0.0.1:9"),
            ("journal", "show", "{}"),
            ("robots", "list", "--config", "{}"),
            ("robots", "add", "{}", "10.0.0.9"),
            ("robots", "add", "pot-9", "{}"),
            ("robots", "remove", "{}"),
            ("robots", "rename", "{}", "{}"),
            ("status", "--run", "{}"),
            ("runs", "keep", "{}"),
            ("runs", "prune", "--count", "{}", "--dry-run"),
            ("runs", "prune", "--max-gb", "{}", "--dry-run"),
            ("logs", "{}"),
            ("logs", "--run", "{}", "--level", "{}"),
            ("logs", "-n", "{}"),
            ("replay", "--info", "{}"),
            ("report", "{}", "--out", "out"),
            ("report", "latest", "--out", "{}"),
            ("tags", "detect", "{}"),
            ("tags", "detect", "--camera", "{}", "--pose", "picture.png"),
            ("tags", "detect", "--annotate", "{}", "picture.png"),
            ("tags", "detect", "--family", "{}", "picture.png"),
            ("dds", "setup", "{}", "--dry-run"),
            ("sim", "picture", "{}"),
            ("sim", "picture", "demo", "--out", "{}"),
            ("mission", "start", "--discovery-goal", "{}"),
            ("foxglove", "layout", "--out", "{}"),
            ("completion", "{}"),
            ("env", "--run", "{}"),
            ("down", "--run", "{}"),
            ("up", "--world", "{}", "--no-such-option"),
            ("{}",),
            ("--{}",),
        ),
        changes=True,
        weight=10,
    ),
)
