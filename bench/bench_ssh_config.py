"""Generated SSH configurations, resolved by Lupin and by `ssh -G`: both must refuse, or answer the same.

Host and Match blocks, includes in includes, negation, quotation marks, comments after values, odd white space, unknown options
with IgnoreUnknown, tokens, wrong values. Lupin answers twice: by its own reader, which it uses without an ssh client, and by
ssh with copies of the files.
"""

from __future__ import annotations

import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.runner import Count, Figures, Seed, benchmark, note
from lupin_cli.connection import ssh_client, ssh_config
from lupin_cli.connection.base import SshConfigUnusable
from lupin_cli.connection.ssh_config_words import ConfigError, parse_hop

HOSTS = ("robot", "pot-1", "pot-2.farm.example", "10.42.0.1", "FE80::1", "Gate", "a_b")
_VALUES: dict[str, tuple[str, ...]] = {
    "HostName": ("10.42.0.1", "%h.farm.example", "Robot.Example", "127.1", "%n", "2001:DB8::1", "%%x", "a b"),
    "User": ("mirte", "user@corp.example", '"two words"', "'single'", "x\\ y", 'a"b"c', "#none", ""),
    "Port": ("22", "2222", "ssh", "0", "65536", "x", "022"),
    "IdentityFile": ("~/.ssh/pot", "%d/id", '"/k e y"', "none", "/k#1", "${HOME}/k", "'/k'"),
    "CertificateFile": ("~/.ssh/pot-cert.pub", "/c"),
    "IdentitiesOnly": ("yes", "no", "YES", "true", "maybe"),
    "IdentityAgent": ("none", "SSH_AUTH_SOCK", "~/agent", "%d/agent", "$SOCK", "/a/%u"),
    "HostKeyAlias": ("Pot-Alias", "none", "a"),
    "UserKnownHostsFile": ("/dev/null", "none", "~/a ~/b", "/a /b /c", "none /a", "%d/known", "'/q'"),
    "GlobalKnownHostsFile": ("/etc/one", "none", "~/g"),
    "StrictHostKeyChecking": ("yes", "no", "ask", "accept-new", "off", "perhaps"),
    "RevokedHostKeys": ("/etc/revoked",),
    "ProxyJump": (
        *("gate", "none", "u@gate:22", "ssh://u@gate:2200/", "a,b,c", "u@corp.example@gate", "[fe80::1]:7", "ssh://gate/x"),
        *("gate:", "@gate", "a,,b", "gate # a comment", "ssh://a%40b@gate", "%r@gate", "10.0.0.1", "None"),
    ),
    "ProxyCommand": ("none", "nc %h %p", "= nc", 'sh -c "a b"', "ssh -W %h:%p gate # kept"),
    "CanonicalizeHostname": ("no", "yes", "always"),
    "CanonicalizeFallbackLocal": ("yes",),
    "ServerAliveInterval": ("20",),
    "Compression": ("yes", "no"),
    "ForwardAgent": ("no",),
    "SendEnv": ("LANG LC_*",),
    "LogLevel": ("QUIET",),
    "Ciphers": ("aes128-ctr",),
    "Frobnicate": ("x", "a b"),
    "UseKeychain": ("yes",),
}
_PATTERNS = ("*", "robot", "pot-*", "pot-?", "!robot", "!pot-*", "10.42.*", "ROBOT", '"robot"', "*.example", "gate", "a_b")
_LISTS = (
    "robot",
    "pot-*,!pot-1",
    "*",
    "!robot,*",
    "*.farm.example",
    "10.42.0.1",
    "ROBOT",
    "mirte,root",
    "root",
    '"pot-1,robot"',
    "*.EXAMPLE",
)


def _spread(draw: random.Random, keyword: str, value: str) -> str:
    """Return a line with odd white space, other letters, an equals sign or a comment."""
    word = draw.choice((keyword, keyword, keyword.lower(), keyword.upper(), f'"{keyword}"'))
    between = draw.choice((" ", " ", " ", "\t", "=", " = ", "  ", "= ", " =", "\t \t"))
    after = draw.choice(("", "", "", "", " ", "\t", "\r", "  # a comment", "\f", " #"))
    return f"{draw.choice(('', '', '    ', chr(9)))}{word}{between}{value}{after}"


def _option(draw: random.Random) -> str:
    keyword = draw.choice(tuple(_VALUES))
    values = _VALUES[keyword]
    value = values[0] if draw.random() < 0.5 else draw.choice(values)
    if draw.random() < 0.06 and " " not in value and '"' not in value and value:
        value = f'"{value}"' if draw.random() < 0.8 else f'"{value}'
    return _spread(draw, keyword, value)


def _match(draw: random.Random) -> str:
    if draw.random() < 0.15:
        return draw.choice(
            (
                "all",
                "!all",
                "final all",
                "canonical all",
                "canonical final all",
                "all host x",
                "ALL",
                "all # x",
                "host robot all",
            )
        )
    words = []
    for _ in range(draw.choice((1, 1, 2, 3))):
        criterion = draw.choice(("host", "originalhost", "user", "localuser", "exec", "final", "canonical", "Host"))
        mark = draw.choice(("", "", "!"))
        if criterion in ("final", "canonical"):
            words.append(f"{mark}{criterion}")
        elif criterion == "exec":
            words.append(f"{mark}exec {draw.choice(('true', 'false', chr(34) + 'test %h = robot' + chr(34)))}")
        else:
            words.append(f"{mark}{criterion}{draw.choice((' ', ' ', '=', '  '))}{draw.choice(_LISTS)}")
    return " ".join(words) + draw.choice(("", "", "", " # a comment", " host", " "))


def write_configuration(draw: random.Random, folder: Path, depth: int = 0) -> Path:
    """Write a configuration, and perhaps files that it includes; return its path."""
    lines: list[str] = ["IgnoreUnknown Frob*,usekeychain"] if draw.random() < 0.6 else []
    path = folder / f"config-{depth}-{draw.randrange(1 << 30)}"
    for _ in range(draw.choice((0, 1, 1, 2, 3))):
        lines += [_option(draw) for _ in range(draw.choice((0, 0, 1, 2)))]
        if draw.random() < 0.35 and depth < 2:
            more = write_configuration(draw, folder, depth + 1)
            pattern = draw.choice((str(more), f'"{more}"', f"{folder}/absent-*", f"{str(more)[:-1]}?", f"{folder} {more}"))
            lines.append(_spread(draw, "Include", pattern))
        kind = draw.random()
        if kind < 0.55:
            lines.append(_spread(draw, "Host", " ".join(draw.choice(_PATTERNS) for _ in range(draw.choice((1, 1, 2, 3))))))
        elif kind < 0.9:
            lines.append(_spread(draw, "Match", _match(draw)))
        lines += [_option(draw) for _ in range(draw.choice((1, 2, 3)))]
        lines += [draw.choice(("", "# a comment", "   ", "#", "\t# x"))] if draw.random() < 0.2 else []
    path.write_text("\n".join(lines) + draw.choice(("", "\n")))
    path.chmod(0o600)
    return path


def by_reader(path: Path, host: str, user: str, port: int) -> dict[str, list[str]] | str | None:
    """Return the reader's answer, or why it refuses; None for what it says that it cannot read."""
    try:
        found = dict(ssh_config.read(host, user, port, path, None, Path.home(), lambda _: None))
    except ssh_config.NeedsClient:
        return None
    except ConfigError as error:
        return str(error)
    return _comparable(found)


def by_copies(path: Path, host: str, user: str, port: int) -> dict[str, list[str]] | str:
    """Return what ssh answers to Lupin, for which it reads copies of the files, or why it refuses."""
    try:
        found = dict(ssh_client.resolve(host, user, port, path=path))
    except SshConfigUnusable as error:
        return str(error)
    return _comparable({key: list(values) for key, values in found.items()})


def by_ssh(path: Path, host: str, user: str, port: int) -> dict[str, list[str]] | str:
    """Return the answer of ssh, or its complaint."""
    words = [*(["-l", user] if user else []), *(["-p", str(port)] if port else [])]
    done = subprocess.run(["ssh", "-G", "-F", str(path), *words, "--", host], capture_output=True, stdin=subprocess.DEVNULL)
    if done.returncode != 0:
        return done.stderr.decode()
    found: dict[str, list[str]] = {}
    for line in done.stdout.decode().split("\n"):
        keyword, _, value = line.partition(" ")
        found.setdefault(keyword, []).append(value)
    for keyword in ("userknownhostsfile", "globalknownhostsfile"):
        found[keyword] = " ".join(found.get(keyword, [])).split()
    return _comparable(found)


def _comparable(found: dict[str, list[str]]) -> dict[str, list[str]]:
    strict = {"true": "yes", "false": "no"}
    single = ("user", "hostname", "port", "hostkeyalias", "identityagent", "proxycommand", "revokedhostkeys")
    result = {keyword: found.get(keyword, []) for keyword in single}
    result["identitiesonly"] = found.get("identitiesonly", ["no"])
    result["stricthostkeychecking"] = [strict.get(each, each) for each in found.get("stricthostkeychecking", ["ask"])]
    for keyword in ("userknownhostsfile", "globalknownhostsfile"):
        result[keyword] = [each for each in found.get(keyword, []) if each.lower() not in ("", "none")]
    identities = found.get("identityfile", [])
    result["identityfile"] = [] if identities[:1] == ["~/.ssh/id_rsa"] else identities
    result["certificatefile"] = found.get("certificatefile", [])
    jumps = found.get("proxyjump", [])
    result["proxyjump"] = [str(parse_hop(hop)) for jump in jumps for hop in jump.split(",")]
    return result


def compare(count: int, seed: int) -> tuple[int, list[str]]:
    """Return how many configurations both resolve, and the differences."""
    draw, resolved, differences = random.Random(seed), 0, []
    for number in range(count):
        with tempfile.TemporaryDirectory(prefix="lupin-config-") as name:
            path = write_configuration(draw, Path(name))
            host, user = draw.choice(HOSTS), draw.choice(("", "", "mirte"))
            port = draw.choice((0, 0, 22022))
            theirs = by_ssh(path, host, user, port)
            ours = by_reader(path, host, user, port)
            resolved += isinstance(theirs, dict) and ours is not None
            for reader, answer in (("reader", ours), ("copies", by_copies(path, host, user, port))):
                if answer is None or answer == theirs or (isinstance(answer, str) and isinstance(theirs, str)):
                    continue
                texts = "\n".join(f"--- {each.name}\n{each.read_text()!r}" for each in sorted(Path(name).iterdir()))
                if isinstance(answer, dict) and isinstance(theirs, dict):
                    wrong = [key for key in answer if answer[key] != theirs[key]]
                    detail = "; ".join(f"{key}: {answer[key]} instead of {theirs[key]}" for key in wrong)
                else:
                    detail = f"{answer} instead of {theirs}"
                differences.append(f"{reader}, configuration {number}, host {host}, user {user!r}: {detail}\n{texts}")
    return resolved, differences


@benchmark(at_most={"differences": 0})
def main(count: Count = 5000, seed: Seed = 1) -> Figures:
    """Compare, and print the first differences."""
    if shutil.which("ssh") is None:
        raise SystemExit("not measured: ssh is not installed; apt install openssh-client")
    resolved, differences = compare(count, seed)
    for each in differences[:20]:
        note(f"{each}\n")
    return {"configurations": count, "resolved": resolved, "refused": count - resolved, "differences": len(differences)}


if __name__ == "__main__":
    sys.exit(main())
