"""Assembling an archive: masked, truncated, and listed in the manifest."""

from __future__ import annotations

import hashlib
import io
import json
import tarfile
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_cli.bundle import archive
from lupin_cli.bundle.archive import Contents, assemble, pack
from lupin_cli.bundle.items import ABSENT, TOO_BIG, BundleItem, Omission, truncate_bytes
from lupin_cli.bundle.redact import Redactor
from tests.support.secret_strategies import ANY_PASSWORD_CONTEXTS, SIMPLE_PASSWORD_CONTEXTS, private_key, simple_passwords

ABOUT = {"lupin": "1", "robots": []}


def assemble_items(*items: BundleItem, omissions: tuple[Omission, ...] = (), **options: int) -> Contents:
    return assemble(items, omissions, Redactor(), ABOUT, **options)


def manifest_of(contents: Contents) -> dict[str, Any]:
    manifest: dict[str, Any] = json.loads(next(each.data for each in contents.members if each.path == "manifest.json"))
    return manifest


def everything(contents: Contents) -> bytes:
    """Pack the archive, and return the names and contents of all its files."""
    unpacked = []
    with tarfile.open(fileobj=io.BytesIO(pack(contents.members, "bundle", 0.0))) as tar:
        for entry in tar:
            file = tar.extractfile(entry)
            assert file is not None
            unpacked += [entry.name.encode(), file.read()]
    return b"\n".join(unpacked)


def archives_with(planted: str, secret: str) -> list[list[BundleItem]]:
    """Archives with the secret in one place: a log, invalid UTF-8, a JSON file, data for JSON, a file name, a remark."""
    line = json.dumps({"event": "output", "text": planted})
    return [
        [BundleItem("a.log", "", f"before\n{planted}\nafter {secret}\n".encode())],
        [BundleItem("a.log", "", b"\xff\xfe\0\x80" + planted.encode() + b"\n\xc3\x28\0\n")],
        [BundleItem("a.json", "", json.dumps({"list": [{"said": planted}]}).encode())],
        [BundleItem("a.jsonl", "", f'{line}\n{line[:-2]}\n{{"text": {json.dumps(secret)}}}\n'.encode())],
        [BundleItem("a.json", "", {"said": [planted], "bare": secret, planted: 1})],
        [BundleItem(f"dir/{secret}.txt", "", planted.encode()), BundleItem("b.txt", "", b"x", remark=f"unreadable: {secret}")],
    ]


@pytest.mark.parametrize("name", [*SIMPLE_PASSWORD_CONTEXTS, *ANY_PASSWORD_CONTEXTS])
@settings(max_examples=3)
@given(secret=simple_passwords)
def test_secret_in_any_file_is_masked_in_all_files(name: str, secret: str) -> None:
    planted = {**SIMPLE_PASSWORD_CONTEXTS, **ANY_PASSWORD_CONTEXTS}[name](secret)
    for items in archives_with(planted, secret):
        elsewhere = BundleItem("z.log", "", f"somebody mentions {secret} here".encode())
        missing = (Omission(f"c/{secret}", ABSENT, f"stat: {secret}: no such file"),)
        found = everything(assemble_items(*items, elsewhere, omissions=missing))
        assert secret.encode() not in found
        assert b"somebody mentions *** here" in found


def test_private_key_is_masked_in_all_files() -> None:
    key = private_key("hunter2" * 30)
    found = everything(assemble_items(BundleItem("a.log", "", key.encode()), BundleItem("b.json", "", {"text": key})))
    for line in key.splitlines()[1:-1]:
        assert line.encode() not in found


@settings(max_examples=40)
@given(st.lists(st.text("abcdefgijlmnoqrtuvxyz 0123456789,\n", max_size=80), max_size=5))
def test_files_without_secrets_are_unchanged(texts: list[str]) -> None:
    contents = assemble_items(*(BundleItem(f"{index}.log", "", text.encode()) for index, text in enumerate(texts)))
    assert [each.data.decode() for each in contents.members[2:]] == texts
    assert contents.masked == {}


def test_manifest_lists_files_and_omissions() -> None:
    missing = Omission("robots/a/journal", ABSENT, "there is none")
    contents = assemble_items(
        BundleItem("a.log", "output of a", b"psk=abcd1234", remark="its first lines are left out"), omissions=(missing,)
    )
    manifest = manifest_of(contents)
    assert [each["path"] for each in manifest["files"]] == ["a.log"]
    (row,) = manifest["files"]
    assert row["sha256"] == hashlib.sha256(b"psk=***").hexdigest()
    assert (row["what"], row["bytes"], row["incomplete"]) == ("output of a", 7, "its first lines are left out")
    assert manifest["left_out"] == [{"path": "robots/a/journal", "kind": "absent", "reason": "there is none"}]
    assert (manifest["format"], manifest["lupin"], manifest["masked"]) == (1, "1", {"secret": 1})


def test_long_file_keeps_head_and_tail_with_remark(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "MAX_FILE_BYTES", 20_000)
    lines = [f"line {number}" for number in range(4000)]
    contents = assemble_items(BundleItem("a.log", "", "\n".join(lines).encode()))
    kept = contents.members[2].data.decode().splitlines()
    assert (kept[0], kept[-1]) == (lines[0], lines[-1])
    assert sum("left out here" in line for line in kept) == 1
    assert set(kept) - set(lines) == {next(line for line in kept if "left out here" in line)}  # every other line is complete
    assert "bytes were left out of the middle" in manifest_of(contents)["files"][0]["incomplete"]


def test_items_beyond_total_limit_are_omitted() -> None:
    items = [BundleItem(f"{name}.log", "", (name * 99 + "\n").encode() * 500) for name in "uvw"]
    contents = assemble_items(*items, total=70_000)
    assert [each.path for each in contents.members[2:]] == ["u.log", "v.log"]
    assert [(each.path, each.kind) for each in contents.omissions] == [("w.log", TOO_BIG)]
    assert sum(len(each.data) for each in contents.members[2:]) <= 70_000 + 100


def test_json_beyond_limit_is_omitted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "MAX_JSON_BYTES", 20_000)
    contents = assemble_items(BundleItem("a.json", "", {"x": "y" * 30_000}))
    assert [(each.path, each.kind) for each in contents.omissions] == [("a.json", TOO_BIG)]


def test_deeply_nested_json_does_not_affect_other_files() -> None:
    deep = b"[" * 100_000 + b'"psk=abcd1234"' + b"]" * 100_000
    contents = assemble_items(BundleItem("deep.json", "", deep), BundleItem("a.log", "", b"fine"))
    assert any(each.path == "a.log" for each in contents.members)
    assert b"abcd1234" not in everything(contents)


@pytest.mark.parametrize("path", ["../../etc/passwd", "/etc/passwd", "a/../../b", "a\nb/..", "…/x", "a/./b"])
def test_path_that_leads_outside_stays_in_archive(path: str) -> None:
    contents = assemble_items(BundleItem(path, "", b"x"))
    name = contents.members[2].path
    assert not name.startswith(("/", "."))
    assert all(part.strip(".") for part in name.split("/"))
    assert name.isprintable()


def test_truncation_drops_incomplete_lines() -> None:
    data = b"first psk=" + b"a1" * 500 + b"\n" + b"x\n" * 400 + b"last psk=" + b"b2" * 500 + b"\nend\n"
    kept = truncate_bytes(data, 600)
    assert b"a1a1" not in kept.data or b"psk=a1" in kept.data
    assert b"b2b2" not in kept.data
    assert kept.data.endswith(b"end\n")
    assert truncate_bytes(b"q" * 1000, 100).data.count(b"q") == 0  # a single line: the meaning of its end is unknown


def test_equal_contents_give_equal_archives() -> None:
    contents = assemble_items(BundleItem("a.log", "", b"x"))
    assert pack(contents.members, "b", 5.0) == pack(contents.members, "b", 5.0)
    with tarfile.open(fileobj=io.BytesIO(pack(contents.members, "b", 5.0))) as tar:
        assert {(entry.mode, entry.uid, entry.uname, entry.mtime) for entry in tar} == {(0o600, 0, "", 5)}
