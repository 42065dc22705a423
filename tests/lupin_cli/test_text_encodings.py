"""Every text file that a person edits may begin with a byte order mark; another encoding is named, with the file."""

from __future__ import annotations

import codecs
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from lupin_cli.connection.inventory import load as load_inventory
from lupin_cli.playbook import load as load_playbook
from lupin_runtime.cameras.configuration import read_configuration
from lupin_runtime.greenhouse.climate_simulator import check_config_file
from lupin_runtime.layout import load_layout
from lupin_runtime.mission.overrides import load_overrides
from lupin_runtime.perception.calibration_file import load_calibration
from lupin_runtime.slam.carmen import read_carmen
from lupin_sim.scoring import read_tum


class Kind(NamedTuple):
    """A kind of text file: its reader, and a valid text of it."""

    name: str
    read: Callable[[Path], Any]
    text: str


_SCAN = f"FLASER 180 {'2.0 ' * 180}0 0 0 0 0 0 1.0 host 1.0\n"
KINDS = (
    Kind("inventory", load_inventory, '[robots.rosa]\naddresses = {wired = "192.0.2.7"}\n'),
    Kind(
        "playbook",
        load_playbook,
        "name: text\ndescription: A.\nsteps:\n- name: A\n  on: robot\n  file: {path: /etc/a, content: b}\n",
    ),
    Kind("layout", load_layout, '{"tables": {}, "tags": {"7": {"x": 1.0, "y": 2.0}}}'),
    Kind("approach overrides", load_overrides, "overrides: {t7: {yaw: 1.5}}\n"),
    Kind("cameras", read_configuration, "depth: {enabled: true}\n"),
    Kind("climate", check_config_file, "sensors: {}\n"),
    Kind("calibration", load_calibration, "image_width: 640\ncamera_matrix: {data: [500, 0, 320, 0, 500, 240, 0, 0, 1]}\n"),
    Kind("trajectory", read_tum, "1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n"),
    Kind("CARMEN log", read_carmen, _SCAN * 2),
)
_BY_NAME = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)


@_BY_NAME
def test_byte_order_mark_changes_nothing(kind: Kind, tmp_path: Path) -> None:
    path = tmp_path / "text.yaml"
    results = []
    for mark in (b"", codecs.BOM_UTF8):
        path.write_bytes(mark + kind.text.encode())
        results.append(repr(kind.read(path)))
    assert results[0] == results[1]


@_BY_NAME
@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le"])
def test_other_encoding_is_refused_by_name(kind: Kind, encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "text.yaml"
    path.write_bytes(kind.text.encode(encoding))
    with pytest.raises(Exception, match="is UTF-16; save it as UTF-8") as refused:
        kind.read(path)
    assert str(path) in str(refused.value)
