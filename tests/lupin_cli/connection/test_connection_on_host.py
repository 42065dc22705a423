"""The `Target` protocol on the booted robot: sudo, pulled cables, full disks, reboots."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from lupin_cli.connection.base import AuthenticationFailed, RootRefused, Script, TargetError, Unreachable
from lupin_cli.connection.destination import Destination
from lupin_cli.connection.host_keys import KnownHosts
from lupin_cli.connection.ssh import SshTarget
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from lupin_sim.host import Host

pytestmark = pytest.mark.host


@contextmanager
def ssh_target(
    host: Host, *, address: str = "", sudo_password: str | None = None, timeout_s: float = 5.0
) -> Iterator[SshTarget]:
    """Yield a target for the robot, on the laptop's network."""
    destination = Destination(address or host.robot.eth0, 22, "mirte", (str(host.key),), identities_only=True)
    known_hosts = KnownHosts(Path("/nonexistent"), user_file=Path(host.known_hosts))
    target = SshTarget("robot", destination, known_hosts, sudo_password=sudo_password, connect_timeout_s=timeout_s)
    with host.on_laptop():
        try:
            yield target
        finally:
            target.close()


def test_root_scripts_run_as_root_and_others_as_the_user(host: Host) -> None:
    with ssh_target(host) as target:
        outputs = target.batch([Script("root", "id -u; head -n 1 /etc/shadow | wc -l", root=True), Script("user", "id -un")])
        assert outputs["root"].stdout == "0\n1\n" and outputs["user"].stdout == "mirte\n"
        ran = target.run("id -u; cat", root=True, stdin=b"lupin-begins\nmore")
        assert ran.stdout == "0\nlupin-begins\nmore" and ran.stderr == ""


def test_root_file_is_written_and_read_byte_for_byte(fresh_host: Host) -> None:
    data = os.urandom(200_000)
    with ssh_target(fresh_host) as target:
        target.put("/etc/lupin.test", data, mode=0o600, root=True)
        assert target.get("/etc/lupin.test", root=True) == data
        assert target.run("stat -c '%U %a' /etc/lupin.test").stdout == "root 600\n"
        with pytest.raises(TargetError, match="Permission denied"):
            target.get("/etc/lupin.test")
        with pytest.raises(TargetError, match=r"could not write /etc/lupin\.other: .*Permission denied"):
            target.put("/etc/lupin.other", data)
        target.put("~/it's mine", b"text")
        assert target.get("~/it's mine") == b"text"


def test_sudo_password_is_accepted_only_if_it_is_right(fresh_host: Host) -> None:
    fresh_host.robot.inject_fault("sudo-password")
    scripts = [Script("root", "id -u; cat", root=True), Script("user", "echo fine")]
    for password, expected in (("mirte_mirte", "0\n"), (None, ""), ('it\'s "wrong"', "")):
        with ssh_target(fresh_host, sudo_password=password) as target:
            outputs = target.batch(scripts, timeout_s=20)
            assert outputs["root"].stdout == expected and outputs["user"].stdout == "fine\n"
            if expected:
                # sudo may remember the password now, and must not pass it on as a script or its input.
                assert target.batch(scripts, timeout_s=20)["root"].stdout == expected
                assert target.run("id -u; cat", root=True, stdin=b"given").stdout == "0\ngiven"
                target.put("/etc/lupin.test", b"data", root=True)
            else:
                assert outputs["root"].status is None and outputs["root"].stderr.startswith("root refused: sudo: ")
                with pytest.raises(RootRefused, match="sudo: "):
                    target.put("/etc/lupin.test", b"data", root=True)


def test_password_that_sudo_does_not_need_is_discarded(host: Host) -> None:
    with ssh_target(host, sudo_password="echo leaked; exit 9") as target:
        outputs = target.batch([Script("root", "id -u", root=True)])
        assert (outputs["root"].status, outputs["root"].stdout) == (0, "0\n")
        assert target.run("cat", root=True, stdin=b"given").stdout == "given"


def test_user_without_sudo_rights_gets_root_refused(fresh_host: Host) -> None:
    fresh_host.robot.inject_fault("sudo-refused")
    with ssh_target(fresh_host, sudo_password="mirte_mirte") as target:
        assert "root refused" in target.batch([Script("root", "id", root=True)], timeout_s=20)["root"].stderr
        with pytest.raises(RootRefused):
            target.run("id", root=True)


def test_sudo_password_is_in_no_command_line_or_environment(fresh_host: Host) -> None:
    fresh_host.robot.inject_fault("sudo-password")
    with ssh_target(fresh_host, sudo_password="mirte_mirte") as target:
        search = "cat /proc/[0-9]*/cmdline /proc/[0-9]*/environ 2>/dev/null | tr '\\0' '\\n' | grep -c mirte_mirt[e]"
        outputs = target.batch([Script("root", search, root=True), Script("user", search)], timeout_s=20)
        assert outputs["root"].stdout == outputs["user"].stdout == "0\n"
        assert target.run(search, root=True).stdout == "0\n"


def test_pulled_cable_ends_batch_at_its_timeout(fresh_host: Host) -> None:
    with ssh_target(fresh_host, timeout_s=1.5) as target:
        target.connect()
        cut = threading.Timer(5.0, fresh_host.robot.inject_fault, ("cable-cut",), {"link": "eth0"})
        cut.start()
        outputs = target.batch([Script("early", "echo early"), Script("late", "sleep 9; echo late", 20.0)], timeout_s=12)
        assert outputs["early"].stdout == "early\n" and outputs["late"].status is None
        cut.join()
    with ssh_target(fresh_host, timeout_s=1.5) as target, pytest.raises(Unreachable) as caught:
        target.connect()
    assert caught.value.kind in ("timeout", "no-route")
    with ssh_target(fresh_host, address=fresh_host.robot.wlan0) as target:
        assert target.batch([Script("by radio", "echo fine")])["by radio"].stdout == "fine\n"


def test_target_reconnects_after_robot_reboots_during_run(fresh_host: Host) -> None:
    with ssh_target(fresh_host, timeout_s=2.0) as target:
        before = target.run("cat /proc/sys/kernel/random/boot_id").stdout
        assert target.run("systemctl reboot; sleep 60", root=True, timeout_s=30).status is None
        kinds = set()

        def is_back() -> bool:
            try:
                after = target.batch([Script("id", "cat /proc/sys/kernel/random/boot_id")], timeout_s=5)["id"].stdout
            except Unreachable as error:
                kinds.add(error.kind)
                return False
            return after not in ("", before)

        wait_until(is_back, lambda: f"the robot after its reboot: {kinds}")
        assert kinds <= {"timeout", "refused", "lost", "silent", "no-route"}


def test_batch_works_on_full_and_read_only_disks_and_put_fails(fresh_host: Host) -> None:
    with ssh_target(fresh_host) as target:
        target.put("~/file", b"old")
        mounted = target.run(
            "mkdir -p /mnt/small && mount -t tmpfs -o size=64k none /mnt/small && chmod 777 /mnt/small", root=True
        )
        assert mounted.ok, mounted.stderr
        for root in (False, True):
            target.put("/mnt/small/file", b"old", root=root)
            with pytest.raises(TargetError, match="No space left"):
                target.put("/mnt/small/file", b"x" * 200_000, root=root)
            assert target.get("/mnt/small/file") == b"old"
        assert target.run("ls /mnt/small").stdout == "file\n"
        assert target.run("mount -o remount,ro none /mnt/small", root=True).ok
        with pytest.raises(TargetError, match="Read-only file system"):
            target.put("/mnt/small/file", b"new", root=True)
        # No temporary file can be written anywhere now; a batch still works.
        assert target.run("mount --bind /mnt/small /tmp && mount --bind /mnt/small /dev/shm", root=True).ok
        assert target.batch([Script("fine", "echo fine"), Script("root", "id -u", root=True)])["root"].stdout == "0\n"


def test_robot_without_python_and_with_chatty_shell_answers(fresh_host: Host) -> None:
    chatter = (
        "sed -i '1i echo 0 s 0 0 0 0; echo noise >&2; cd /; export LC_ALL=nl_NL.UTF-8 TZ=Asia/Kolkata' /home/mirte/.bashrc"
    )
    done = fresh_host.robot.run_as_root("sh", "-c", f"{chatter}; mv /usr/bin/python3 /usr/bin/python3.gone")
    assert done.status == 0, done.stderr
    with ssh_target(fresh_host) as target:
        outputs = target.batch([Script("language", "echo $LC_ALL"), Script("none", "command -v python3")])
        assert outputs["language"].stdout == "C\n" and outputs["none"].status != 0
        ran = target.run("echo said; echo complained >&2")
        assert (ran.stdout, ran.stderr) == ("said\n", "complained\n")
        target.put("~/file", b"data")
        assert target.get("~/file") == b"data"


def test_password_is_asked_for_without_a_key(host: Host) -> None:
    destination = Destination(host.robot.eth0, 22, "mirte", (), identities_only=True)
    known_hosts = KnownHosts(Path("/nonexistent"), user_file=Path(host.known_hosts))
    asked: list[str] = []

    def answering(password: str) -> Callable[[str], str]:
        return lambda prompt: asked.append(prompt) or password  # type: ignore[func-returns-value]

    with host.on_laptop():
        target = SshTarget("robot", destination, known_hosts, ask_password=answering("mirte_mirte"))
        assert target.batch([Script("who", "id -un")])["who"].stdout == "mirte\n"
        target.close()
        for ask in (answering("wrong"), None):
            with pytest.raises(AuthenticationFailed) as caught:
                SshTarget("robot", destination, known_hosts, ask_password=ask).connect()
            assert "ssh-copy-id mirte@10.42.0.1" in caught.value.next_command
    assert len(asked) == 2 and "mirte@10.42.0.1" in asked[0]
