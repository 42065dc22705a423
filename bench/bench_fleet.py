"""`lupin doctor --all` and `lupin play --all`: the time for twenty robots compared with one.

Twenty simulated computers would overload the two cores that they share with the laptop, and the benchmark would measure that.
So one computer is booted, with twenty more addresses. Each address is a robot of the inventory, with real connections, logins,
channels and sudo. The computation on a robot is replaced by its duration:

* The probes of a diagnosis run once, for a single robot. Then every address sends the same output after the same time; only
  the nonce of the request and the clock are replaced.
* The playbook really writes a file and reads a unit's state, and has a step that takes a second, like a restart.

So the figures include the CPU time of the command itself for twenty robots (one Python process with twenty key exchanges,
batches, parsers, diagnoses and journals), and the logins of all robots on one machine, which in a real fleet are spread over
twenty. sshd runs without PAM and with -r, so that it does not re-execute itself for each connection: a login then takes 13 ms
of the operator's cores instead of 46. The figures say nothing about slow robots: a command always waits for the slowest one.

Needs root, as the tests on booted hosts do.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Annotated, Any

from bench.booted import Operator, booted_operator, load_average, median, raise_priority
from bench.peers.facts import graph_checks
from bench.runner import Busy, Figures, Rounds, benchmark, note

FIRST_BYTE = 101  # last byte of the first address, 10.42.0.101
REPLAY = "/usr/local/lib/lupin-bench-replay"
# Replays a diagnosis. The SSH command reads a program of a given size and runs it (connection/batch_protocol.py); a program
# with more than ten scripts is a diagnosis. The replay is a single Perl process, since it uses CPU time of this machine.
REPLAY_TEXT = r"""#!/usr/bin/perl
use strict;
use Time::HiRes qw(time sleep);
$/ = undef;
sub receive {
  my $all = '';
  while (length $all < $_[0]) { sysread(STDIN, $all, $_[0] - length $all, length $all) or last }
  $all
}
sub load { open(my $file, '<', $_[0]) or return ''; <$file> }
sub save { open(my $file, '>', $_[0]); print $file $_[1] }
my ($size) = $ENV{SSH_ORIGINAL_COMMAND} =~ /head -c (\d+)/;
my $program = receive($size);
exec('/bin/sh', '-c', $program) if $program !~ /run_script 10 /;
my ($nonce) = $program =~ /\nn=([0-9a-f]+)/;
my $output = load('/var/tmp/output');
if ($output eq '') {
  my ($start) = split(' ', load('/proc/uptime'));
  open(my $shell, '-|', '/bin/sh', '-c', $program);
  $output = <$shell>;
  my ($end) = split(' ', load('/proc/uptime'));
  save('/var/tmp/seconds', $end - $start);
  (my $saved = $output) =~ s/^$nonce/NONCE/mg;
  save('/var/tmp/output', $saved);
} else {
  $output =~ s/^NONCE/$nonce/mg;
  $output =~ s/^$nonce c .*\n//m;
  syswrite(STDOUT, sprintf("$nonce c %.6f\n", time));
  sleep(load('/var/tmp/seconds'));
}
syswrite(STDOUT, $output);
"""
SSHD_CONFIG = """UsePAM no
MaxStartups 200
MaxSessions 50
Match LocalAddress 10.42.0.1??
  ForceCommand {replay}
"""
PLAYBOOK = """name: small
description: Writes a file of the user, checks a service, and waits for a second.
vars: {word: {type: text}}
steps:
- name: Write a note
  file: {path: "~/note-{{ robot.name }}", content: "{{ word }}\\n", mode: "0600"}
- name: Check that sshd runs
  unit: {unit: ssh.service, state: started}
- name: Wait for a second
  as: waited
  probe: {run: sleep 1}
"""


def prepare_robots(operator: Operator, robots: int) -> None:
    """Add the addresses to the simulated computer, and a robot for each address to the inventory."""
    run_as_root = operator.host.robot.run_as_root
    numbers = range(FIRST_BYTE, FIRST_BYTE + robots)
    script = "set -e\n" + "".join(f"ip address add 10.42.0.{n}/24 dev eth0\n" for n in numbers)
    script += f"cat > {REPLAY}; chmod 755 {REPLAY}; chmod 1777 /var/tmp\n"
    for command, text in ((script, REPLAY_TEXT), (_RESTART_SSHD, SSHD_CONFIG.format(replay=REPLAY))):
        done = run_as_root("sh", "-c", command, stdin=text)
        if done.status != 0:
            raise SystemExit(f"not measured: {done.stderr}")
    known = operator.home / ".ssh" / "known_hosts"
    lines = known.read_text().splitlines()
    known.write_text("".join(f"{line.replace(line.split()[0], f'10.42.0.{n}')}\n" for line in lines for n in numbers))
    inventory = operator.home / ".config" / "lupin" / "lupin.toml"
    inventory.write_text("".join(f'[robots.pot-{n}]\nuser = "mirte"\naddresses = {{wired = "10.42.0.{n}"}}\n' for n in numbers))
    (operator.home / "small.yaml").write_text(PLAYBOOK)


_RESTART_SSHD = (
    "set -e; cat > /etc/ssh/sshd_config.d/fleet.conf; sshd -t; echo SSHD_OPTS=-r >> /etc/default/ssh; systemctl restart ssh"
)


class Fleet:
    """Times commands on one robot of the inventory, or on all."""

    def __init__(self, operator: Operator, robots: int) -> None:
        self._operator, self._robots = operator, robots
        self._note_number = 0

    def _selection(self, all_robots: bool) -> list[str]:
        return ["--all"] if all_robots else ["--all", "--limit", f"pot-{FIRST_BYTE}"]

    def doctor(self, all_robots: bool) -> float:
        """Time a diagnosis, in seconds; all robots must have the same findings."""
        skipped = [word for name in graph_checks() for word in ("--skip", name)]
        ran = self._operator.require(self._operator.lupin("doctor", *self._selection(all_robots), *skipped, "--json"), 0, 1)
        report = json.loads(ran.stdout)
        robots = report["robots"] if all_robots else [report]
        if len(robots) != (self._robots if all_robots else 1) or any(r["robot"]["unreachable"] or r["unknown"] for r in robots):
            raise SystemExit(f"not measured: not every robot was diagnosed: {ran.stdout[:2000]}")
        if len({json.dumps([finding["id"] for finding in one["findings"]]) for one in robots}) != 1:
            raise SystemExit("not measured: robots with the same output have different findings")
        return ran.wall_s

    def play(self, all_robots: bool) -> float:
        """Time a playbook run, in seconds; the note must have been written on every robot."""
        self._note_number += 1
        words = [
            "play",
            str(self._operator.home / "small.yaml"),
            "-v",
            f"word={self._note_number}",
            *self._selection(all_robots),
            "--json",
        ]
        ran = self._operator.require(self._operator.lupin(*words))
        report = json.loads(ran.stdout)
        for one in report if all_robots else [report]:
            if (one["state"], one["changed"]) != ("done", 1):
                raise SystemExit(f"not measured: {one['robot']} {one['state']}, {one['changed']} changed: {one['message']}")
        return ran.wall_s


def compare(command: Callable[[bool], float], rounds: int) -> dict[str, Any]:
    """Time a command on one robot and on all robots in rounds, after a round that warms caches."""
    command(False)
    command(True)
    pairs = []
    for round_ in range(rounds):
        pairs.append((command(False), command(True)))
        note(f"{command.__name__}, round {round_}: one {pairs[-1][0]:.2f} s, all {pairs[-1][1]:.2f} s")
    return {
        "one_s": median([one_s for one_s, _ in pairs]),
        "all_s": median([all_s for _, all_s in pairs]),
        "ratio": median([all_s / one_s for one_s, all_s in pairs]),
        "load_average": load_average(),
    }


@benchmark(at_most={"ratio": 2.0})
def main(robots: Annotated[int, "compare this many robots with one"] = 20, rounds: Rounds = 5, busy: Busy = False) -> Figures:
    """Time a diagnosis and a playbook on one robot and on many."""
    with booted_operator() as operator:
        prepare_robots(operator, robots)
        if busy:
            raise_priority(operator.host)
        fleet = Fleet(operator, robots)
        fleet.doctor(False)  # runs the real probes and saves their output
        seconds = float(operator.host.robot.run_as_root("cat", "/var/tmp/seconds").stdout)
        commands = {"doctor": compare(fleet.doctor, rounds), "play": compare(fleet.play, rounds)}
    return {"robots": robots, "robot_answer_s": seconds, "commands": commands}


if __name__ == "__main__":
    sys.exit(main())
