"""chrony's configuration is read as chronyd reads it: its own `chronyd -p`, where it is installed, prints the same directives.

The rules of chrony.conf(5), each of which the generated configurations use:
- directives are not case-sensitive, and white space around words does not count;
- a line that begins with ! ; # or % is a comment;
- `include` reads the files that match its pattern, or none; files that nobody includes are not read;
- `confdir` reads *.conf of up to ten folders by name, and of two files with one name that of the first folder;
- `sourcedir` reads *.sources in the same way, and there only server, pool and peer.
"""

from __future__ import annotations

import random
import shutil
import subprocess
from pathlib import Path

import pytest

from lupin_cli.connection.base import Output
from lupin_cli.facts.chrony import CHRONY, Chrony
from lupin_cli.facts.chrony_configuration import READER, comment_out, parse_line

CHRONYD = shutil.which("chronyd", path="/usr/sbin:/usr/bin") or shutil.which("chronyd")
ANY = "[a-z]+"
PLAIN = ("makestep 1 3", "allow 10.42.0.0/24", "local stratum 10", "rtcsync", "server 192.0.2.1 iburst", "maxupdateskew 100.0")
_FOLLOWED = ("include", "confdir")


def lines_of(main: Path, regex: str = ANY) -> list[tuple[str, list[str]]]:
    """Return the file and the words of each directive that the script prints."""
    script = f"{READER}\nchrony_main() {{ echo '{main}'; }}\nchrony_lines '{regex}'"
    done = subprocess.run(["sh", "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert done.stderr == ""
    return [parse_line(line) for line in done.stdout.splitlines()]


class Etc:
    """A folder with generated configuration files."""

    def __init__(self, folder: Path, rng: random.Random) -> None:
        self.folder, self.rng = folder, rng
        for name in ("a.d", "b.d", "empty.d"):
            (folder / name).mkdir(parents=True)
        for name in (
            "a.d/10.conf",
            "a.d/9.conf",
            "a.d/no.txt",
            "b.d/10.conf",
            "b.d/z z.conf",
            "b.d/.hidden.conf",
            "x1.inc",
            "x2.inc",
        ):
            self.write(name, [self.plain() for _ in range(rng.randrange(4))])
        self.write("deep.inc", [self.plain(), self.spell(f"include {folder}/x*.inc"), self.plain()])
        for name in ("a.d/s.sources", "b.d/s.sources", "b.d/t.sources"):
            self.write(name, [self.spell(f"server 192.0.2.{rng.randrange(200)}"), "# no source"])
        follow = [
            f"include {folder}/x?.inc",
            f"include {folder}/[xy]2.inc",
            f"include {folder}/deep.inc",
            f"include {folder}/none*.inc",
            f"confdir {folder}/a.d {folder}/b.d",
            f"confdir {folder}/b.d {folder}/empty.d {folder}/a.d {folder}/missing.d",
            f"sourcedir {folder}/b.d {folder}/a.d",
        ]
        lines = [self.plain() for _ in range(5)] + [self.spell(line) for line in rng.sample(follow, 4)]
        rng.shuffle(lines)
        self.main = self.write("chrony.conf", lines)

    def spell(self, line: str) -> str:
        """Return a line in other letters and white space, which mean the same."""
        word, _, rest = line.partition(" ")
        choose = self.rng.choice
        word = "".join(choose((letter.upper(), letter)) for letter in word)
        gap = choose((" ", "\t", "  \t "))
        return choose(("", " ", "\t")) + gap.join((word, *rest.split())) + choose(("", " ", "\r"))

    def plain(self) -> str:
        if self.rng.random() < 0.3:
            return self.rng.choice(("", "   ", *(f"{mark} {self.rng.choice(PLAIN)}" for mark in ("!", " ;", "\t#", "%"))))
        return self.spell(self.rng.choice(PLAIN))

    def write(self, name: str, lines: list[str]) -> Path:
        path = self.folder / name
        path.write_text("\n".join(lines) + self.rng.choice(("", "\n")), newline="")
        return path

    def expected(self, path: Path, only_sources: bool = False) -> list[list[str]]:
        """Return the words of the directives in a file and in what it includes, by the rules."""
        found: list[list[str]] = []
        for line in path.read_bytes().decode().split("\n"):
            words = line.split()
            if not words or words[0][0] in "!;#%":
                continue
            words[0] = words[0].lower()
            if only_sources and words[0] not in ("server", "pool", "peer"):
                continue
            found.append(words)
            if words[0] == "include":
                for each in sorted(self.folder.glob(Path(words[1]).name)):
                    found += self.expected(each)
            elif words[0] in ("confdir", "sourcedir"):
                suffix = "conf" if words[0] == "confdir" else "sources"
                first: dict[str, Path] = {}
                for folder in words[1:]:
                    for each in Path(folder).glob(f"[!.]*.{suffix}"):
                        first.setdefault(each.name, each)
                for _, each in sorted(first.items()):
                    found += self.expected(each, words[0] == "sourcedir")
        return found


@pytest.mark.parametrize("seed", range(60))
def test_generated_configuration_is_read_by_the_rules(tmp_path: Path, seed: int) -> None:
    etc = Etc(tmp_path / "etc", random.Random(seed))
    read = lines_of(etc.main)
    assert [words for _, words in read] == etc.expected(etc.main)
    if CHRONYD is None:
        return
    printed = subprocess.run([CHRONYD, "-p", "-f", str(etc.main)], capture_output=True, text=True, timeout=60, check=True)
    theirs = [line.split() for line in printed.stdout.splitlines()]
    ours = [words for file, words in read if words[0] not in _FOLLOWED and not file.endswith(".sources")]
    assert ours == [[words[0].lower(), *words[1:]] for words in theirs]


def test_file_that_includes_itself_ends(tmp_path: Path) -> None:
    main = tmp_path / "chrony.conf"
    main.write_text(f"include {main}\nmakestep 1 3\n")
    assert [words for _, words in lines_of(main, "makestep")] == [["makestep", "1", "3"]] * 10


@pytest.mark.parametrize(
    ("lines", "may_step"),
    [
        (["makestep 1 3"], True),
        (["MAKESTEP 1 -1"], True),
        (["makestep 1 0"], False),
        (["makestep 1 3", "MakeStep 0.1 0"], False),
        (["makestep 1 0", "makestep 1 3"], True),
        (["makestep"], True),
        (["makestepx 1 3"], False),
        ([], False),
    ],
)
def test_last_makestep_decides(lines: list[str], may_step: bool) -> None:
    conf = tuple(f"/etc/chrony/a:b.conf:{number}:{line}" for number, line in enumerate(lines, 1))
    assert bool(Chrony(True, True, conf, (), None, ()).steps) == may_step


def test_directives_in_capitals_are_the_same() -> None:
    conf = ("/etc/chrony/chrony.conf:1:Allow 10.42.0.0/24", "/etc/chrony/chrony.conf:2: DENY ALL 10.42.0.7")
    chrony = Chrony(True, True, conf, (), None, ())
    assert chrony.allows("10.42.0.1") and not chrony.allows("10.42.0.7")
    assert chrony.directives("allow") == conf[:1]


def test_probe_reads_nothing_but_what_chronyd_reads(tmp_path: Path) -> None:
    etc = tmp_path / "etc"
    (etc / "conf.d").mkdir(parents=True)
    (etc / "conf.d/site.conf").write_text("makestep 1 3\n")
    (etc / "chrony.conf").write_text("Pool ntp.example iburst\n")
    probe = CHRONY.probe.replace("/etc/chrony/chrony.conf", str(etc / "chrony.conf"))
    done = subprocess.run(["sh", "-c", probe], capture_output=True, text=True, timeout=60, check=False)
    assert CHRONY.parse(Output(done.returncode, done.stdout)).conf == (f"{etc}/chrony.conf:1:Pool ntp.example iburst",)


def test_only_the_directive_is_commented_out() -> None:
    before = "pool a\n  MakeStep 1 3\r\n# makestep 1 3\nmakestepx\n\nmakestep 1 -1"
    after = "pool a\n#   MakeStep 1 3\r\n# makestep 1 3\nmakestepx\n\n# makestep 1 -1"
    assert comment_out(before, "makestep") == after == comment_out(after, "makestep")
