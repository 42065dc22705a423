"""The profile against a real discovery server, in a separate network namespace: only with it, a process sees all topics."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from lupin_cli.link.dds_check import read_exports
from lupin_cli.link.dds_setup import SetupPaths, exports_text, profile_xml
from tests.support.waiting import wait_until

pytestmark = pytest.mark.graph

TOPICS = [f"/plant_{number}" for number in range(20)]
TALKER = f"""
import rclpy, sys
from std_msgs.msg import Empty
rclpy.init()
node = rclpy.create_node("robot")
publishers = [node.create_publisher(Empty, name, 10) for name in {TOPICS!r}]
print("up", flush=True)
sys.stdin.read()
"""
LISTENER = f"""
import json, rclpy, sys, time
rclpy.init()
node = rclpy.create_node("laptop", start_parameter_services=False)
deadline = time.monotonic() + float(sys.argv[1])
while time.monotonic() < deadline:
    seen = {{name for name, _ in node.get_topic_names_and_types()}}
    if seen.issuperset({TOPICS!r}):
        break
    time.sleep(0.05)
print(json.dumps(sorted(seen & set({TOPICS!r}))), flush=True)
import os; os._exit(0)
"""


@pytest.fixture
def namespace() -> Iterator[list[str]]:
    """Yield a command prefix that runs a program in a network namespace with only the loopback interface."""
    if os.geteuid() != 0:
        pytest.skip("needs root: it creates a network namespace")
    name = f"lupin-dds-{os.getpid()}"
    for command in (["add", name], ["exec", name, "ip", "link", "set", "lo", "up"]):
        done = subprocess.run(["ip", "netns", *command], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)
            pytest.skip(
                f"no network namespaces here: {done.stderr.strip()}"
            )  # in a chroot, ip-netns finds no mount to start from
    yield ["ip", "netns", "exec", name]
    subprocess.run(["ip", "netns", "delete", name], check=True)


@pytest.fixture
def bare() -> dict[str, str]:
    """The environment without the variables of ROS and DDS."""
    prefixes = ("ROS_", "RMW_", "FASTRTPS_", "FASTDDS_")
    return {name: value for name, value in os.environ.items() if not name.startswith(prefixes)}


@pytest.fixture
def server(namespace: list[str], bare: dict[str, str]) -> Iterator[None]:
    program = Path(sys.prefix) / "bin" / "fast-discovery-server"
    if not program.exists():
        pytest.skip("needs fast-discovery-server of the ROS wheels")
    site = next((Path(sys.prefix) / "lib").glob("python3*/site-packages"))
    libraries = f"{sys.prefix}/lib:{site}/ros_fastrtps.libs"
    command = [*namespace, str(program), "-i", "0", "-l", "0.0.0.0", "-p", "11811"]
    process = subprocess.Popen(command, env={**bare, "LD_LIBRARY_PATH": libraries}, stdout=subprocess.DEVNULL)

    def listens() -> bool:
        assert process.poll() is None
        return ":11811" in subprocess.run([*namespace, "ss", "-lnu"], capture_output=True, text=True).stdout

    wait_until(listens, "the discovery server")
    yield
    process.terminate()
    process.wait(60)


@pytest.fixture
def talker(server: None, namespace: list[str], bare: dict[str, str]) -> Iterator[None]:  # noqa: ARG001 -- the fixture must have run
    environment = {**bare, "ROS_DISCOVERY_SERVER": "127.0.0.1:11811", "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
    command = [*namespace, sys.executable, "-c", TALKER]
    process = subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout is not None and process.stdin is not None
    assert process.stdout.readline() == b"up\n"
    yield
    process.stdin.close()
    process.wait(60)
    process.stdout.close()


def seen(namespace: list[str], environment: dict[str, str], wait_s: float) -> list[str]:
    command = [*namespace, sys.executable, "-c", LISTENER, str(wait_s)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=wait_s + 60)
    assert done.stdout, done.stderr
    return list(json.loads(done.stdout))


@pytest.mark.usefixtures("talker")
def test_only_process_with_profile_sees_every_topic(namespace: list[str], bare: dict[str, str], tmp_path: Path) -> None:
    paths = SetupPaths(tmp_path, tmp_path / "lupin")
    paths.directory.mkdir()
    paths.profile.write_text(profile_xml("127.0.0.1"))
    found, _ = read_exports(exports_text("127.0.0.1", paths), tmp_path)
    assert seen(namespace, {**bare, **found}, 30.0) == sorted(TOPICS)
    without = {name: value for name, value in found.items() if name != "FASTRTPS_DEFAULT_PROFILES_FILE"}
    assert seen(namespace, {**bare, **without}, 3.0) == []
    assert seen(namespace, bare, 1.0) == []
