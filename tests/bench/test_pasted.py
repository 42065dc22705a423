"""What the bench reads from the doctor's output in a terminal, whose lines are broken between words."""

from __future__ import annotations

from bench.bench_pasted import PrintedFix, printed_fixes

OUTPUT = """pot over cable (10.42.0.1): not healthy, no topic delivers samples to this machine

✗ link         a cause that is
  longer than a line
✓ login        SSH to 10.42.0.1 works

✗ laptop: a short cause  [first]
  symptom   something that
            takes two lines
  do        plug the cable in
            and out
  fix       lupin doctor --robot pot

▲ robot: a longer cause that
  goes on here  [second]
  symptom   something
  explains  robot: another  [third]
  fix       ssh -t mirte@pot 'sudo true'
  --fix     asks, then plays heal

▲ robot: a cause that fills its line
  [fourth]
  symptom   something
  do        charge the battery

2 warnings; 3 checks
"""


def test_fixes_are_read_from_broken_lines() -> None:
    assert printed_fixes(OUTPUT) == {
        "first": PrintedFix("plug the cable in and out", "lupin doctor --robot pot"),
        "second": PrintedFix("", "ssh -t mirte@pot 'sudo true'"),
        "fourth": PrintedFix("charge the battery", ""),
    }
