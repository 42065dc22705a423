"""A laptop with any locale, time zone and home directory reads, writes and prints the same text."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PLAYBOOK = """\
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
    """Compiled locales whose encodings are not UTF-8, as on old installations."""
    folder = tmp_path_factory.mktemp("locales")
    program = shutil.which("localedef")
    if program is None or not Path("/usr/share/i18n/locales/zh_CN").is_file():
        pytest.skip("needs locale sources: apt install locales")
    for language, encoding in (("de_DE", "ISO-8859-1"), ("zh_CN", "GB18030")):
        command = [program, "-i", language, "-f", encoding, str(folder / f"{language}.{encoding}")]
        subprocess.run(command, check=True, timeout=60, stderr=subprocess.DEVNULL)
    return folder


@pytest.mark.parametrize("language", ["zz_ZZ.UTF-8", "de_DE.ISO-8859-1", "zh_CN.GB18030"])
def test_playbook_and_journal_are_equal_in_every_locale(language: str, locales: Path, tmp_path: Path) -> None:
    home = tmp_path / "my häuschen 家's"
    home.mkdir()
    playbook = home / "bücher 家.yaml"
    playbook.write_text(PLAYBOOK.replace("DATEI", f"{tmp_path}/datei é").replace("HERE", str(tmp_path)), encoding="utf-8")
    environment = {"PATH": os.environ["PATH"], "HOME": str(home), "LOCPATH": str(locales), "LC_ALL": language}

    def lupin(*words: str) -> str:
        command = [sys.executable, "-m", "lupin_cli.app", *words]
        env = {**environment, "TZ": "Asia/Kathmandu"}
        done = subprocess.run(command, env=env, capture_output=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr.decode(errors="replace")
        return (done.stdout + done.stderr).decode()

    assert "Schreibe → 家" in lupin("play", str(playbook), "--diff")
    assert (tmp_path / "datei é").read_bytes() == "ü → 家\n".encode()
    shown = lupin("journal", "show", "latest")
    assert "ü → 家" in shown and "\\xff" in shown
