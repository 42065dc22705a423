"""Faults of the set-up at either end, made for real beside a robot that boots: each is named as the one cause.

Only the network's checks run here, as in test_on_the_booted_robot.
"""

from __future__ import annotations

import pytest

from .laptop import Laptop, profile

pytestmark = pytest.mark.host


def test_a_node_started_from_a_bare_shell_is_the_one_cause(laptop: Laptop) -> None:
    with laptop.node(laptop.plain) as pid:
        _, told = laptop.doctor()
    (finding,) = told["findings"]
    assert finding["id"] == "process-multicast-only"
    assert "talker" in finding["cause"]
    assert pid > 0
    assert laptop.named() == []


def test_a_node_that_asks_an_address_that_the_robot_does_not_have_is_the_one_cause(laptop: Laptop) -> None:
    with laptop.node({**laptop.sourced, "ROS_DISCOVERY_SERVER": "10.42.0.7:11811"}):
        causes = laptop.named()
    # The profile that the node names points elsewhere than its variable: both lines are wrong for it, and both are told.
    assert causes == ["process-wrong-server"]


@pytest.mark.parametrize(
    ("fields", "cause"),
    [
        ({"default": "false"}, "profile-not-default"),
        ({"protocol": "CLIENT"}, "profile-not-super-client"),
        ({"prefix": "44.53.07.5f.45.50.52.4f.53.49.4d.41"}, "profile-wrong-prefix"),
        ({"address": "192.168.42.1"}, "profile-wrong-address"),
    ],
)
def test_each_fault_of_the_profile_is_the_one_cause(laptop: Laptop, fields, cause) -> None:
    (laptop.own / "fastdds_super_client.xml").write_text(profile(**fields))
    assert laptop.named() == [cause]


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        (profile()[:400], "profile-unreadable"),
        (profile().replace("RemoteServer", "OtherServer"), "profile-without-server"),
    ],
    ids=["torn", "without a server"],
)
def test_a_profile_that_names_no_server_is_the_one_cause(laptop: Laptop, text, cause) -> None:
    (laptop.own / "fastdds_super_client.xml").write_text(text)
    assert laptop.named() == [cause]


def test_each_fault_of_the_shell_is_the_one_cause(laptop: Laptop) -> None:
    assert laptop.named(env=laptop.plain) == ["shell-multicast-only"]
    assert laptop.named(env={**laptop.sourced, "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}) == ["shell-rmw-mismatch"]
    for file in laptop.own.iterdir():
        file.unlink()
    (laptop.home / ".bashrc").write_text("# a shell\n")
    assert laptop.named(env=laptop.plain) == ["dds-not-set-up"]


def test_a_daemon_of_an_older_set_up_is_the_one_cause(laptop: Laptop) -> None:
    # No ros2 command comes with the wheels: a node under the daemon's arguments.
    with laptop.node({**laptop.sourced, "ROS_DISCOVERY_SERVER": "192.168.42.1:11811"}, "ros2cli.daemon"):
        assert laptop.named() == ["stale-daemon"]
    assert laptop.named() == []


def test_the_wrong_source_order_is_the_one_cause(laptop: Laptop) -> None:
    hooks = laptop.home / "mirte_ws" / "install" / "share" / "mirte_bringup" / "environment"
    hooks.mkdir(parents=True)
    (hooks / "fastdds.sh").write_text("unset ROS_DISCOVERY_SERVER FASTRTPS_DEFAULT_PROFILES_FILE\n")
    (hooks.parents[2] / "setup.bash").write_text(". ~/mirte_ws/install/share/mirte_bringup/environment/fastdds.sh\n")
    (laptop.home / ".bashrc").write_text(". ~/.config/lupin/ros-env.sh\nsource ~/mirte_ws/install/setup.bash\n")
    wiped = {**laptop.plain, "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
    assert laptop.named(env=wiped) == ["source-order"]
