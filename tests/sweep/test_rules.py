"""Which processes and files are left over, from facts alone."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.facts.ros_processes import RosProcess
from lupin_cli.facts.shared_memory import SharedFile
from lupin_cli.facts.sockets import Socket, Sockets
from lupin_cli.sweep.families import Families, Member, parse
from lupin_cli.sweep.rules import make_plan
from lupin_cli.target.base import Output

ZOMBIE = RosProcess(500, 1, 1000, "S", 60.0, "/user.slice/user-1000.slice/session-2.scope", ("/opt/ros/twin_node",))
FAMILY = Families({1: Member(1, 0, 1, "systemd"), 40: Member(40, 1, 30, "bash"), 500: Member(500, 1, 77, "twin_node")})


def on(port: int, pid: int = 500, process: str = "twin_node") -> Sockets:
    return Sockets((Socket("udp", "0.0.0.0", port, process, pid),))


def plan(process=ZOMBIE, sockets=None, files=(), families=FAMILY, user_id=1000, **rest):
    return make_plan([process], on(7412) if sockets is None else sockets, files, families, user_id=user_id, **rest)


def test_a_ros_process_on_a_dds_port_whose_starter_is_gone_is_ended() -> None:
    (culprit,) = plan().culprits
    assert (culprit.pid, culprit.start_ticks, culprit.name, culprit.ports) == (500, 77, "twin_node", (7412,))


@pytest.mark.parametrize(
    ("change", "families", "said"),
    [
        ({"group": "/system.slice/mirte-ros.service"}, FAMILY, "part of mirte-ros.service; restart that instead"),
        ({"arguments": ("/usr/bin/fast-discovery-server", "-i", "0")}, FAMILY, "others wait for it"),
        ({"parent": 40}, FAMILY, "started by bash (40), which lives"),
    ],
)
def test_what_somebody_looks_after_is_named_and_left_alone(change, families, said) -> None:
    made = plan(replace(ZOMBIE, **change), families=families)
    assert made.culprits == () and said in made.kept[0].why and not made.kept[0].blocks


def test_a_stopped_process_of_a_service_is_ended_and_one_of_a_shell_that_lives_is_not() -> None:
    stopped = replace(ZOMBIE, state="T", group="/system.slice/run-7.service")
    assert plan(stopped).culprits[0].why == "it is stopped and answers nobody"
    assert plan(replace(stopped, parent=40)).culprits == ()


def test_a_process_of_a_live_run_is_left_alone_and_so_are_its_children() -> None:
    assert plan(runs={500: "20261121-1"}).kept[0].why.startswith("part of the live run 20261121-1")
    family = Families({**FAMILY.members, 499: Member(499, 1, 5, "python3"), 500: Member(500, 499, 77, "twin_node")})
    made = plan(replace(ZOMBIE, parent=499), families=family, runs={499: "20261121-1"})
    assert made.culprits == () and "live run" in made.kept[0].why


def test_whoever_sweeps_is_left_alone() -> None:
    assert plan(ourselves={500}).culprits == ()


def test_the_ports_are_those_of_the_processes_own_domain() -> None:
    assert plan(sockets=on(7460)).culprits == plan(sockets=on(8912)).culprits == ()
    elsewhere = replace(ZOMBIE, environment={"ROS_DOMAIN_ID": "6"})
    assert plan(elsewhere, sockets=on(8912)).culprits[0].ports == (8912,)


def test_a_process_that_is_not_ros_is_never_ended_whatever_port_it_holds() -> None:
    made = make_plan([], on(7412, 600, "dnsmasq"), (), FAMILY, user_id=0)
    assert made.culprits == () and made.kept[0].why == "is no ROS process"


def test_the_ros2_daemon_is_ended_even_without_a_port_but_not_another_users() -> None:
    daemon = replace(ZOMBIE, arguments=("/usr/bin/python3", "-c", "from ros2cli.daemon.daemonize import main; main()"))
    assert plan(daemon, sockets=Sockets(())).culprits[0].why.startswith("the ros2 command's daemon")
    made = plan(daemon, sockets=Sockets(()), user_id=1001)
    assert made.culprits == () and made.kept[0].blocks
    assert plan(daemon, sockets=Sockets(()), user_id=0).culprits


def segment(name: str, held: bool = False, lockable: bool = True, user_id: int = 1000) -> SharedFile:
    return SharedFile(name, user_id, 10, 0, lockable, held)


def test_files_whose_lock_nobody_holds_go_together_with_their_lock_and_semaphore() -> None:
    files = [segment(name) for name in ("fastrtps_port7411", "fastrtps_port7411_el", "sem.fastrtps_port7411_mutex")]
    (orphan,) = plan(files=files, sockets=Sockets(())).orphans
    assert orphan.lock == "fastrtps_port7411_el" and set(orphan.files) == {file.name for file in files}


def test_files_in_use_stay() -> None:
    files = [segment("fastrtps_ab12", held=True), segment("fastrtps_ab12_el", held=True)]
    assert plan(files=files, sockets=Sockets(())).clean


def test_a_file_without_a_lock_goes_only_where_every_process_could_be_looked_at_and_none_maps_it() -> None:
    files = [segment("fastrtps_ab12", lockable=False)]
    assert plan(files=files, sockets=Sockets(())).orphans[0].lock == ""
    mapped = replace(FAMILY, maps={"fastrtps_ab12": (500,)})
    assert plan(files=files, sockets=Sockets(()), families=mapped).clean
    blind = replace(FAMILY, every_map_read=False)
    made = plan(files=files, sockets=Sockets(()), families=blind)
    assert made.clean and "ask as root" in made.kept[0].why


def test_another_users_orphan_is_named_as_left_over_and_roots_sweep_removes_it() -> None:
    files = [segment("fastrtps_ab12", user_id=0), segment("fastrtps_ab12_el", user_id=0)]
    made = plan(files=files, sockets=Sockets(()))
    assert made.clean and made.kept[0].blocks
    assert plan(files=files, sockets=Sockets(()), user_id=0).orphans


@given(
    st.lists(
        st.tuples(st.sampled_from(("a1", "port7", "b2")), st.sampled_from(("", "_el", "_sl")), st.booleans()),
        unique_by=lambda f: f[:2],
    )
)
def test_no_file_of_a_segment_that_is_held_is_ever_removed(described) -> None:
    held = {owner for owner, _, is_held in described if is_held}
    files = [segment(f"fastrtps_{owner}{suffix}", owner in held) for owner, suffix, _ in described]
    removed = {name for orphan in plan(files=files, sockets=Sockets(())).orphans for name in orphan.files}
    assert removed == {file.name for file in files if not file.held}


def test_a_probe_that_was_cut_is_not_believed() -> None:
    with pytest.raises(ValueError, match="before its last line"):
        parse(Output(None, "@@ stat\n1 (init) S 0 1\n"))
