"""`--all` over twenty robots against one: a diagnosis, and a small playbook that changes something. Limit: twice as long.

Twenty computers don't fit into two cores, and the laptop that commands them would have to share its own with them: what would
be measured is this machine. So one computer is booted, with twenty more addresses; each is a robot of the inventory, with
connections, log-ins, channels and sudo of its own, all for real. What a robot computes is replaced by the time that it takes:

* a diagnosis's probes are asked once, alone; from then on every address gives those answers after as many seconds as they took,
  to the byte, and only the nonce of the question and the time are put in.
* the playbook really writes a file and looks at a unit, and has a step that takes a second, as a restart does.

So the figures hold what the command itself costs for twenty robots (one Python process: twenty key exchanges, batches, parsers,
diagnoses, journals), and the log-ins of all of them on one machine, which in a fleet are twenty machines' work. Without PAM and
without being executed anew for each connection (-r) their sshd takes 13 ms of the operator's cores a log-in instead of 46. They
hold no word about a robot that is slow: one that takes longer than the others makes everybody wait, with twenty as with two.

    python -m bench.bench_fleet [--robots N] [--rounds N] [--busy] [--json]      needs root, as the host's tests do
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from typing import Any

from bench.booted import Operator, load, median, operator, take_the_cores
from bench.peers.facts import visiting

LIMIT = 2.0
FIRST_BYTE = 101  # of the addresses: 10.42.0.101 and those behind it
REPLAY = "/usr/local/lib/lupin-bench-replay"
# The command of a connection reads a program of so many bytes and runs it; a batch tells how many in its first line. One with
# more than ten scripts is a diagnosis. One process, since whatever it takes is taken from the cores of who commands.
REPLAY_TEXT = r"""#!/usr/bin/perl
use strict;
use Time::HiRes qw(time sleep);
$/ = undef;
my ($size, $lead, $byte) = (0, '', '');
sub take { my $all = ''; while (length $all < $_[0]) { sysread(STDIN, $all, $_[0] - length $all, length $all) or last } $all }
sub kept { open(my $file, '<', $_[0]) or return ''; <$file> }
sub keep { open(my $file, '>', $_[0]); print $file $_[1] }
if ($ENV{SSH_ORIGINAL_COMMAND} =~ /read -r bound size/) {
  $lead .= $byte while sysread(STDIN, $byte, 1) and $byte ne "\n";
  ($size) = $lead =~ / (\d+)/;
} else { ($size) = $ENV{SSH_ORIGINAL_COMMAND} =~ /head -c (\d+)/ }
my $program = take($size);
exec('/bin/sh', '-c', $program) if $program !~ /one 10 /;
my ($nonce) = $program =~ /\nn=([0-9a-f]+)/;
my $answers = kept('/var/tmp/answers');
if ($answers eq '') {
  my ($began) = split(' ', kept('/proc/uptime'));
  open(my $shell, '-|', '/bin/sh', '-c', $program);
  $answers = <$shell>;
  my ($ended) = split(' ', kept('/proc/uptime'));
  keep('/var/tmp/seconds', $ended - $began);
  (my $kept = $answers) =~ s/^$nonce/NONCE/mg;
  keep('/var/tmp/answers', $kept);
} else {
  $answers =~ s/^NONCE/$nonce/mg;
  $answers =~ s/^$nonce c .*\n//m;
  syswrite(STDOUT, sprintf("$nonce c %.6f\n", time));
  sleep(kept('/var/tmp/seconds'));
}
syswrite(STDOUT, $answers);
"""
SSHD = """UsePAM no
MaxStartups 200
MaxSessions 50
Match LocalAddress 10.42.0.1??
  ForceCommand {replay}
"""
BOOK = """name: small
description: A file of the user's, a service, and something that takes its time.
vars: {word: {type: text}}
steps:
- name: write a note
  file: {path: "~/note-{{ robot.name }}", content: "{{ word }}\\n", mode: "0600"}
- name: its sshd runs
  unit: {unit: ssh.service, state: started}
- name: takes a second
  as: waited
  probe: {run: sleep 1}
"""


def furnish(someone: Operator, robots: int) -> None:
    """Give the robot's computer its addresses, and the inventory a robot for each."""
    inside = someone.host.robot.inside
    numbers = range(FIRST_BYTE, FIRST_BYTE + robots)
    script = "set -e\n" + "".join(f"ip address add 10.42.0.{n}/24 dev eth0\n" for n in numbers)
    script += f"cat > {REPLAY}; chmod 755 {REPLAY}; chmod 1777 /var/tmp\n"
    for command, text in ((script, REPLAY_TEXT), (_SSHD, SSHD.format(replay=REPLAY))):
        done = inside("sh", "-c", command, stdin=text)
        if done.status != 0:
            raise SystemExit(f"not measured: {done.stderr}")
    known = someone.home / ".ssh" / "known_hosts"
    lines = known.read_text().splitlines()
    known.write_text("".join(f"{line.replace(line.split()[0], f'10.42.0.{n}')}\n" for line in lines for n in numbers))
    inventory = someone.home / ".config" / "lupin" / "lupin.toml"
    inventory.write_text("".join(f'[robots.pot-{n}]\nuser = "mirte"\naddresses = {{wired = "10.42.0.{n}"}}\n' for n in numbers))
    (someone.home / "small.yaml").write_text(BOOK)


_SSHD = "set -e; cat > /etc/ssh/sshd_config.d/fleet.conf; sshd -t; echo SSHD_OPTS=-r >> /etc/default/ssh; systemctl restart ssh"


class Fleet:
    """What is typed, for one robot or for all."""

    def __init__(self, someone: Operator, robots: int) -> None:
        self._someone, self._robots = someone, robots
        self._word = 0

    def _whom(self, every: bool) -> list[str]:
        return ["--all"] if every else ["--all", "--limit", f"pot-{FIRST_BYTE}"]

    def doctor(self, every: bool) -> float:
        """Seconds of a diagnosis; every robot must be told the same."""
        skipped = [word for name in visiting() for word in ("--skip", name)]
        ran = self._someone.must(self._someone.lupin("doctor", *self._whom(every), *skipped, "--json"), 0, 1)
        told = json.loads(ran.stdout)
        each = told["robots"] if every else [told]
        if len(each) != (self._robots if every else 1) or any(one["robot"]["unreachable"] or one["unknown"] for one in each):
            raise SystemExit(f"not measured: not every robot was examined: {ran.stdout[:2000]}")
        if len({json.dumps([finding["id"] for finding in one["findings"]]) for one in each}) != 1:
            raise SystemExit("not measured: robots that say the same were told different things")
        return ran.wall_s

    def play(self, every: bool) -> float:
        """Seconds of a run; on every robot the note must have been written."""
        self._word += 1
        words = ["play", str(self._someone.home / "small.yaml"), "-v", f"word={self._word}", *self._whom(every), "--json"]
        ran = self._someone.must(self._someone.lupin(*words))
        told = json.loads(ran.stdout)
        for one in told if every else [told]:
            if (one["state"], one["changed"]) != ("done", 1):
                raise SystemExit(f"not measured: {one['robot']} {one['state']}, {one['changed']} changed: {one['message']}")
        return ran.wall_s


def compare(what: Callable[[bool], float], rounds: int, note: Callable[[str], None]) -> dict[str, Any]:
    """One and all in turns, after a round that warms caches."""
    what(False)
    what(True)
    pairs = []
    for round_ in range(rounds):
        pairs.append((what(False), what(True)))
        note(f"{what.__name__}, round {round_}: one {pairs[-1][0]:.2f} s, all {pairs[-1][1]:.2f} s")
    return {
        "one_s": median([one for one, _ in pairs]),
        "all_s": median([every for _, every in pairs]),
        "ratio": round(median([every / one for one, every in pairs]), 2),
        "load": load(),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--busy", action="store_true", help="Others use this machine: run what is measured before their work.")
    parser.add_argument("--json", action="store_true", help="Print one line of JSON, alone on standard output.")
    options = parser.parse_args()

    def note(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    with operator() as someone:
        furnish(someone, options.robots)
        if options.busy:
            take_the_cores(someone.host)
        fleet = Fleet(someone, options.robots)
        fleet.doctor(False)  # asked for real, and kept
        seconds = float(someone.host.robot.inside("cat", "/var/tmp/seconds").stdout)
        result: dict[str, Any] = {"robots": options.robots, "limit": LIMIT, "a_robots_answer_s": seconds}
        result["doctor"] = compare(fleet.doctor, options.rounds, note)
        result["play"] = compare(fleet.play, options.rounds, note)
    if options.json:
        print(json.dumps(result))
    else:
        print(f"{options.robots} robots, each of which takes {seconds:.2f} s to answer a diagnosis")
        for name in ("doctor", "play"):
            row = result[name]
            took = f"one {row['one_s']:.2f} s, all {row['all_s']:.2f} s: {row['ratio']} times (limit {LIMIT:g})"
            print(f"{name:6} {took}; load {row['load']}")
    return 0 if max(result[name]["ratio"] for name in ("doctor", "play")) <= LIMIT else 1


if __name__ == "__main__":
    sys.exit(main())
