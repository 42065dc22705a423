"""The cleanup plan: which processes and files count as stale."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.cleanup.plan import CleanupPlan, make_plan
from lupin_cli.cleanup.process_tree import ProcessNode, ProcessTree, parse
from lupin_cli.connection.base import Output
from lupin_cli.facts.ros_processes import RosProcess
from lupin_cli.facts.shared_memory import SharedFile
from lupin_cli.facts.sockets import Socket, Sockets

STALE = RosProcess(500, 1, 1000, "S", 60.0, "/user.slice/user-1000.slice/session-2.scope", ("/opt/ros/twin_node",))
TREE = ProcessTree(
    {1: ProcessNode(1, 0, 1, "systemd"), 40: ProcessNode(40, 1, 30, "bash"), 500: ProcessNode(500, 1, 77, "twin_node")}
)


def on(port: int, pid: int = 500, process: str = "twin_node") -> Sockets:
    return Sockets((Socket("udp", "0.0.0.0", port, process, pid),))


def plan(
    process: RosProcess = STALE,
    sockets: Sockets | None = None,
    files: list[SharedFile] | tuple[Any, ...] = (),
    tree: ProcessTree = TREE,
    user_id: int = 1000,
    **rest: Any,
) -> CleanupPlan:
    return make_plan([process], on(7412) if sockets is None else sockets, files, tree, user_id=user_id, **rest)


def test_ros_process_on_dds_port_without_parent_is_terminated() -> None:
    (process,) = plan().processes
    assert (process.pid, process.start_ticks, process.name, process.ports) == (500, 77, "twin_node", (7412,))


@pytest.mark.parametrize(
    ("change", "tree", "reason"),
    [
        ({"group": "/system.slice/mirte-ros.service"}, TREE, "part of mirte-ros.service; restart that instead"),
        ({"arguments": ("/usr/bin/fast-discovery-server", "-i", "0")}, TREE, "other processes depend on it"),
        ({"parent": 40}, TREE, "its parent bash (40) is alive"),
    ],
)
def test_supervised_process_is_named_and_kept(change: dict[str, Any], tree: ProcessTree, reason: str) -> None:
    found = plan(replace(STALE, **change), tree=tree)
    assert found.processes == () and reason in found.kept[0].reason and not found.kept[0].needs_root


def with_parent(name: str, pid: int = 1) -> ProcessTree:
    """Return the tree in which the process's parent has another name."""
    return ProcessTree({**TREE.processes, pid: ProcessNode(pid, 0, 1, name)})


def adopted_by(pid: int, name: str) -> CleanupPlan:
    return plan(replace(STALE, parent=pid, parent_name=name), tree=with_parent(name, pid))


def test_orphan_of_a_desktop_session_is_terminated() -> None:
    assert [each.pid for each in adopted_by(1873, "systemd").processes] == [500]
    assert [each.pid for each in adopted_by(1, "init").processes] == [500]


@pytest.mark.parametrize("first", ["bash", "sh", "python3", "docker-init", "tini"])
def test_program_in_a_container_has_its_parent(first: str) -> None:
    found = adopted_by(1, first)
    assert found.processes == () and f"its parent {first} (1) is alive" in found.kept[0].reason


def test_program_of_a_container_runtime_is_kept() -> None:
    assert adopted_by(712, "containerd-shim").processes == ()


def test_command_of_lupin_without_parent_is_kept() -> None:
    found = plan(replace(STALE, arguments=("/usr/bin/python3", "/opt/lupin/bin/lupin", "up")))
    assert found.processes == () and "a command of Lupin" in found.kept[0].reason


def test_stopped_process_is_terminated_unless_its_shell_lives() -> None:
    stopped = replace(STALE, state="T", group="/system.slice/run-7.service")
    assert plan(stopped).processes[0].reason == "it is stopped and does not respond"
    assert plan(replace(stopped, parent=40)).processes == ()


def test_processes_of_live_run_and_children_are_kept() -> None:
    assert plan(runs={500: "20261121-1"}).kept[0].reason.startswith("part of the live run 20261121-1")
    tree = ProcessTree({**TREE.processes, 499: ProcessNode(499, 1, 5, "python3"), 500: ProcessNode(500, 499, 77, "twin_node")})
    found = plan(replace(STALE, parent=499), tree=tree, runs={499: "20261121-1"})
    assert found.processes == () and "live run" in found.kept[0].reason


def test_cleaning_program_itself_is_kept() -> None:
    assert plan(own_pids={500}).processes == ()


def test_ports_are_those_of_the_process_own_domain() -> None:
    assert plan(sockets=on(7460)).processes == plan(sockets=on(8912)).processes == ()
    in_domain_6 = replace(STALE, environment={"ROS_DOMAIN_ID": "6"})
    assert plan(in_domain_6, sockets=on(8912)).processes[0].ports == (8912,)


def test_process_without_ros_is_kept_on_any_port() -> None:
    found = make_plan([], on(7412, 600, "dnsmasq"), (), TREE, user_id=0)
    assert found.processes == () and found.kept[0].reason == "is not a ROS process"


def test_own_ros2_daemon_is_terminated_without_port() -> None:
    daemon = replace(STALE, arguments=("/usr/bin/python3", "-c", "from ros2cli.daemon.daemonize import main; main()"))
    assert plan(daemon, sockets=Sockets(())).processes[0].reason.startswith("the ros2 command's daemon")
    found = plan(daemon, sockets=Sockets(()), user_id=1001)
    assert found.processes == () and found.kept[0].needs_root
    assert plan(daemon, sockets=Sockets(()), user_id=0).processes


def shared_file(name: str, held: bool = False, lockable: bool = True, user_id: int = 1000) -> SharedFile:
    return SharedFile(name, user_id, 10, 0, lockable, held)


def test_unlocked_files_are_removed_with_lock_and_semaphore() -> None:
    files = [shared_file(name) for name in ("fastrtps_port7411", "fastrtps_port7411_el", "sem.fastrtps_port7411_mutex")]
    (segment,) = plan(files=files, sockets=Sockets(())).segments
    assert segment.lock == "fastrtps_port7411_el" and set(segment.files) == {file.name for file in files}


def test_files_in_use_are_kept() -> None:
    files = [shared_file("fastrtps_ab12", held=True), shared_file("fastrtps_ab12_el", held=True)]
    assert plan(files=files, sockets=Sockets(())).is_empty


def test_file_without_lock_is_removed_only_if_provably_unmapped() -> None:
    files = [shared_file("fastrtps_ab12", lockable=False)]
    assert plan(files=files, sockets=Sockets(())).segments[0].lock == ""
    mapped = replace(TREE, mapped_by={"fastrtps_ab12": (500,)})
    assert plan(files=files, sockets=Sockets(()), tree=mapped).is_empty
    unreadable = replace(TREE, all_maps_readable=False)
    found = plan(files=files, sockets=Sockets(()), tree=unreadable)
    assert found.is_empty and "run as root" in found.kept[0].reason


def test_segment_of_other_user_is_removed_only_by_root() -> None:
    files = [shared_file("fastrtps_ab12", user_id=0), shared_file("fastrtps_ab12_el", user_id=0)]
    found = plan(files=files, sockets=Sockets(()))
    assert found.is_empty and found.kept[0].needs_root
    assert plan(files=files, sockets=Sockets(()), user_id=0).segments


@given(
    st.lists(
        st.tuples(st.sampled_from(("a1", "port7", "b2")), st.sampled_from(("", "_el", "_sl")), st.booleans()),
        unique_by=lambda f: f[:2],
    )
)
def test_no_file_of_held_segment_is_removed(described: list[tuple[str, str, bool]]) -> None:
    held = {owner for owner, _, is_held in described if is_held}
    files = [shared_file(f"fastrtps_{owner}{suffix}", owner in held) for owner, suffix, _ in described]
    removed = {name for segment in plan(files=files, sockets=Sockets(())).segments for name in segment.files}
    assert removed == {file.name for file in files if not file.held}


def test_truncated_probe_is_rejected() -> None:
    with pytest.raises(ValueError, match="before its last line"):
        parse(Output(None, "@@ stat\n1 (init) S 0 1\n"))
