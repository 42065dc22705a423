"""The SSH configuration as `ssh -G` resolves it, and what differs: $HOME, the default user, an older client, or none."""

from __future__ import annotations

import json
import os
import pwd
import shutil
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bench.bench_ssh_config import compare
from lupin_cli.app import app
from lupin_cli.connection import ssh_client, ssh_config
from lupin_cli.connection.base import SshConfigUnusable
from lupin_cli.connection.destination import Destination, resolve
from lupin_cli.connection.ssh_config_words import ConfigError, parse_hop

BLOCK = "Host greenhouse\n  HostName 10.9.8.7\n  Port 2200\n  User anna\n"
PLACE = ("10.9.8.7", 2200, "anna")
WriteConfig = Callable[..., Path]


@pytest.fixture
def write_config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> WriteConfig:
    """Return a function that writes the user's file, and further ones beside it, below a home of its own."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(ssh_client, "_said", set())

    def write(text: str, **others: str) -> Path:
        for name, content in {"config": text, **others}.items():
            path = tmp_path / ".ssh" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content)
            path.chmod(0o600)
        return tmp_path / ".ssh"

    return write


def place_of(host: str = "greenhouse") -> tuple[str, int, str]:
    found = resolve(host, default_user="mirte")
    return found.host, found.port, found.user


@pytest.fixture(params=["client", "reader"])
def either_way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Resolve by the client, then by Lupin's own reader."""
    if request.param == "reader":
        monkeypatch.setattr("lupin_cli.connection.ssh_client.shutil.which", lambda _: None)
    return str(request.param)


@pytest.mark.usefixtures("either_way")
@pytest.mark.parametrize(
    "lines",
    [
        BLOCK + "Match final all\n  ServerAliveInterval 7\n",
        BLOCK + "Match canonical all\n  Compression yes\n",
        BLOCK + "Host *\n  CanonicalizeHostname yes\n",
        BLOCK + "Host *\n  CanonicalizeHostname always\n  CanonicalizeFallbackLocal no\n",
        BLOCK.replace("Host greenhouse", "Match host=greenhouse"),
        BLOCK.replace("Host greenhouse", 'Match originalhost="pot,green*"'),
        BLOCK.replace("greenhouse\n", '"greenhouse" # mine\n').replace("Port ", "pOrT\t= "),
        "\ufeff" + BLOCK.replace("\n", "\r\n"),
        "IgnoreUnknown UseKeychain\nUseKeychain yes\n" + BLOCK,
        "Include parts/*\n" + BLOCK,
        "Include ~nobody-here/x none-*\n" + BLOCK,
        "Host pot\n  Include parts/*\n" + BLOCK,
    ],
)
def test_valid_lines_resolve_in_either_way(write_config: WriteConfig, lines: str) -> None:
    write_config(lines, other="")
    (Path.home() / ".ssh/parts/a folder").mkdir(parents=True)
    os.mkfifo(Path.home() / ".ssh/parts/fifo")
    (Path.home() / ".ssh/parts/dangling").symlink_to("nowhere")
    assert place_of() == PLACE


@pytest.mark.usefixtures("either_way")
@pytest.mark.parametrize(
    "criterion", ["localnetwork 192.0.2.0/24", "tagged office", "version *", "sessiontype shell", "command x"]
)
@pytest.mark.parametrize("mark", ["", "!"])
def test_unknown_criterion_never_holds_and_is_named_once(
    write_config: WriteConfig, criterion: str, mark: str, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = subprocess.run(["ssh", "-G", "-F", "/dev/stdin", "x"], input=f"Match {criterion}\n", capture_output=True, text=True)
    if "Unsupported Match attribute" not in asked.stderr:
        criterion = "weather sunny"  # this ssh knows the other one
    name = criterion.split()[0]
    folder = write_config(f"Match {mark}{criterion} !host gate\n  User office\n  ProxyJump gate\n{BLOCK}")
    for _ in range(2):
        found = resolve("greenhouse", default_user="mirte")
        assert (found.user, found.jumps) == ("anna", ())
    complaint = capsys.readouterr().err
    assert complaint.count(f"{folder}/config:1: the Match criterion {name}") == 1


@pytest.mark.usefixtures("either_way")
def test_option_of_later_openssh_is_left_out(write_config: WriteConfig) -> None:
    write_config(f"WarnWeakCrypto no\nTag office\n{BLOCK}")
    assert place_of() == PLACE


@pytest.mark.usefixtures("either_way")
@pytest.mark.parametrize(
    ("lines", "complaint"),
    [
        ("Usr anna\n", r"config:1: Bad configuration option: usr"),
        ("\nPort x\n", r"config:2: Bad port 'x'"),
        ("User 'anna\n", r"config:1: invalid quotes"),
        ("Match host\n", r"config:1: .*Missing Match criteria for host"),
        ("Include more\n", r"more:1: Bad configuration option: usr"),
        ("Match canonical final all\n", r"config:1: .*cannot be combined"),
        ("Match all host x\n", r"config:1: .*cannot be combined"),
    ],
)
def test_refused_line_is_named_with_file_and_remedy(write_config: WriteConfig, lines: str, complaint: str) -> None:
    folder = write_config(lines, more="Usr anna\n")
    with pytest.raises(SshConfigUnusable, match=complaint) as caught:
        resolve("greenhouse")
    assert caught.value.next_command == f"ssh -F {folder}/config -G greenhouse"


def test_binary_file_is_refused_in_one_short_line(write_config: WriteConfig) -> None:
    folder = write_config("Include more\n", more="")
    (folder / "more").write_bytes(bytes(range(128, 256)) * 8 + b"\n\x01\n" + bytes(range(128, 256)))
    with pytest.raises(SshConfigUnusable, match=rf"^greenhouse cannot be resolved: {folder}/more:1: .*, and 2 more") as caught:
        resolve("greenhouse")
    assert len(str(caught.value)) < 600 and "\n" not in str(caught.value)


@pytest.mark.usefixtures("either_way")
def test_user_that_is_not_utf8_is_refused(write_config: WriteConfig) -> None:
    (write_config("") / "config").write_bytes(b"User gr\xfcn\n")
    with pytest.raises(SshConfigUnusable):
        resolve("greenhouse")


@pytest.mark.usefixtures("either_way")
def test_config_that_others_may_write_is_refused(write_config: WriteConfig) -> None:
    (write_config(BLOCK) / "config").chmod(0o666)
    with pytest.raises(SshConfigUnusable, match="chmod go-w"):
        resolve("greenhouse")


@pytest.mark.usefixtures("either_way")
def test_final_block_wins_over_defaults(write_config: WriteConfig) -> None:
    write_config("Match final\n  UserKnownHostsFile /dev/null\n  User anna\n")
    found = resolve("greenhouse", default_user="mirte")
    assert (found.user, found.user_known_hosts) == ("anna", ("/dev/null",))


@pytest.mark.usefixtures("either_way")
def test_home_variable_decides_over_password_file(write_config: WriteConfig) -> None:
    home = write_config(
        "Include parts\n", parts=f"{BLOCK} IdentityAgent ~/a\n IdentityFile %d/k\n UserKnownHostsFile ~/b ~/c\n"
    ).parent
    found = resolve("greenhouse")
    assert (found.identity_agent, found.identity_files) == (f"{home}/a", (f"{home}/k",))
    assert found.user_known_hosts == (f"{home}/b", f"{home}/c")
    assert resolve("elsewhere").user_known_hosts == (f"{home}/.ssh/known_hosts", f"{home}/.ssh/known_hosts2")


@pytest.mark.usefixtures("either_way")
def test_user_named_as_this_one_is_not_replaced(write_config: WriteConfig) -> None:
    import getpass

    write_config(f"Host greenhouse\n  User {getpass.getuser()}\n")
    assert resolve("greenhouse", default_user="mirte").user == getpass.getuser()
    assert resolve("pot", default_user="mirte").user == "mirte"
    assert resolve("pot", "anna", default_user="mirte").user == "anna"


@pytest.mark.usefixtures("either_way")
def test_system_file_is_read_after_the_users(
    write_config: WriteConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_config("Host greenhouse\n  User berta\n")
    (tmp_path / "system").write_text(f"Include {tmp_path}/system.d/*\n")
    (tmp_path / "system.d").mkdir()
    (tmp_path / "system.d/robots").write_text(BLOCK)
    monkeypatch.setattr(ssh_config, "SYSTEM_CONFIG", tmp_path / "system")
    assert place_of() == ("10.9.8.7", 2200, "berta")


@pytest.mark.usefixtures("either_way")
def test_hanging_match_exec_is_named(write_config: WriteConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ssh_client, "TIMEOUT_S", 0.5)
    monkeypatch.setattr(ssh_config, "EXEC_TIMEOUT_S", 0.5)
    write_config('Match exec "sleep 60"\n  User x\n')
    with pytest.raises(SshConfigUnusable, match="Match exec"):
        resolve("greenhouse")


@pytest.mark.usefixtures("either_way")
def test_later_hop_ignores_its_own_jump_and_first_has_it(write_config: WriteConfig) -> None:
    write_config("Host robot\n ProxyJump a,b\nHost a\n ProxyJump door\nHost b\n ProxyJump window\n User bea\n")
    assert [hop.original_host for hop in resolve("robot").jumps] == ["door", "a", "b"]
    assert resolve("robot").jumps[2].user == "bea"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("ssh://anna@gate.example:2200/", ("anna", "gate.example", 2200)),
        ("ssh://a%40b@gate", ("a@b", "gate", 0)),
        ("user@corp.example@gate:7", ("user@corp.example", "gate", 7)),
        ("[2001:db8::1]:7", ("", "2001:db8::1", 7)),
    ],
)
def test_hop_is_parsed_as_openssh_does(text: str, expected: tuple[str, str, int]) -> None:
    assert parse_hop(text) == expected


def test_port_of_a_hop_may_be_a_service(monkeypatch: pytest.MonkeyPatch) -> None:
    """As /etc/services names it, which a small system lacks."""
    monkeypatch.setattr("socket.getservbyname", lambda *_: 22)
    assert parse_hop("gate:ssh") == ("", "gate", 22)


@pytest.mark.parametrize("text", ["", "@gate", "gate:x", "gate:0", "ssh://gate/path", "ssh://gate:7/path", "[::1", "a@"])
def test_malformed_hop_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="Invalid ProxyJump"):
        parse_hop(text)


@pytest.mark.usefixtures("either_way")
def test_tokens_of_a_hop_are_those_of_the_robot(write_config: WriteConfig) -> None:
    write_config("Host robot\n User anna\n ProxyJump %r@gate\n")
    assert [str(hop) for hop in resolve("robot").jumps] == ["anna@gate"]


def test_host_like_an_option_is_no_option(write_config: WriteConfig) -> None:
    write_config("")
    with pytest.raises(SshConfigUnusable):
        resolve("-oProxyCommand=touch${IFS}made")
    assert not Path("made").exists()


def test_missing_client_is_said(
    write_config: WriteConfig, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("lupin_cli.connection.ssh_client.shutil.which", lambda _: None)
    write_config(f"{BLOCK}Host pot\n  CanonicalizeHostname yes\n  CanonicalDomains farm.example\n")
    assert place_of() == PLACE
    assert "ssh is not installed" in capsys.readouterr().err
    with pytest.raises(SshConfigUnusable, match="CanonicalDomains needs the ssh client"):
        resolve("pot")


def test_other_program_named_ssh_is_not_asked(
    write_config: WriteConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "ssh").write_text("#!/bin/sh\necho 'ssh: unknown option -- G' >&2\nexit 1\n")
    (tmp_path / "ssh").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    write_config(BLOCK)
    assert place_of() == PLACE
    assert "has no option -G" in capsys.readouterr().err


def test_ssh_reads_the_files_themselves_where_it_can(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = shutil.which("ssh")
    (tmp_path / "ssh").write_text(f'#!/bin/sh\necho "$*" >>{tmp_path}/asked\nexec {real} "$@"\n')
    (tmp_path / "ssh").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    monkeypatch.setenv("HOME", pwd.getpwuid(os.getuid()).pw_dir)
    ssh_client._answer.cache_clear()
    assert resolve("greenhouse.invalid", "anna", 7).user == "anna"
    assert (tmp_path / "asked").read_text() == "-G -l anna -p 7 -- greenhouse.invalid\n"
    assert resolve("greenhouse.invalid", default_user="anna").user == "anna"  # no file names one
    assert "-G -F " in (tmp_path / "asked").read_text().splitlines()[2]


def test_answer_is_kept_within_a_command(write_config: WriteConfig, tmp_path: Path) -> None:
    write_config(f'Match exec "echo x >>{tmp_path}/asked"\n  Port 7\n')
    for _ in range(3):
        assert resolve("greenhouse", "anna").port == 7
    assert (tmp_path / "asked").read_text() == "x\n"


def test_unresolved_robot_hides_no_other(write_config: WriteConfig, tmp_path: Path) -> None:
    write_config("Host pot-1\n  ProxyJump pot-1\n")
    inventory = tmp_path / "lupin.toml"
    inventory.write_text("".join(f'[robots.pot-{n}.addresses]\nwired = "pot-{n}"\n' for n in (1, 2)))
    done = CliRunner().invoke(app, ["robots", "list", "--config", str(inventory), "--json"])
    first, second = json.loads(done.stdout)["robots"]
    assert done.exit_code == 3 and "jumphost loop" in first["error"] and first["destinations"] == {}
    assert second["destinations"] == {"wired": "mirte@pot-2"} and "error" not in second


def test_robots_are_resolved_in_parallel(write_config: WriteConfig) -> None:
    write_config(BLOCK + "Match host pot-3\n  Port 9\n")
    found: dict[int, Destination] = {}

    def put(number: int) -> None:
        found[number] = resolve(f"pot-{number}", default_user="mirte")

    threads = [threading.Thread(target=put, args=(number,)) for number in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [found[number].port for number in range(6)] == [22, 22, 22, 9, 22, 22]


def test_generated_configurations_resolve_as_ssh_does() -> None:
    resolved, differences = compare(150, seed=7)
    assert differences == [] and resolved > 50


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_5000_generated_configurations_resolve_as_ssh_does() -> None:
    resolved, differences = compare(5000, seed=1)
    assert differences == [] and resolved > 2000


def test_reader_names_what_only_the_client_can_do(tmp_path: Path) -> None:
    path = tmp_path / "config"
    path.write_text('"Ciphers"=aes128-ctr\n')
    with pytest.raises(ConfigError, match=r"config:1: .*ciphers needs the ssh client"):
        ssh_config.read("a", "", 0, path, None, tmp_path, lambda _: None)
