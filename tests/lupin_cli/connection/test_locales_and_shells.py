"""Unusual locales, time zones, login shells and file names on both machines change no result."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.connection.base import Script, TargetError
from lupin_cli.connection.destination import Destination
from lupin_cli.connection.host_keys import KnownHosts
from lupin_cli.connection.ssh import SshTarget
from lupin_sim.host import Host
from lupin_sim.host.host import PROJECT
from lupin_sim.host.operator import create_home

pytestmark = pytest.mark.host

# A robot that its owner has customized: locales that are not installed, the time zone UTC+05:45, banners and messages
# everywhere, and a custom login shell.
CUSTOMIZE = r"""
set -e
cp /home/mirte/.bashrc /run/bashrc.before
cp -P /etc/localtime /run/localtime.before 2>/dev/null || true
ln -sfn /usr/share/zoneinfo/Asia/Kathmandu /etc/localtime
printf 'LANG=de_DE.UTF-8\nLC_ALL=zh_CN.GB18030\n' > /etc/default/locale
printf 'Banner /etc/issue.net\nAcceptEnv LANG LC_* TZ\n' > /etc/ssh/sshd_config.d/odd.conf
printf 'Willkommen zu Hause \360\237\214\261\n%0500d\n' 7 > /etc/issue.net
sed -i '1i export LANG=tr_TR.UTF-8 LC_ALL=zz_ZZ.UTF-8 TZ=Asia/Kathmandu CDPATH=/ POSIXLY_CORRECT=1' /home/mirte/.bashrc
sed -i '2i echo "\xc7\xd0 $(date)"; echo noise >\&2; cd /; alias ls="ls -l" cat="cat -n"; set -o noclobber' /home/mirte/.bashrc
printf '#!/bin/sh\necho "this is my shell"\nexec /bin/bash "$@"\n' > /usr/local/bin/my-shell
chmod 755 /usr/local/bin/my-shell
usermod --shell /usr/local/bin/my-shell mirte
systemctl restart ssh
"""
RESTORE = r"""
set -e
cp /run/bashrc.before /home/mirte/.bashrc
rm -f /etc/localtime /etc/default/locale /etc/ssh/sshd_config.d/odd.conf
[ ! -e /run/localtime.before ] || cp -P /run/localtime.before /etc/localtime
usermod --shell /bin/bash mirte
systemctl restart ssh
"""
UNUSUAL_ENVIRONMENT = {"LANG": "tr_TR.UTF-8", "LC_ALL": "de_DE.ISO-8859-1", "LANGUAGE": "zh_CN:de", "TZ": "Asia/Kathmandu"}


def run_on_robot(host: Host, script: str) -> None:
    done = host.robot.run_as_root("sh", "-c", script)
    assert done.status == 0, done.stderr


@contextmanager
def ssh_target(host: Host) -> Iterator[SshTarget]:
    destination = Destination(host.robot.eth0, 22, "mirte", (str(host.key),), identities_only=True)
    target = SshTarget("robot", destination, KnownHosts(Path("/nonexistent"), user_file=Path(host.known_hosts)))
    with host.on_laptop():
        try:
            yield target
        finally:
            target.close()


@pytest.fixture
def customized_host(host: Host) -> Iterator[Host]:
    run_on_robot(host, CUSTOMIZE)
    host.robot.wait_ready()
    yield host
    run_on_robot(host, RESTORE)
    host.robot.wait_ready()


def lupin_on(host: Host, home: Path, extra: dict[str, str]) -> Callable[..., Any]:
    """Return a function that runs `lupin WORDS --json` with that home directory; it returns the exit status and the JSON."""
    plain = {"PATH": "/usr/bin:/bin:/usr/sbin:/sbin", **create_home(host, home)}

    def invoke(*words: str) -> Any:
        command = [sys.executable, "-m", "lupin_cli.app", *words, "--json"]
        done = host.run(command, env={**plain, **extra}, cwd=str(PROJECT), timeout_s=90.0)
        assert done.stdout, done.stderr
        return done.returncode, json.loads(done.stdout)

    return invoke


def summarize(result: tuple[int, Any]) -> tuple[int, list[str], list[Any], list[Any]]:
    exit_status, diagnosis = result
    return exit_status, sorted(f["id"] for f in diagnosis["findings"]), diagnosis["unknown"], diagnosis["broken"]


def test_locale_zone_and_shell_do_not_change_doctor_or_clock(host: Host, tmp_path: Path) -> None:
    expected = summarize(lupin_on(host, tmp_path / "home", {})("doctor"))
    run_on_robot(host, CUSTOMIZE)
    host.robot.wait_ready()
    try:
        lupin = lupin_on(host, tmp_path / "my häuschen 家's", UNUSUAL_ENVIRONMENT)
        customized = summarize(lupin("doctor"))
        exit_status, clock = lupin("sync-clock", "--robot", "mirte", "--dry-run")
    finally:
        run_on_robot(host, RESTORE)
        host.robot.wait_ready()
    assert customized == expected
    assert exit_status == 0 and clock["done"] == "nothing" and abs(clock["before"]["offset_s"]) < 1.0


def test_target_works_with_chatty_shell_and_foreign_locale(customized_host: Host) -> None:
    with ssh_target(customized_host) as target:
        # `cat` shows that a script's standard input is empty: it returns at once and prints nothing.
        outputs = target.batch([Script("user", "ls -d /etc/passwd; cat; date +%Z"), Script("root", "id -un", root=True)])
        assert outputs["user"].stdout.splitlines()[0] == "/etc/passwd" and outputs["root"].stdout == "root\n"
        ran = target.run('read word; echo "got $word"; echo fine >&2; rm /nonexistent', stdin="wörter\n".encode())
        assert (ran.stdout, ran.stderr.splitlines()) == (
            "got wörter\n",
            ["fine", "rm: cannot remove '/nonexistent': No such file or directory"],
        )
        for root in (False, True):
            target.put("/tmp/ein name's 家", b"\xff\0data", root=root)
            assert target.get("/tmp/ein name's 家", root=root) == b"\xff\0data"
            assert target.run('rm "/tmp/ein name\'s 家"', root=root).ok


@pytest.mark.parametrize("line", ["exec python3", "exec sh", "exit 0", "exit 3"])
def test_bashrc_that_replaces_the_shell_is_reported(host: Host, line: str) -> None:
    run_on_robot(host, f"cp -p /home/mirte/.bashrc /run/bashrc.before; sed -i '1i {line}' /home/mirte/.bashrc")
    try:
        with ssh_target(host) as target:
            for call in (
                lambda: target.run("echo done"),
                lambda: target.run("echo done", root=True),
                lambda: target.batch([Script("a", "echo a")]),
            ):
                try:
                    output = call()
                except TargetError as error:
                    assert "login shell of mirte" in str(error) and "[ -t 0 ]" in str(error)
                else:  # `exec sh` reads commands from its input, so the program ran
                    assert line == "exec sh"
                    assert (output["a"].stdout if isinstance(output, dict) else output.stdout) in ("a\n", "done\n")
    finally:
        run_on_robot(host, "cp -p /run/bashrc.before /home/mirte/.bashrc")
