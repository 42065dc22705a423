"""Faults of the DDS configuration of either machine beside a booted robot: each is the only root cause.

Only the network checks run, as in test_doctor_on_host.
"""

from __future__ import annotations

from typing import Any

import pytest

from tests.support.laptop import Laptop, render_profile

pytestmark = pytest.mark.host


def test_node_from_unconfigured_shell_is_the_only_root_cause(laptop: Laptop) -> None:
    with laptop.running_node(laptop.bare_env) as pid:
        _, report = laptop.run_doctor()
    (finding,) = report["findings"]
    assert finding["id"] == "process-multicast-only"
    assert "talker" in finding["cause"]
    assert pid > 0
    assert laptop.root_causes() == []


def test_node_with_wrong_server_is_the_only_root_cause(laptop: Laptop) -> None:
    with laptop.running_node({**laptop.sourced_env, "ROS_DISCOVERY_SERVER": "10.42.0.7:11811"}):
        causes = laptop.root_causes()
    # The profile that the node names points to another address than its variable; the evidence shows both.
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
def test_each_profile_fault_is_the_only_root_cause(laptop: Laptop, fields: Any, cause: Any) -> None:
    laptop.profile.write_text(render_profile(**fields))
    assert laptop.root_causes() == [cause]


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        (render_profile()[:400], "profile-unreadable"),
        (render_profile().replace("RemoteServer", "OtherServer"), "profile-without-server"),
    ],
    ids=["truncated", "without a server"],
)
def test_profile_without_server_is_the_only_root_cause(laptop: Laptop, text: Any, cause: Any) -> None:
    laptop.profile.write_text(text)
    assert laptop.root_causes() == [cause]


def test_each_shell_fault_is_the_only_root_cause(laptop: Laptop) -> None:
    assert laptop.root_causes(env=laptop.bare_env) == ["shell-multicast-only"]
    assert laptop.root_causes(env={**laptop.sourced_env, "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}) == ["shell-rmw-mismatch"]
    for file in laptop.config_dir.iterdir():
        file.unlink()
    (laptop.home / ".bashrc").write_text("# the operator's settings\n")
    assert laptop.root_causes(env=laptop.bare_env) == ["dds-not-set-up"]


def test_stale_ros2_daemon_is_the_only_root_cause(laptop: Laptop) -> None:
    # The ROS wheels contain no ros2 command: a node with the daemon's command line stands in for it.
    with laptop.running_node({**laptop.sourced_env, "ROS_DISCOVERY_SERVER": "192.168.42.1:11811"}, "ros2cli.daemon"):
        assert laptop.root_causes() == ["stale-daemon"]
    assert laptop.root_causes() == []


def test_wrong_source_order_is_the_only_root_cause(laptop: Laptop) -> None:
    hooks = laptop.home / "mirte_ws" / "install" / "share" / "mirte_bringup" / "environment"
    hooks.mkdir(parents=True)
    (hooks / "fastdds.sh").write_text("unset ROS_DISCOVERY_SERVER FASTRTPS_DEFAULT_PROFILES_FILE\n")
    (hooks.parents[2] / "setup.bash").write_text(". ~/mirte_ws/install/share/mirte_bringup/environment/fastdds.sh\n")
    (laptop.home / ".bashrc").write_text(". ~/.config/lupin/ros-env.sh\nsource ~/mirte_ws/install/setup.bash\n")
    wiped = {**laptop.bare_env, "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
    assert laptop.root_causes(env=wiped) == ["source-order"]
