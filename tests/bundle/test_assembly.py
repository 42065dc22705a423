"""From pieces to the archive's files: nothing secret in any of them, none too long, all told by the manifest."""

from __future__ import annotations

import hashlib
import io
import json
import tarfile

import pytest
from carriers import BARE, QUOTED, private_key, words
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_cli.bundle import assembly, ends
from lupin_cli.bundle.archive import pack
from lupin_cli.bundle.assembly import Contents, assemble
from lupin_cli.bundle.pieces import ABSENT, TOO_BIG, LeftOut, Piece
from lupin_cli.bundle.redaction import Redactor

ABOUT = {"lupin": "1", "robots": []}


def assembled(*pieces: Piece, left_out: tuple[LeftOut, ...] = (), **options: int) -> Contents:
    return assemble(pieces, left_out, Redactor(), ABOUT, **options)


def manifest(contents: Contents) -> dict:
    return json.loads(next(each.data for each in contents.members if each.path == "manifest.json"))


def everything(contents: Contents) -> bytes:
    """The archive as somebody sees it who opens it: names and bytes."""
    unpacked = []
    with tarfile.open(fileobj=io.BytesIO(pack(contents.members, "bundle", 0.0))) as tar:
        for entry in tar:
            file = tar.extractfile(entry)
            assert file is not None
            unpacked += [entry.name.encode(), file.read()]
    return b"\n".join(unpacked)


def of_kinds(planted: str, secret: str) -> list[list[Piece]]:
    """Archives in each of which one file has the secret: a log, garbage, JSON of a machine, our own data, a name, a remark."""
    line = json.dumps({"event": "output", "text": planted})
    return [
        [Piece("a.log", "", f"before\n{planted}\nafter {secret}\n".encode())],
        [Piece("a.log", "", b"\xff\xfe\0\x80" + planted.encode() + b"\n\xc3\x28\0\n")],
        [Piece("a.json", "", json.dumps({"list": [{"said": planted}]}).encode())],
        [Piece("a.jsonl", "", f'{line}\n{line[:-2]}\n{{"text": {json.dumps(secret)}}}\n'.encode())],
        [Piece("a.json", "", {"said": [planted], "bare": secret, planted: 1})],
        [Piece(f"dir/{secret}.txt", "", planted.encode()), Piece("b.txt", "", b"x", remark=f"unreadable: {secret}")],
    ]


@pytest.mark.parametrize("name", [*BARE, *QUOTED])
@settings(max_examples=3, deadline=None)
@given(secret=words)
def test_a_planted_secret_is_in_no_file_whichever_it_was_planted_in(name: str, secret: str) -> None:
    planted = {**BARE, **QUOTED}[name](secret)
    for pieces in of_kinds(planted, secret):
        elsewhere = Piece("z.log", "", f"somebody mentions {secret} here".encode())
        missing = (LeftOut(f"c/{secret}", ABSENT, f"stat: {secret}: no such file"),)
        found = everything(assembled(*pieces, elsewhere, left_out=missing))
        assert secret.encode() not in found
        assert b"somebody mentions *** here" in found


def test_a_planted_private_key_is_in_no_file() -> None:
    key = private_key("hunter2" * 30)
    found = everything(assembled(Piece("a.log", "", key.encode()), Piece("b.json", "", {"text": key})))
    for line in key.splitlines()[1:-1]:
        assert line.encode() not in found


@settings(max_examples=40, deadline=None)
@given(st.lists(st.text("abcdefgijlmnoqrtuvxyz 0123456789,\n", max_size=80), max_size=5))
def test_files_without_secrets_are_as_they_were(texts: list[str]) -> None:
    contents = assembled(*(Piece(f"{index}.log", "", text.encode()) for index, text in enumerate(texts)))
    assert [each.data.decode() for each in contents.members[2:]] == texts
    assert contents.masked == {}


def test_the_manifest_tells_every_file_and_everything_that_is_not_there() -> None:
    missing = LeftOut("robots/a/journal", ABSENT, "there is none")
    contents = assembled(
        Piece("a.log", "what a said", b"psk=abcd1234", remark="its first lines are left out"), left_out=(missing,)
    )
    told = manifest(contents)
    assert [each["path"] for each in told["files"]] == ["a.log"]
    (row,) = told["files"]
    assert row["sha256"] == hashlib.sha256(b"psk=***").hexdigest()
    assert (row["what"], row["bytes"], row["incomplete"]) == ("what a said", 7, "its first lines are left out")
    assert told["left_out"] == [{"path": "robots/a/journal", "kind": "absent", "reason": "there is none"}]
    assert (told["format"], told["lupin"], told["masked"]) == (1, "1", {"secret": 1})


def test_what_is_too_long_keeps_its_head_and_its_tail_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(assembly, "FILE_LIMIT", 20_000)
    lines = [f"line {number}" for number in range(4000)]
    contents = assembled(Piece("a.log", "", "\n".join(lines).encode()))
    kept = contents.members[2].data.decode().splitlines()
    assert (kept[0], kept[-1]) == (lines[0], lines[-1])
    assert sum("left out here" in line for line in kept) == 1
    assert set(kept) - set(lines) == {next(line for line in kept if "left out here" in line)}  # no line was cut within
    assert "bytes of its middle are left out" in manifest(contents)["files"][0]["incomplete"]


def test_a_full_archive_leaves_the_rest_out_and_says_so() -> None:
    pieces = [Piece(f"{name}.log", "", (name * 99 + "\n").encode() * 500) for name in "uvw"]
    contents = assembled(*pieces, total=70_000)
    assert [each.path for each in contents.members[2:]] == ["u.log", "v.log"]
    assert [(each.path, each.kind) for each in contents.left_out] == [("w.log", TOO_BIG)]
    assert sum(len(each.data) for each in contents.members[2:]) <= 70_000 + 100


def test_data_that_is_too_big_to_stay_json_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(assembly, "JSON_LIMIT", 20_000)
    contents = assembled(Piece("a.json", "", {"x": "y" * 30_000}))
    assert [(each.path, each.kind) for each in contents.left_out] == [("a.json", TOO_BIG)]


def test_json_that_is_nested_beyond_measure_costs_the_others_nothing() -> None:
    deep = b"[" * 100_000 + b'"psk=abcd1234"' + b"]" * 100_000
    contents = assembled(Piece("deep.json", "", deep), Piece("a.log", "", b"fine"))
    assert any(each.path == "a.log" for each in contents.members)
    assert b"abcd1234" not in everything(contents)


@pytest.mark.parametrize("path", ["../../etc/passwd", "/etc/passwd", "a/../../b", "a\nb/..", "…/x", "a/./b"])
def test_a_name_that_leads_out_of_the_archive_stays_in_it(path: str) -> None:
    contents = assembled(Piece(path, "", b"x"))
    name = contents.members[2].path
    assert not name.startswith(("/", "."))
    assert all(part.strip(".") for part in name.split("/"))
    assert name.isprintable()


def test_a_cut_line_is_dropped_rather_than_shown_in_half() -> None:
    data = b"first psk=" + b"a1" * 500 + b"\n" + b"x\n" * 400 + b"last psk=" + b"b2" * 500 + b"\nend\n"
    kept = ends.of_bytes(data, 600)
    assert b"a1a1" not in kept.data or b"psk=a1" in kept.data
    assert b"b2b2" not in kept.data
    assert kept.data.endswith(b"end\n")
    assert ends.of_bytes(b"q" * 1000, 100).data.count(b"q") == 0  # one line: nobody knows what its end belongs to


def test_the_same_contents_give_the_same_archive() -> None:
    contents = assembled(Piece("a.log", "", b"x"))
    assert pack(contents.members, "b", 5.0) == pack(contents.members, "b", 5.0)
    with tarfile.open(fileobj=io.BytesIO(pack(contents.members, "b", 5.0))) as tar:
        assert {(entry.mode, entry.uid, entry.uname, entry.mtime) for entry in tar} == {(0o600, 0, "", 5)}
