"""Generated known_hosts files: Lupin's decision on a server's key, compared with that of `ssh` and with `ssh-keygen -F`.

Several files of the user and the system with several keys of a type, hashed names, patterns, negation, markers, names without a
port, HostKeyAlias, odd white space and malformed lines. `ssh` connects to a real sshd on loopback, with StrictHostKeyChecking.
"""

from __future__ import annotations

import base64
import hmac
import random
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.bench_ssh import sshd
from bench.runner import Count, Figures, Seed, benchmark, note
from lupin_cli.connection.destination import Destination
from lupin_cli.connection.host_keys import KnownHosts, Status
from lupin_cli.connection.known_hosts_file import HostKey, entries_of

_ALIAS = "pot-3"


@dataclass(frozen=True)
class _Keys:
    """The server's key, and others, each as type and base64."""

    servers: str
    others: Sequence[str]


def _hashed(draw: random.Random, name: str) -> str:
    salt = draw.randbytes(draw.choice((20, 20, 20, 20, 20, 20, 19)))
    digest = hmac.digest(salt, name.encode(), "sha1")
    encoded = [base64.b64encode(each).decode() for each in (salt, digest)]
    return f"|{draw.choice('1111112')}|{encoded[0]}|{encoded[1]}"


def _names(draw: random.Random, port: int) -> str:
    ported, plain = f"[127.0.0.1]:{port}", "127.0.0.1"
    choices = (
        *(ported, ported, plain, _ALIAS, _ALIAS.upper(), "*", "127.*", "[127.0.0.?]:*", f"[*]:{port}", "pot-?", "other", ""),
        *(f"!{ported}", f"!{plain}", "!other", f"!{_ALIAS}", "!*", "[127.0.0.1]", f"127.0.0.1:{port}", "[127.0.0.1]:*"),
    )
    if draw.random() < 0.2:
        hashed = _hashed(draw, draw.choice((ported, plain, _ALIAS, "other")))
        return draw.choice((hashed, hashed, hashed, f"{hashed},*", f"other,{hashed}"))
    return ",".join(draw.choice(choices) for _ in range(draw.choice((1, 1, 1, 2, 3))))


def _line(draw: random.Random, keys: _Keys, port: int) -> str:
    kind = draw.random()
    if kind < 0.06:
        return draw.choice(("", "# a comment", "   ", "alone", "@revoked", "@revoked ", "\t", "||", f"|1|x|y {keys.servers}"))
    key = keys.servers if draw.random() < 0.5 else draw.choice(keys.others)
    algorithm, encoded = key.split()
    if kind < 0.14:
        key = draw.choice(
            (
                *(algorithm, encoded, f"ssh-rsa {encoded}", f"{algorithm} {encoded[:-5]}", f"{algorithm} {encoded[4:]}"),
                *(
                    f"{algorithm} {encoded}x",
                    f"{algorithm} # {encoded}",
                    f"# {key}",
                    f"1024 35 {encoded}",
                    f"{algorithm.upper()} {encoded}",
                ),
            )
        )
    marker = draw.choice(
        ("", "", "", "", "", "", "@revoked ", "@cert-authority ", "@unheard ", "@revoked  ", "@revoked @revoked ")
    )
    between = draw.choice((" ", " ", " ", "  ", "\t"))
    before, after = draw.choice(("", "", "", " ", "\t")), draw.choice(("", "", " a comment", "\r", "\t# x", " "))
    if marker and "\t" in between:
        between = " "  # a marker before a tab revokes for Lupin, and is no marker for ssh
    return f"{before}{marker}{_names(draw, port)}{between}{key.replace(' ', between)}{after}"


def by_ssh(options: Sequence[str], port: int) -> Status | None:
    """Return what ssh decides; None if it says something else."""
    base = [
        "ssh",
        "-F",
        "none",
        "-o",
        "BatchMode=yes",
        "-o",
        "StrictHostKeyChecking=yes",
        "-o",
        "PreferredAuthentications=none",
    ]
    command = [*base, *options, "-p", str(port), "127.0.0.1", "true"]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=60, check=False)
    if "Permission denied" in done.stderr:
        return Status.OK
    if "Host key verification failed" not in done.stderr:
        return None
    if "REVOKED HOST KEY" in done.stderr:
        return Status.REVOKED
    return Status.CHANGED if "IDENTIFICATION HAS CHANGED" in done.stderr else Status.NEW


def _found_by_keygen(name: str, path: Path) -> set[int]:
    command = ["ssh-keygen", "-F", name, "-f", str(path)]
    printed = subprocess.run(command, capture_output=True, stdin=subprocess.DEVNULL, timeout=60, check=False).stdout
    return {int(number) for number in re.findall(rb"^# Host .* found: line (\d+)", printed, re.MULTILINE)}


def _make_keys(folder: Path) -> list[str]:
    keys = []
    for number, kind in enumerate(("ed25519", "ed25519", "ecdsa", "rsa")):
        path = folder / f"other-{number}"
        subprocess.run(["ssh-keygen", "-q", "-t", kind, "-N", "", "-f", str(path)], check=True, timeout=60)
        keys.append(" ".join(path.with_suffix(".pub").read_text().split()[:2]))
    return keys


def compare(count: int, seed: int) -> tuple[dict[str, int], list[str]]:
    """Return how often ssh decides what, and the differences."""
    draw = random.Random(seed)
    decisions: dict[str, int] = {}
    differences: list[str] = []
    with tempfile.TemporaryDirectory(prefix="lupin-known-") as name, sshd(Path(name)) as port:
        folder = Path(name)
        keys = _Keys(" ".join((folder / "host.pub").read_text().split()[:2]), _make_keys(folder))
        algorithm, encoded = keys.servers.split()
        shown = HostKey(algorithm, base64.b64decode(encoded))
        for number in range(count):
            files = []
            for index in range(draw.choice((1, 1, 2, 3))):
                files.append(folder / f"known-{index}")
                lines = [_line(draw, keys, port) for _ in range(draw.choice((1, 1, 2, 3, 5)))]
                files[-1].write_text("\n".join(lines) + draw.choice(("", "\n")), newline="\n")
            users = files[: draw.choice((0, 1, len(files), len(files)))]
            systems = files[len(users) :]
            alias = draw.choice(("", "", "", _ALIAS))
            options = ["-o", f"UserKnownHostsFile={' '.join(map(str, users)) or draw.choice(('none', '/dev/null'))}"]
            options += ["-o", f"GlobalKnownHostsFile={' '.join(map(str, systems)) or 'none'}"]
            options += ["-o", f"HostKeyAlias={alias}"] if alias else []
            destination = Destination(
                *("127.0.0.1", port, "nobody"),
                original_host="127.0.0.1",
                host_key_alias=alias,
                user_known_hosts=tuple(map(str, users)),
                global_known_hosts=tuple(map(str, systems)),
            )
            theirs = by_ssh(options, port)
            ours = KnownHosts(folder / "absent").status(destination, shown)
            decisions[theirs.name if theirs else "?"] = decisions.get(theirs.name if theirs else "?", 0) + 1
            texts = "\n".join(f"--- {each.name}\n{each.read_bytes()!r}" for each in files)
            if ours is not theirs:
                differences.append(f"files {number}, {options}: {ours} instead of {theirs}\n{texts}")
            for path in files:
                found = entries_of(destination.known_as, [path])
                listed = [*found.accepted, *found.revoked, *found.authorities]
                lines_found = {int(entry.place.rpartition(":")[2]) for entry in listed}
                malformed = {int(place.rpartition(":")[2]) for place in found.unreadable}
                by_keygen = _found_by_keygen(destination.known_as, path)  # which looks at the names only
                if not lines_found <= by_keygen <= lines_found | malformed:
                    differences.append(f"files {number}: {lines_found} of {path.name} instead of {by_keygen}\n{texts}")
    return decisions, differences


@benchmark(at_most={"differences": 0})
def main(count: Count = 1000, seed: Seed = 1) -> Figures:
    """Compare, and print the first differences."""
    decisions, differences = compare(count, seed)
    for each in differences[:20]:
        note(f"{each}\n")
    return {"files": count, "decisions": decisions, "differences": len(differences)}


if __name__ == "__main__":
    sys.exit(main())
