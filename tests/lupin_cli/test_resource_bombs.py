"""Small inputs that would take gigabytes or hours are refused, or read as far as the limits go, in bounded memory."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import pytest

from lupin_cli.connection.inventory import ConfigError, parse
from lupin_cli.playbook.parser import MAX_FILES, MAX_STEPS
from lupin_runtime import graph
from lupin_runtime.record.definitions import schema_text
from lupin_runtime.record.writer import RecordingWriter
from lupin_runtime.slam.map_image import MAX_PLAIN_PIXELS
from tests.support.peak_memory import run_measured

HEADER = "resolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
PLAN = ("--from", "0,0", "--to", "1,1")
# A command that imports numpy and OpenCV has 100 MB; the bombs would take 400 MB to 5 GB.
PEAK_MB = 260.0


def write_png(path: Path, width: int, height: int) -> None:
    """Write a black picture with one bit a pixel, which OpenCV unpacks to a byte a pixel or more."""
    header = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    packed = zlib.compress(bytes((width // 8 + 1) * height), 1)
    chunks = b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in ((b"IHDR", header), (b"IDAT", packed), (b"IEND", b""))
    )
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunks)


def test_map_of_98_megapixels_is_refused(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(f"image: map.pgm\n{HEADER}")
    with (tmp_path / "map.pgm").open("wb") as image:
        image.write(b"P5\n9900 9900\n255\n")
        image.truncate(image.tell() + 9900 * 9900)
    done = run_measured("map", "plan", "map.yaml", *PLAN, cwd=tmp_path)
    assert done.status == 2 and "map.pgm" in done.printed and "limit" in done.printed
    assert done.peak_mb < PEAK_MB


def test_picture_of_400_megapixels_is_refused_as_map(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(f"image: map.png\n{HEADER}")
    write_png(tmp_path / "map.png", 20_000, 20_000)
    done = run_measured("map", "plan", "map.yaml", *PLAN, cwd=tmp_path)
    assert done.status == 2 and "20000 x 20000 pixels" in done.printed
    assert done.peak_mb < PEAK_MB


def test_picture_of_400_megapixels_is_not_searched(tmp_path: Path) -> None:
    write_png(tmp_path / "picture.png", 20_000, 20_000)
    done = run_measured("tags", "detect", "picture.png", cwd=tmp_path)
    assert done.status == 1 and "20000 x 20000 pixels" in done.printed
    assert done.peak_mb < PEAK_MB


def test_plain_map_with_too_many_numbers_is_refused(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(f"image: map.pgm\n{HEADER}")
    (tmp_path / "map.pgm").write_bytes(b"P2\n5000 5000\n255\n" + b"0 " * 10_000_000)
    done = run_measured("map", "plan", "map.yaml", *PLAN, cwd=tmp_path)
    assert done.status == 2 and str(MAX_PLAIN_PIXELS) in done.printed
    assert done.peak_mb < PEAK_MB


def test_recording_that_unpacks_to_gigabytes_is_read_in_parts(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "bomb.mcap")
    channel = writer.add_channel(graph.MAP.name, graph.MAP.type, schema_text(graph.MAP.type), graph.MAP.qos)
    for number in range(6):
        writer.write(channel, b"\0\1\0\0" + bytes((60 if number % 2 else 30) << 20), number, number)
        writer.flush()
    writer.finish()
    assert (tmp_path / "bomb.mcap").stat().st_size < 200_000
    done = run_measured("replay", "--info", "bomb.mcap", cwd=tmp_path)
    assert done.status == 0 and "chunk" in done.printed and graph.MAP.name in done.printed
    assert done.peak_mb < PEAK_MB


def test_includes_that_multiply_are_refused(tmp_path: Path) -> None:
    step = "  - name: Nothing\n    on: laptop\n    command: {run: 'true', unless: 'false'}\n"
    for level in range(7):
        include = "".join(f"  - {{include: book{level + 1}.yaml, name: part {part}}}\n" for part in range(10))
        text = f"name: book{level}\ndescription: Part of a bomb.\nsteps:\n{include if level < 6 else step}"
        (tmp_path / f"book{level}.yaml").write_text(text)
    done = run_measured("play", "--list", "book0.yaml", cwd=tmp_path)
    assert done.status == 2 and f"at most {MAX_FILES} files" in done.printed
    assert done.peak_mb < PEAK_MB


def test_steps_beyond_the_limit_are_refused(tmp_path: Path) -> None:
    steps = "".join(f"  - {{name: n{n}, on: laptop, sweep: {{}}}}\n" for n in range(MAX_STEPS + 2))
    (tmp_path / "long.yaml").write_text(f"name: long\ndescription: Long.\nsteps:\n{steps}")
    done = run_measured("play", "--list", "long.yaml", cwd=tmp_path)
    assert done.status == 2 and f"at most {MAX_STEPS} steps" in done.printed


@pytest.mark.parametrize("value", ["[" * 50_000, "{a=" * 50_000, "9" * 50_000, "a." * 50_000 + "a = 1"])
def test_inventory_that_is_nested_deeply_is_refused(value: str) -> None:
    text = value if value.endswith("= 1") else f"default_robot = {value}"
    with pytest.raises(ConfigError, match=r"lupin\.toml"):
        parse(text, Path("lupin.toml"))
