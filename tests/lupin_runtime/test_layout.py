"""Layout files: what is read from them, and which errors a broken one gives."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lupin_runtime.layout import LayoutError, LayoutText, Table, TagLocation, load_layout, packaged_layout_path


def test_packaged_layout_has_its_tables_and_tags() -> None:
    layout = load_layout()
    assert packaged_layout_path().name == "tag_locations.json"
    assert (len(layout.tables), len(layout.tags)) == (10, 29)
    assert layout.tags["12"] == TagLocation(1.6, 3.2)
    assert layout.tables["Table6"] == Table(1.3, 1.55, 2.6, 3.7)


def test_load_layout_converts_units_to_meters(tmp_path: Path) -> None:
    path = tmp_path / "layout.json"
    path.write_text(json.dumps({"units": "cm", "tables": {}, "tags": {"1": {"x": 150, "y": -20}}}))
    assert load_layout(path).tags["1"] == TagLocation(1.5, -0.2)


def test_sensors_of_each_tag_are_read() -> None:
    text = LayoutText(
        '{"tags": {"1": {"x": 1, "y": 2, "sensors": ["co2"]}, "2": {"x": 0, "y": 0, "sensors": []}}}', "layout.json"
    )
    assert text.sensors() == {"1": ("co2",), "2": ()}
    assert LayoutText.read(packaged_layout_path()).sensors()["12"] == ("temperature", "humidity", "co2")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{}", "layout.json:1: tags must be an object, found nothing"),
        ('{\n"tags": 3}', "layout.json:2: tags must be an object, found 3"),
        ('{"tags": {\n"1": {"x": 1, "y": 2}}}', "layout.json:2: tags.1.sensors must be a list of names, found nothing"),
        ('{"tags": {\n"1": {"sensors": [1]}}}', "layout.json:2: tags.1.sensors must be a list of names, found [1]"),
    ],
)
def test_layout_without_sensors_is_refused_where_needed(text: str, expected: str) -> None:
    with pytest.raises(LayoutError) as caught:
        LayoutText(text, "layout.json").sensors()
    assert str(caught.value) == expected


def test_load_layout_orders_swapped_corners(tmp_path: Path) -> None:
    path = tmp_path / "layout.json"
    path.write_text(json.dumps({"tables": {"A": {"x0": 1, "x1": 0, "y0": 2, "y1": -1}}}))
    assert load_layout(path).tables["A"] == Table(0.0, 1.0, -1.0, 2.0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('{"tags": {\n "1": {"x": 1, }}}', ":2: not JSON"),
        ("[]", "the file must be an object, found []"),
        ('{\n"units": "ft"}', ":2: units must be one of m, cm, mm, found 'ft'"),
        ('{"units": []}', ":1: units must be one of m, cm, mm, found []"),
        ('{"tags": {"1": {"x": 1}}}', ":1: tags.1.y must be a number, found nothing"),
        ('{"tags": {\n"1": {"x": "a", "y": 1}}}', ":2: tags.1.x must be a number, found 'a'"),
        ('{"tags": {"1": {"x": true, "y": 1}}}', "tags.1.x must be a number, found True"),
        ('{"tags": {"1": []}}', "tags.1 must be an object, found []"),
        ('{"tags": [1]}', ":1: tags must be an object, found [1]"),
        ('{"tables": null}', ":1: tables must be an object, found nothing"),
        ('{"tables": {"A": {"x0": 0, "x1": NaN, "y0": 0, "y1": 1}}}', "tables.A.x1 must be a number, found nan"),
    ],
)
def test_corrupt_layout_error_names_the_place(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "layout.json"
    path.write_text(text)
    with pytest.raises(LayoutError, match=r"layout\.json") as caught:
        load_layout(path)
    assert expected in str(caught.value)


def test_missing_layout_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LayoutError, match="cannot be read"):
        load_layout(tmp_path / "nowhere.json")
