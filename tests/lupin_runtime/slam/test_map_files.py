"""Map files by the rules of Nav2's map_server, each tried at its edges, and where ours is safer than it.

The rules, of nav2_map_server/src/map_io.cpp and yaml-cpp 0.8:

1. A pixel's shade is the mean of its channels, of 16 bits each; its occupancy 1 - shade, or the shade with `negate`.
2. trinary: occupied above occupied_thresh, else free below free_thresh, else unknown; on a threshold neither.
3. scale: what is not opaque is unknown; above and below as trinary, between them linear, rounded half to even.
4. raw: shade * 255, rounded half away from zero, up to 100; more is unknown. Negate and thresholds do nothing.
5. trinary with alpha: alpha is averaged as if it were a fourth channel.
6. Numbers are text, quoted or not, that a C++ stream takes whole; of a key given twice the first counts; modes in any case.
7. The image's content decides on its format; a relative path starts at the YAML's folder, ~/ at the home folder.

Ours is safer: black is occupied for every threshold; alpha 0 is unknown in every mode; of alpha in trinary, the safer of both
readings counts, and what is not opaque is never free; occupied cells of a turned map are never lost.
"""

from __future__ import annotations

import math
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from lupin_cli.commands.map import app
from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.gridmap import GridMap
from lupin_runtime.slam.map_io import load_map, save_map

Pixel = tuple[int, ...]  # gray; red green blue; with alpha last: of 16 bits each
OPAQUE = 65535


def png(rows: list[list[Pixel]], kind: int, depth: int = 16, extra: bytes = b"") -> bytes:
    """Return a PNG of color type `kind`: 0 gray, 2 color, 4 gray and alpha, 6 color and alpha."""
    packed = b"".join(
        b"\0"
        + b"".join(struct.pack(">H" if depth == 16 else "B", v if depth == 16 else v // 257) for pixel in row for v in pixel)
        for row in rows
    )
    header = struct.pack(">IIBBBBB", len(rows[0]), len(rows), depth, kind, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + extra + chunk(b"IDAT", zlib.compress(packed)) + chunk(b"IEND", b"")


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def write_yaml(folder: Path, **fields: object) -> Path:
    values = {"image": "m.png", "resolution": "0.05", "origin": "[0, 0, 0]", "negate": "0"}
    values |= {"occupied_thresh": "0.65", "free_thresh": "0.25"} | {key: str(value) for key, value in fields.items()}
    (folder / "m.yaml").write_text("".join(f"{key}: {value}\n" for key, value in values.items()))
    return folder / "m.yaml"


def nav2_cell(pixel: Pixel, mode: str, negate: bool, occupied: float, free: float) -> int:
    """Rules 1 to 5 for one pixel, written out: what Nav2 publishes."""
    color, alpha = (pixel[:-1], pixel[-1]) if len(pixel) in (2, 4) else (pixel, None)
    channels = [*color] * (3 // len(color))
    if mode == "trinary" and alpha is not None:
        channels.append(alpha)
    shade = sum(channels) / len(channels) / 65535.0
    occupancy = shade if negate else 1.0 - shade
    if mode == "raw":
        value = math.floor(shade * 255 + 0.5)
        return value if value <= 100 else -1
    if mode == "scale" and alpha not in (None, OPAQUE):
        return -1
    if occupied < occupancy:
        return 100
    if occupancy < free:
        return 0
    return round((occupancy - free) / (occupied - free) * 100.0) if mode == "scale" else -1


LEVELS = st.one_of(
    st.sampled_from([0, 1, 65534, 65535, 205 * 257, 204 * 257, 51 * 257]), st.integers(0, 255).map(lambda v: v * 257)
)
SHARES = st.one_of(st.integers(0, 255).map(lambda v: v / 255), st.sampled_from([0.196, 0.25, 0.65, 0.2, 0.8, 0.999999]))
KINDS = {0: 1, 2: 3, 4: 2, 6: 4}


@settings(max_examples=300)
@given(data=st.data(), kind=st.sampled_from(sorted(KINDS)), mode=st.sampled_from(["trinary", "scale", "raw"]))
def test_cells_are_those_of_nav2_or_safer(
    data: st.DataObject, kind: int, mode: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    low, high = sorted((data.draw(SHARES), data.draw(SHARES)))
    if not low < high < 1.0:
        low, high = 0.25, 0.65
    levels = LEVELS if data.draw(st.booleans()) else st.integers(0, 65535)
    alpha = st.sampled_from([0, 257, 128 * 257, 65278, OPAQUE, OPAQUE])
    pixel = st.tuples(*[levels] * (KINDS[kind] - (kind in (4, 6))), *[alpha] * (kind in (4, 6)))
    pixels: list[Pixel] = data.draw(st.lists(pixel, min_size=12, max_size=12))
    negate = data.draw(st.booleans())
    folder = tmp_path_factory.mktemp("map")
    (folder / "m.png").write_bytes(png([pixels], kind))
    cells = load_map(
        write_yaml(folder, mode=mode, negate=int(negate), occupied_thresh=repr(high), free_thresh=repr(low))
    ).cells[0]
    for found, each in zip(cells.tolist(), pixels):
        nav2 = nav2_cell(each, mode, negate, high, low)
        if kind in (0, 2):
            assert found == nav2, each
            continue
        plain = nav2_cell(each[:-1], mode, negate, high, low)
        if each[-1] == 0:
            assert found == -1
        elif mode == "trinary":
            assert (found == 100) == (100 in (nav2, plain))
            assert (found == 0) == (nav2 == plain == 0 and each[-1] == OPAQUE)
        else:
            assert found == nav2, each


@pytest.mark.parametrize("occupied", ["1", "1.0", "0.65"])
@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_black_wall_is_occupied_for_every_threshold(tmp_path: Path, occupied: str, mode: str) -> None:
    for negate, wall in ((0, 0), (1, OPAQUE)):
        (tmp_path / "m.png").write_bytes(png([[(OPAQUE - wall,), (wall,)]], 0))
        read = load_map(write_yaml(tmp_path, occupied_thresh=occupied, mode=mode, negate=negate))
        assert read.cells.tolist() == [[0, 100]]


def test_no_path_leads_through_a_black_wall_or_an_erased_band(tmp_path: Path) -> None:
    """Across a room with a band of one kind: erased in an editor (its color stays below), or black with occupied_thresh 1."""
    floor, erased, black = (254 * 257, OPAQUE), (254 * 257, 0), (0, OPAQUE)
    cases: list[tuple[Pixel, dict[str, object]]] = [(erased, {"mode": "raw"}), (black, {"occupied_thresh": "1.0"})]
    cases += [
        (erased, {"mode": mode, "negate": negate, "free_thresh": free})
        for mode in ("trinary", "scale")
        for negate in (0, 1)
        for free in (0.1, 0.196, 0.25)
    ]
    for band, fields in cases:
        row = [floor] * 25 + [band] * 6 + [floor] * 25
        (tmp_path / "m.png").write_bytes(png([row] * 30, 4))
        path = write_yaml(tmp_path, **fields)
        options = ["--from", "0.5,0.7", "--to", "2.3,0.7", *([] if band == black else ["--no-unknown"])]
        result = CliRunner().invoke(app, ["plan", str(path), *options])
        assert result.exit_code == 1, (fields, result.output)


def test_gray_that_a_png_declares_transparent_is_unknown(tmp_path: Path) -> None:
    extra = chunk(b"tRNS", struct.pack(">H", 254))
    (tmp_path / "m.png").write_bytes(png([[(254 * 257,), (255 * 257,)]], 0, 8, extra))
    assert load_map(write_yaml(tmp_path)).cells.tolist() == [[-1, 0]]


def test_palette_with_a_transparent_entry_is_unknown_there(tmp_path: Path) -> None:
    colors = chunk(b"PLTE", bytes([0, 0, 0, 254, 254, 254, 254, 254, 254])) + chunk(b"tRNS", bytes([255, 255, 0]))
    (tmp_path / "m.png").write_bytes(png([[(0,), (257,), (514,)]], 3, 8, colors))
    assert load_map(write_yaml(tmp_path)).cells.tolist() == [[100, 0, -1]]


@pytest.mark.parametrize("white", [1, 3, 100, 255, 1023, 65535])
@pytest.mark.parametrize("magic", ["P2", "P3", "P5", "P6"])
def test_netpbm_of_any_white_is_read(tmp_path: Path, magic: str, white: int) -> None:
    """GraphicsMagick scales to 16 bits, rounding half up: 50 of 100 becomes 32768."""
    values = [0, white // 2, white]
    pixels = [value for value in values for _ in range(3 if magic in ("P3", "P6") else 1)]
    plain = " ".join(map(str, pixels)).encode() + b"\n"
    binary = struct.pack(f">{len(pixels)}{'B' if white < 256 else 'H'}", *pixels)
    (tmp_path / "m.pgm").write_bytes(
        f"{magic}\n# by hand\n3 1\n{white}\n".encode() + (plain if magic in ("P2", "P3") else binary)
    )
    levels = [(65535 * value + white // 2) // white for value in values]
    read = load_map(write_yaml(tmp_path, image="m.pgm", mode="scale")).cells.tolist()
    assert read == [[nav2_cell((level,), "scale", False, 0.65, 0.25) for level in levels]]


def test_content_of_an_image_decides_on_its_format(tmp_path: Path) -> None:
    (tmp_path / "m.pgm").write_bytes(png([[(0,), (OPAQUE,)]], 0))
    assert load_map(write_yaml(tmp_path, image="m.pgm")).cells.tolist() == [[100, 0]]
    for name, is_written in (
        (name, cv2.imwrite(str(tmp_path / f"m.{name}"), np.array([[0, 255]], np.uint8))) for name in ("bmp", "tif")
    ):
        assert is_written and load_map(write_yaml(tmp_path, image=f"m.{name}")).cells.tolist() == [[100, 0]]


NUMBERS = {
    "5e-2": 0.05, "5E-2": 0.05, '"0.050000"': 0.05, "'5e-02'": 0.05, "+.05": 0.05, "1.": 1.0, "1e-16": None, "1_000": None,
    "1:30": None, "0x10": None, "0,05": None, ".inf": None, "5 cm": None, "~": None, "": None, "yes": None, "1e400": None,
}  # fmt: skip


@pytest.mark.parametrize("text", NUMBERS)
def test_numbers_are_those_of_a_cpp_stream(tmp_path: Path, text: str) -> None:
    (tmp_path / "m.png").write_bytes(png([[(0,)]], 0))
    path = write_yaml(tmp_path, resolution=text, origin="[-1.0, 1e-16, '0']")
    if (value := NUMBERS[text]) is None:
        with pytest.raises(MalformedFile, match=r"m.yaml:2: resolution: expected a number from 1e-06 to 1000, found"):
            load_map(path)
    else:
        read = load_map(path)
        assert (read.resolution_m, read.origin_x, read.origin_y) == (value, -1.0, 1e-16)


@pytest.mark.parametrize(
    ("field", "text", "says"),
    [
        ("origin", "[0.0, 0.0, -nan]", r"m.yaml:3: origin: the yaw is NaN: "),
        ("origin", "[.NaN, 0.0, 0]", r"m.yaml:3: origin: the x is NaN: "),
        ("resolution", "nan", r"m.yaml:2: resolution: the resolution is NaN: "),
        ("origin", "[0.0, 0.0]", r"m.yaml:3: origin: expected 3 numbers \(x, y, yaw\), found \['0.0', '0.0'\]"),
        ("origin", "[0, 0, 0, 0]", r"m.yaml:3: origin: expected 3 numbers"),
        ("origin", "0", r"m.yaml:3: origin: expected 3 numbers"),
        ("origin", "&list [*list, 0]", r"m.yaml:3: origin: expected 3 numbers .*, found \[a list or mapping, '0'\]"),
        ("resolution", "&list [*list]", r"m.yaml:2: resolution: expected a number from .*, found \[a list or mapping\]"),
        ("negate", "maybe", r"m.yaml:4: negate: expected 0, 1 or a truth value, found 'maybe'"),
        ("mode", "binary", r"m.yaml:7: mode: expected one of trinary, scale, raw, found 'binary'"),
        ("occupied_thresh", "65", r"m.yaml:5: occupied_thresh: expected a number from 0 to 1"),
    ],
)
def test_value_that_cannot_be_used_is_named(tmp_path: Path, field: str, text: str, says: str) -> None:
    with pytest.raises(MalformedFile, match=says):
        load_map(write_yaml(tmp_path, **{field: text}))


@pytest.mark.parametrize("text", ["1", "true", "Yes", "ON", '"1"', "y"])
def test_negate_takes_the_truth_values_of_yaml_cpp(tmp_path: Path, text: str) -> None:
    (tmp_path / "m.png").write_bytes(png([[(0,), (OPAQUE,)]], 0))
    assert load_map(write_yaml(tmp_path, negate=text)).cells.tolist() == [[0, 100]]


def test_first_of_two_equal_keys_counts_and_modes_ignore_case(tmp_path: Path) -> None:
    (tmp_path / "m.png").write_bytes(png([[(0x8000,)]], 0))
    path = write_yaml(tmp_path, mode="Scale")
    path.write_text(path.read_text() + "resolution: 7\nmode: raw\n")
    read = load_map(path)
    assert (read.resolution_m, read.cells.tolist()) == (0.05, [[62]])


def test_tilde_is_the_home_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps/m.png").write_bytes(png([[(OPAQUE,)] * 40] * 40, 0))
    write_yaml(tmp_path, image="~/maps/m.png")
    result = CliRunner().invoke(app, ["plan", "~/m.yaml", "--from=0.5,0.5", "--to=1.5,1.5"])
    assert result.exit_code == 0, result.output


def test_free_205_is_read_as_nav2_does_and_named(tmp_path: Path) -> None:
    (tmp_path / "m.png").write_bytes(png([[(0,), (205 * 257,), (205 * 257,), (254 * 257,)]], 0, 8))
    told: list[str] = []
    assert load_map(write_yaml(tmp_path), told.append).cells.tolist() == [[100, 0, 0, 0]]
    (text,) = told
    assert "2 pixels of the gray 205" in text and "free_thresh 0.25: the map has no unknown cells" in text
    assert load_map(write_yaml(tmp_path, free_thresh=0.196), told.append).cells.tolist() == [[100, -1, -1, 0]]
    assert len(told) == 1
    result = CliRunner().invoke(app, ["plan", str(write_yaml(tmp_path)), "--from=0.1,0", "--to=0.2,0", "--json"])
    assert "gray 205" in result.stderr


@settings(max_examples=50)
@given(yaw=st.floats(-math.pi, math.pi), row=st.integers(0, 8), column=st.integers(0, 11))
def test_turned_map_keeps_every_obstacle(yaw: float, row: int, column: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    cells = np.zeros((9, 12), np.int8)
    cells[row, column] = 100
    path = tmp_path_factory.mktemp("map") / "m.yaml"
    save_map(path, GridMap(cells, 0.1, 0.0, 0.0))
    path.write_text(path.read_text().replace("0.0, 0]", f"0.0, {yaw!r}]"))
    assert (load_map(path).cells == 100).any()
