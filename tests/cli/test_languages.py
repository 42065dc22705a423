"""A laptop in any language, time zone and home: what is typed, written and shown is the same."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

BOOK = """\
name: bücher 家
description: Ein Buch → 家.
steps:
- name: Schreibe → 家
  on: laptop
  file: {path: "DATEI", content: "ü → 家\\n"}
- name: Sage
  on: laptop
  command: {run: "echo 'ü → 家'; printf '\\\\377\\\\n'; touch 'HERE/done'", creates: "HERE/done"}
"""


@pytest.fixture(scope="module")
def locales(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Locales of encodings that are not UTF-8, as old installations have them."""
    folder = tmp_path_factory.mktemp("locales")
    program = shutil.which("localedef")
    if program is None or not Path("/usr/share/i18n/locales/zh_CN").is_file():
        pytest.skip("needs the sources of languages: apt install locales")
    for language, encoding in (("de_DE", "ISO-8859-1"), ("zh_CN", "GB18030")):
        made = [program, "-i", language, "-f", encoding, str(folder / f"{language}.{encoding}")]
        subprocess.run(made, check=True, timeout=60, stderr=subprocess.DEVNULL)
    return folder


@pytest.mark.parametrize("language", ["zz_ZZ.UTF-8", "de_DE.ISO-8859-1", "zh_CN.GB18030"])
def test_a_playbook_its_journal_and_its_files_are_the_same_in_every_language(
    language: str, locales: Path, tmp_path: Path
) -> None:
    home = tmp_path / "my häuschen 家's"
    home.mkdir()
    book = home / "bücher 家.yaml"
    book.write_text(BOOK.replace("DATEI", f"{tmp_path}/datei é").replace("HERE", str(tmp_path)), encoding="utf-8")
    environment = {"PATH": os.environ["PATH"], "HOME": str(home), "LOCPATH": str(locales), "LC_ALL": language}

    def lupin(*words: str) -> str:
        command = [sys.executable, "-m", "lupin_cli.app", *words]
        env = {**environment, "TZ": "Asia/Kathmandu"}
        done = subprocess.run(command, env=env, capture_output=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr.decode(errors="replace")
        return (done.stdout + done.stderr).decode()

    assert "Schreibe → 家" in lupin("play", str(book), "--diff")
    assert (tmp_path / "datei é").read_bytes() == "ü → 家\n".encode()
    told = lupin("journal", "show", "latest")
    assert "ü → 家" in told and "\\xff" in told
