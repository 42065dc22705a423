"""Standard map files: a YAML that places an image, and the image as PGM (http://wiki.ros.org/map_server#Map_format)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from lupin_runtime.atomic_file import MalformedFile, write_atomically
from lupin_runtime.bounded_file import read_bounded, read_bounded_text
from lupin_runtime.gridmap import OCCUPIED, UNKNOWN, GridMap
from lupin_runtime.image_size import IMAGE_FORMATS, image_size
from lupin_runtime.yaml_text import compose_yaml

MODES = ("trinary", "scale", "raw")
# Pixel 205 must read back as unknown: its shade, 0.19608, is above 0.196 but below the 0.25 that Nav2's map saver writes.
OCCUPIED_THRESHOLD, FREE_THRESHOLD = 0.65, 0.196
_PIXEL_OCCUPIED, _PIXEL_FREE, _PIXEL_UNKNOWN = 0, 254, 205
MAX_PIXELS = 25_000_000  # 250 m by 250 m at 5 cm; planning takes about 50 bytes for each
MAX_MAP_BYTES = 2 * MAX_PIXELS + 4096  # of the file: two bytes a pixel and a header
MAX_PLAIN_PIXELS = 4_000_000  # of a plain PGM (P2), whose numbers take 40 bytes each while they are read
_MAX_DIGITS = 9
_MAX_ORIGIN_M = 1e6  # a whole number in YAML may even be too large for a float


@dataclass(frozen=True)
class _Header:
    """The YAML's fields, checked."""

    image: str
    resolution: float
    origin: tuple[float, float, float]
    negate: bool
    occupied: float
    free: float
    mode: str


def load_map(path: Path) -> GridMap:
    """Read a map from its YAML. A turned origin is resampled onto the axes of the map frame (nearest cell).

    Raises MalformedFile naming file and line, OSError where a file cannot be opened.
    """
    header = _read_header(path)
    image = path.parent / header.image
    read = _READERS.get(image.suffix.lower())
    if read is None:
        raise MalformedFile(
            path, None, f"expected an image of {', '.join(_READERS)}, found {header.image!r}; convert it: magick IN OUT.pgm"
        )
    try:
        pixels, maximum = read(image)
    except FileNotFoundError:
        raise MalformedFile(path, None, f"its image {image} does not exist") from None
    except OSError as error:
        raise MalformedFile(path, None, f"its image {image} cannot be read: {error.strerror or error}") from None
    grid = GridMap(_cells(pixels, maximum, header), header.resolution, header.origin[0], header.origin[1])
    return grid if header.origin[2] == 0.0 else _upright(grid, header.origin[2])


def save_map(path: Path, grid: GridMap, mode: str = "trinary") -> None:
    """Write `path` (the YAML) and the PGM beside it, both atomically, the image first.

    `trinary` keeps occupied (>= 65), free (<= 19) and unknown; `scale` keeps the grades but has no pixel for unknown; `raw`
    keeps everything. Raises ValueError for a mode that cannot hold the grid, OSError.
    """
    if mode not in MODES:
        raise ValueError(f"expected a mode of {', '.join(MODES)}, found {mode!r}")
    image = path.with_suffix(".pgm")
    pixels = _pixels(grid.cells[::-1], mode)
    write_atomically(image, b"P5\n%d %d\n255\n" % (grid.width, grid.height) + pixels.tobytes(), sync=True)
    occupied, free = (1.0, 0.0) if mode == "scale" else (OCCUPIED_THRESHOLD, FREE_THRESHOLD)
    header = (
        f"image: {image.name}\nmode: {mode}\nresolution: {grid.resolution_m!r}\n"
        f"origin: [{grid.origin_x!r}, {grid.origin_y!r}, 0]\nnegate: 0\noccupied_thresh: {occupied}\nfree_thresh: {free}\n"
    )
    write_atomically(path, header, sync=True)


def _pixels(cells: NDArray[np.int8], mode: str) -> NDArray[np.uint8]:
    if mode == "raw":
        return np.where(cells == UNKNOWN, 255, cells).astype(np.uint8)
    if mode == "scale":
        if (cells == UNKNOWN).any():
            raise ValueError("mode scale has no pixel for unknown cells; use trinary or raw")
        return np.asarray(np.rint(255.0 - cells * 2.55), np.uint8)
    pixels = np.full(cells.shape, _PIXEL_UNKNOWN, np.uint8)
    pixels[cells >= 100 * OCCUPIED_THRESHOLD] = _PIXEL_OCCUPIED
    pixels[(cells >= 0) & (cells <= 100 * FREE_THRESHOLD)] = _PIXEL_FREE
    return pixels


def _cells(pixels: NDArray[np.uint16], maximum: int, header: _Header) -> NDArray[np.int8]:
    return _cell_values(np.arange(maximum + 1, dtype=np.int32), maximum, header)[pixels[::-1]]


def _cell_values(values: NDArray[np.int32], maximum: int, header: _Header) -> NDArray[np.int8]:
    """Return the cell of each possible value of a pixel."""
    if header.mode == "raw":
        return np.where(values <= OCCUPIED, values, UNKNOWN).astype(np.int8)
    shade = values / maximum if header.negate else (maximum - values) / maximum
    cells = np.full(values.shape, UNKNOWN, np.int8)
    if header.mode == "scale":
        ratio = (shade - header.free) / (header.occupied - header.free)
        cells = np.rint(100.0 * np.clip(ratio, 0.0, 1.0)).astype(np.int8)
    cells[shade > header.occupied] = OCCUPIED
    cells[shade < header.free] = 0
    return cells


def _upright(grid: GridMap, yaw: float) -> GridMap:
    """Resample a grid that is turned by `yaw` about its corner onto the frame's axes."""
    c, s = math.cos(yaw), math.sin(yaw)
    width, height = grid.width * grid.resolution_m, grid.height * grid.resolution_m
    xs = [0.0, c * width, c * width - s * height, -s * height]
    ys = [0.0, s * width, s * width + c * height, c * height]
    columns = math.ceil((max(xs) - min(xs)) / grid.resolution_m - 1e-9)
    rows = math.ceil((max(ys) - min(ys)) / grid.resolution_m - 1e-9)
    x = min(xs) + (np.arange(columns) + 0.5) * grid.resolution_m
    y = min(ys) + (np.arange(rows) + 0.5) * grid.resolution_m
    along = np.floor((c * x[None, :] + s * y[:, None]) / grid.resolution_m).astype(np.int64)
    across = np.floor((-s * x[None, :] + c * y[:, None]) / grid.resolution_m).astype(np.int64)
    inside = (along >= 0) & (along < grid.width) & (across >= 0) & (across < grid.height)
    cells = np.full((rows, columns), UNKNOWN, np.int8)
    cells[inside] = grid.cells[across[inside], along[inside]]
    return GridMap(cells, grid.resolution_m, grid.origin_x + min(xs), grid.origin_y + min(ys))


def _read_header(path: Path) -> _Header:
    text = read_bounded_text(path, errors="replace")
    try:
        root = compose_yaml(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or "not YAML"
        raise MalformedFile(path, mark.line + 1 if mark else None, str(problem)) from None
    except RecursionError:
        raise MalformedFile(path, None, "brackets are nested too deeply to be read") from None
    if not isinstance(root, yaml.MappingNode):
        raise MalformedFile(path, 1, "expected keys such as image, resolution, origin")
    fields = _Fields(path, root)
    origin = fields.numbers("origin", 3)
    header = _Header(
        image=fields.text("image"),
        resolution=fields.number("resolution", 1e-6, 1e3),
        origin=(origin[0], origin[1], origin[2]),
        negate=fields.number("negate", 0, 1, 0.0) == 1.0,
        occupied=fields.number("occupied_thresh", 0.0, 1.0),
        free=fields.number("free_thresh", 0.0, 1.0),
        mode=fields.choice("mode", MODES, "trinary"),
    )
    if header.free >= header.occupied:
        raise MalformedFile(
            path,
            fields.line("free_thresh"),
            f"free_thresh {header.free} must be below occupied_thresh {header.occupied}",
        )
    return header


class _Fields:
    """The checked values of a YAML mapping; errors name the line of the key."""

    def __init__(self, path: Path, root: yaml.MappingNode) -> None:
        self._path = path
        self._nodes = {key.value: value for key, value in root.value if isinstance(key, yaml.ScalarNode)}
        self._constructor = yaml.SafeLoader("")

    def line(self, key: str) -> int | None:
        node = self._nodes.get(key)
        return node.start_mark.line + 1 if node is not None else None

    def _value(self, key: str, default: Any = None) -> Any:
        node = self._nodes.get(key)
        if node is None:
            if default is None:
                raise MalformedFile(self._path, None, f"the key {key!r} is missing")
            return default
        try:
            return self._constructor.construct_object(node, deep=True)
        except (yaml.YAMLError, ValueError):
            raise self._refuse(key, "a YAML value", node.value) from None

    def _refuse(self, key: str, expected: str, found: Any) -> MalformedFile:
        return MalformedFile(self._path, self.line(key), f"{key}: expected {expected}, found {found!r}")

    def text(self, key: str) -> str:
        value = self._value(key)
        if not isinstance(value, str) or not value:
            raise self._refuse(key, "a file name", value)
        return value

    def choice(self, key: str, among: tuple[str, ...], default: str) -> str:
        value = self._value(key, default)
        if value not in among:
            raise self._refuse(key, f"one of {', '.join(among)}", value)
        return str(value)

    def number(self, key: str, low: float, high: float, default: float | None = None) -> float:
        value = self._value(key, default)
        if not isinstance(value, (int, float)) or not low <= value <= high:
            raise self._refuse(key, f"a number from {low:g} to {high:g}", value)
        return float(value)

    def numbers(self, key: str, count: int) -> list[float]:
        value = self._value(key)
        if (
            not isinstance(value, list)
            or len(value) != count
            or not all(isinstance(v, (int, float)) and abs(v) <= _MAX_ORIGIN_M for v in value)
        ):
            raise self._refuse(key, f"{count} numbers", value)
        return [float(v) for v in value]


def _read_pgm(path: Path) -> tuple[NDArray[np.uint16], int]:
    """Read the pixels (height, width), top row first, and the value of white."""
    data = read_bounded(path, MAX_MAP_BYTES)
    magic = data[:2]
    if magic not in (b"P5", b"P2"):
        raise MalformedFile(path, 1, f"expected a PGM image (P5 or P2), found {magic!r}")
    numbers: list[int] = []
    at, line = 2, 1
    while len(numbers) < 3:
        while at < len(data) and (data[at : at + 1].isspace() or data[at : at + 1] == b"#"):
            if data[at : at + 1] == b"#":
                end = data.find(b"\n", at)
                at = len(data) if end < 0 else end
                continue
            line += data[at : at + 1] == b"\n"
            at += 1
        end = at
        while end < len(data) and data[end : end + 1].isdigit():
            end += 1
        if end == at:
            raise MalformedFile(path, line, f"expected width, height and white in the header, found {data[at : at + 8]!r}")
        if end - at > _MAX_DIGITS:
            raise MalformedFile(path, line, f"a number of {end - at} digits in the header")
        numbers.append(int(data[at:end]))
        at = end
    width, height, maximum = numbers
    if not (width > 0 and height > 0 and 0 < maximum < 65536):
        raise MalformedFile(path, line, f"{width} x {height} pixels with white {maximum} are not a map")
    _check_size(path, width, height, MAX_PIXELS if magic == b"P5" else MAX_PLAIN_PIXELS, line)
    if magic == b"P2":
        try:
            values = np.array(data[at:].split(maxsplit=width * height)[: width * height], dtype=np.uint64)
        except (ValueError, OverflowError):
            raise MalformedFile(path, line, f"a pixel is not a number from 0 to {maximum}") from None
    else:
        values = np.frombuffer(
            memoryview(data)[at + 1 :],
            dtype=np.uint8 if maximum < 256 else ">u2",
            count=min(width * height, max(0, len(data) - at - 1) // (1 if maximum < 256 else 2)),
        )
    if len(values) < width * height:
        raise MalformedFile(path, None, f"expected {width * height} pixels, found {len(values)}: the file is truncated")
    return np.minimum(values, maximum).astype(np.uint16).reshape(height, width), maximum


def _check_size(path: Path, width: int, height: int, limit: int, line: int | None = None) -> None:
    if width * height > limit:
        problem = f"{width} x {height} pixels are more than the {limit} that a map may have; crop it, or use larger cells"
        raise MalformedFile(path, line, problem)


def _read_image(path: Path) -> tuple[NDArray[np.uint16], int]:
    """Read an image as `_read_pgm` does; colors become gray, transparent pixels the gray of unknown cells."""
    import cv2

    content = read_bounded(path, MAX_MAP_BYTES)
    if (size := image_size(content)) is None:
        raise MalformedFile(path, None, f"expected {IMAGE_FORMATS}, found {len(content)} bytes that are none, or a damaged one")
    _check_size(path, *size, MAX_PIXELS)
    data = np.frombuffer(content, np.uint8)
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except cv2.error as error:  # more pixels than OpenCV takes
        raise MalformedFile(path, None, f"OpenCV refuses the image: {error}") from None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise MalformedFile(path, None, f"expected an image, found {len(data)} bytes that OpenCV cannot read as gray or color")
    _check_size(path, image.shape[1], image.shape[0], MAX_PIXELS)
    maximum = int(np.iinfo(image.dtype).max)
    gray = image if image.ndim == 2 else image[:, :, :3].mean(axis=2)
    if image.ndim == 3 and image.shape[2] == 4:
        gray = np.where(image[:, :, 3] < maximum, maximum * _PIXEL_UNKNOWN / 255.0, gray)
    return np.rint(gray).astype(np.uint16), maximum


_READERS: dict[str, Callable[[Path], tuple[NDArray[np.uint16], int]]] = {
    ".pgm": _read_pgm,
    ".pnm": _read_pgm,
    ".png": _read_image,
    ".bmp": _read_image,
}
