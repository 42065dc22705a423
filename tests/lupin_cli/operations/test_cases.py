"""Captured probe output with the expected plan: one JSON file per case in cases/OPERATION/.

A case has `about`, the step's `arguments`, the probe's `output` (`stdout` as text or as a list of lines), and what the
operation must make of it: `difference` (null: nothing to do), `report` if it has one, or `error` with its `next_command`.
A case with a difference also has `after`, the probe's output once the change was made, for which nothing may be left to do.
`baseline` is the state when the step began. In `stdout`, MARK stands for the separator that `join_probes` writes after the
output of each probe. A path that begins with /CASE is created from the output in a temporary directory, and changed there for
real.
"""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.connection.base import Output
from lupin_cli.operations import Difference, Operation, OperationError
from lupin_cli.operations.path_state import parse_file, parse_state
from lupin_cli.operations.shell import observe
from lupin_cli.operations.table import OPERATIONS
from tests.support.operation_cycle import apply_and_undo, examine

if TYPE_CHECKING:
    from lupin_cli.connection.local import LocalTarget

CASES = Path(__file__).parent / "cases"
FILES = sorted(CASES.glob("*/*.json"))
CASE_ROOT = "/CASE"
PATH_OPERATIONS = ("directory", "file", "line-in-file", "symlink")


def case_id(path: Path) -> str:
    return f"{path.parent.name}-{path.stem}"


def read_case(path: Path, root: str = CASE_ROOT) -> dict[str, Any]:
    """Read a case, with /CASE replaced by `root`."""
    case: dict[str, Any] = json.loads(path.read_text().replace(CASE_ROOT, root))
    script = operation_of(path, case).probe()
    # join_probes lets the script print it with: printf '\\n<16 hex digits> %s ...'
    mark = re.search(r"printf '\\n([0-9a-f]{16}) %s", script.text) if script is not None else None
    for output in (case["output"], *([case["after"]] if "after" in case else [])):
        stdout = output["stdout"]
        if isinstance(stdout, list):
            stdout = "".join(f"{line}\n" for line in stdout)
        output["stdout"] = stdout.replace("MARK", mark[1]) if mark else stdout
    return case


def operation_of(path: Path, case: dict[str, Any]) -> Operation:
    operation = OPERATIONS[path.parent.name](**case["arguments"])
    return operation.with_baseline(case["baseline"]) if "baseline" in case else operation


def as_json(difference: Difference | None) -> dict[str, Any] | None:
    if difference is None:
        return None
    diff = difference.diff.split("\n") if difference.diff else []
    return {"summary": difference.summary, "diff": diff, "before": json.loads(json.dumps(difference.before))}


@pytest.fixture
def laptop_home(monkeypatch: pytest.MonkeyPatch) -> None:
    """Set the home directory that the cases of laptop-dds name."""
    for name in ("XDG_CONFIG_HOME", "ZDOTDIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", "/home/ada")
    monkeypatch.setenv("SHELL", "/bin/bash")


@pytest.mark.usefixtures("laptop_home")
@pytest.mark.parametrize("path", FILES, ids=case_id)
def test_output_is_judged_as_the_case_says(path: Path) -> None:
    case = read_case(path)
    operation, output = operation_of(path, case), Output(**case["output"])
    if "error" in case:
        with pytest.raises(OperationError) as refused:  # noqa: PT012 -- either of the two may refuse
            operation.judge(output)
            operation.report(output)
        assert (str(refused.value), refused.value.next_command) == (case["error"], case.get("next_command", ""))
        return
    assert as_json(operation.judge(output)) == case["difference"]
    assert operation.report(output) == case.get("report", {})
    assert set(case.get("report", {})) == set(operation.report_keys)


def has_difference(path: Path) -> bool:
    return bool(json.loads(path.read_text()).get("difference"))


@pytest.mark.usefixtures("laptop_home")
@pytest.mark.parametrize("path", [path for path in FILES if has_difference(path)], ids=case_id)
def test_output_after_the_change_leaves_nothing_to_do(path: Path) -> None:
    case = read_case(path)
    operation = operation_of(path, case).with_baseline(case["difference"]["before"])
    assert operation.judge(Output(**case["after"])) is None


def can_run_on_files(path: Path) -> bool:
    return path.parent.name in PATH_OPERATIONS and has_difference(path)


def create_probed_state(operation: str, path: Path, output: Output) -> None:
    """Create what the probe found at `path`."""
    state = parse_state(output, str(path)) if operation in ("directory", "symlink") else parse_file(output, str(path))
    if state.kind == "absent":
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    if state.kind == "link":
        path.symlink_to(state.points_to)
        return
    if state.kind == "directory":
        path.mkdir()
    else:
        path.write_bytes(parse_file(output, str(path)).content or b"")
    path.chmod(int(state.mode, 8))
    user, group = state.owner.split(":")
    if (path.owner(), path.group()) != (user, group):
        if os.getuid() != 0:
            pytest.skip(f"needs root: chown to {state.owner}")
        os.chown(path, *ids_of(user, group))


def ids_of(user: str, group: str) -> tuple[int, int]:
    import grp
    import pwd

    return pwd.getpwnam(user).pw_uid, grp.getgrnam(group).gr_gid


@pytest.mark.parametrize("path", [path for path in FILES if can_run_on_files(path)], ids=case_id)
def test_case_is_applied_and_undone_on_real_files(path: Path, target: LocalTarget, tmp_path: Path) -> None:
    case = read_case(path, str(tmp_path))
    operation = operation_of(path, case)
    create_probed_state(path.parent.name, Path(case["arguments"]["path"]), Output(**case["output"]))
    assert as_json(examine(operation, target)) == case["difference"]
    difference = apply_and_undo(operation, target)
    operation.change(target, difference)  # once more, after the undo
    after = observe(operation, target).stdout
    if os.getuid() == 0:  # the files in the cases belong to root
        assert after == case["after"]["stdout"]


def test_every_operation_has_cases() -> None:
    """Each has a case with a difference, one without, and one with an error, as far as the operation can have them."""
    for name, operation in OPERATIONS.items():
        cases = [json.loads(path.read_text()) for path in (CASES / name).glob("*.json")]
        assert len(cases) >= 3, name
        assert any("difference" in case and case["difference"] is None for case in cases), name
        assert operation.read_only or name == "require" or any(case.get("difference") for case in cases), name
        assert name == "command" or any("error" in case for case in cases), name
    assert {path.parent.name for path in FILES} == set(OPERATIONS)


odd_lines = st.sampled_from(
    [
        "",
        "absent",
        "file 644 a:b",
        "link 0 -:- x",
        "ActiveState=",
        "LoadState=x",
        "states {}",
        "states [",
        "@ extra",
        "== whole",
    ]
) | st.text(max_size=30)


@given(
    path=st.sampled_from([next((CASES / name).glob("*.json")) for name in OPERATIONS]),
    status=st.sampled_from([0, 1, 8, 10, 41, 127, -9]),
    lines=st.lists(odd_lines, max_size=8),
    truncated=st.booleans(),
)
def test_any_output_is_judged_or_refused(path: Path, status: int, lines: list[str], truncated: bool) -> None:
    operation, output = operation_of(path, json.loads(path.read_text())), Output(status, "\n".join(lines), "", 0.0, truncated)
    for interpret in (operation.judge, operation.report, operation.overwritten):
        try:
            interpret(output)
        except OperationError as error:
            assert str(error) and "\n" not in str(error)
