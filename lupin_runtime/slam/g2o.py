"""Pose graphs as g2o text: VERTEX_SE2, EDGE_SE2, FIX; TORO's VERTEX2 and EDGE2 are read too. See docs/formats.md."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.atomic_file import MalformedFile, write_atomically
from lupin_runtime.bounded_file import open_text
from lupin_runtime.cpp_number import parse_number
from lupin_runtime.slam.pose_graph import NOT_SEMIDEFINITE, SINGULAR, Edges, scaled_eigenvalue, tree_guess

# Positions of an information matrix's six numbers in its upper triangle: g2o writes rows, TORO its own order.
_ROW_ORDER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
# A larger id does not fit its array; the square of a larger number is not finite.
_MAX_ID, _MAX_NUMBER = 2**63 - 1, 1e60
_TORO_ORDER = ((0, 0), (0, 1), (1, 1), (2, 2), (0, 2), (1, 2))


@dataclass(frozen=True)
class GraphFile:
    """A pose graph with the ids of its file: `ids` (N,), `poses` (N, 3), `edges` by index, `fixed` indices.

    `has_vertices` is False if the file has edges only, from which the poses were computed.
    """

    ids: NDArray[np.int64]
    poses: NDArray[np.floating]
    edges: Edges
    fixed: NDArray[np.int64]
    has_vertices: bool = True


class _Reader:
    """Collects vertices and edges; every method takes the fields after the tag and raises ValueError with the reason."""

    def __init__(self) -> None:
        self.index: dict[int, int] = {}
        self.poses: list[list[float]] = []
        self.fixed: list[tuple[int, int]] = []  # number, line
        self.joins: list[tuple[int, int]] = []
        self.edge_lines: list[int] = []
        self.motions: list[list[float]] = []
        self.information: list[list[float]] = []
        self.line = 0

    def vertex(self, fields: list[str]) -> None:
        _expect(fields, 4, "id x y yaw")
        number = _number(fields[0])
        if number in self.index:
            raise ValueError(f"vertex {number} is defined twice")
        self.index[number] = len(self.poses)
        self.poses.append(_finite(fields[1:4]))

    def edge(self, fields: list[str], order: tuple[tuple[int, int], ...]) -> None:
        _expect(fields, 11, "from to dx dy dyaw and six numbers of the information matrix")
        matrix = np.zeros((3, 3))
        for value, (row, column) in zip(_finite(fields[5:11]), order):
            matrix[row, column] = matrix[column, row] = value
        if scaled_eigenvalue(matrix) < -SINGULAR:
            raise ValueError(f"the information matrix is {NOT_SEMIDEFINITE}")
        self.joins.append((_number(fields[0]), _number(fields[1])))
        self.motions.append(_finite(fields[2:5]))
        self.information.append(matrix.ravel().tolist())
        self.edge_lines.append(self.line)

    def fix(self, fields: list[str]) -> None:
        self.fixed += [(_number(field), self.line) for field in fields]


_TAGS: dict[str, Callable[[_Reader, list[str]], None]] = {
    "VERTEX_SE2": _Reader.vertex,
    "VERTEX2": _Reader.vertex,
    "EDGE_SE2": lambda reader, fields: reader.edge(fields, _ROW_ORDER),
    "EDGE2": lambda reader, fields: reader.edge(fields, _TORO_ORDER),
    "FIX": _Reader.fix,
    "PARAMS_SE2OFFSET": lambda _reader, _fields: None,  # the pose of a sensor on the robot: neither vertex nor edge
}


# Tags of graphs that have more than poses in the plane, with what they are.
_OTHER_GRAPHS = (
    (re.compile(r"VERTEX_XY|EDGE_SE2_XY.*|EDGE_SE2_POINTXY.*|EDGE_BEARING_SE2_XY|LANDMARK.*"), "a landmark or an edge to one"),
    (re.compile(r"(VERTEX|EDGE)(_SE3|3|_TRACKXYZ|_PROJECT).*"), "of a 3-D graph"),
    (re.compile(r"EDGE_(SE2_)?PRIOR.*"), "a prior of a single pose"),
)


def _unreadable(tag: str) -> str:
    kind = next((f", {meaning}" for tags, meaning in _OTHER_GRAPHS if tags.fullmatch(tag)), "")
    return f"expected one of {', '.join(_TAGS)}, found {tag!r}{kind}: only poses in the plane and edges between them are read"


def _expect(fields: list[str], count: int, meaning: str) -> None:
    if len(fields) < count:  # g2o passes over what follows on the line
        raise ValueError(f"expected {count} fields ({meaning}), found {len(fields)}")


def _number(field: str) -> int:
    if not re.fullmatch(r"[+-]?\d{1,30}", field, re.ASCII):
        raise ValueError(f"expected a vertex id, which is a whole number, found {field!r}")
    number = int(field)
    if not -_MAX_ID <= number <= _MAX_ID:
        raise ValueError(f"{number} is not a vertex id: expected at most {_MAX_ID}")
    return number


def _finite(fields: list[str]) -> list[float]:
    values = []
    for field in fields:
        if (value := parse_number(field)) is None:
            if parse_number(field.replace(",", ".")) is not None:
                raise ValueError(
                    f"decimal commas: expected {field.replace(',', '.')}, found {field}; save the graph with LC_NUMERIC=C, "
                    "or replace the commas by points"
                )
            raise ValueError(f"expected a number, found {field!r}")
        values.append(value)
    if not (np.isfinite(values).all() and max(map(abs, values)) <= _MAX_NUMBER):
        raise ValueError(f"expected finite numbers up to {_MAX_NUMBER:g}, found {' '.join(fields)}")
    return values


def read_g2o(path: Path) -> GraphFile:
    """Read a graph; the poses of one without vertices, as data sets are published, follow from its edges.

    Raises MalformedFile, naming the line, and OSError.
    """
    reader = _Reader()
    with open_text(path) as lines:
        for reader.line, text in enumerate(lines, start=1):
            fields = text.split("#", 1)[0].split()
            if not fields:
                continue
            take = _TAGS.get(fields[0])
            if take is None:
                raise MalformedFile(path, reader.line, _unreadable(fields[0]))
            try:
                take(reader, fields[1:])
            except ValueError as error:
                raise MalformedFile(path, reader.line, f"{fields[0]}: {error}") from None
    has_vertices = bool(reader.poses)
    if not has_vertices and not reader.joins:
        raise MalformedFile(path, None, "neither a VERTEX_SE2 nor an EDGE_SE2 line: expected a 2-D pose graph")
    if not has_vertices:
        numbers = sorted({number for join in reader.joins for number in join})
        reader.index = {number: index for index, number in enumerate(numbers)}
    for (tail, head), line in zip(reader.joins, reader.edge_lines):
        missing = [number for number in (tail, head) if number not in reader.index]
        if missing:
            raise MalformedFile(path, line, f"the edge names vertex {missing[0]}, which no VERTEX_SE2 line defines")
        if tail == head:
            raise MalformedFile(path, line, f"the edge joins vertex {tail} with itself")
    for number, line in reader.fixed:
        if number not in reader.index:
            defines = "no VERTEX_SE2 line defines" if has_vertices else "no edge names"
            raise MalformedFile(path, line, f"FIX names vertex {number}, which {defines}")
    ends = np.array([(reader.index[a], reader.index[b]) for a, b in reader.joins], dtype=np.int64).reshape(-1, 2)
    edges = Edges(
        ends[:, 0].copy(),
        ends[:, 1].copy(),
        np.array(reader.motions, dtype=float).reshape(-1, 3),
        np.array(reader.information, dtype=float).reshape(-1, 3, 3),
    )
    fixed = np.array([reader.index[number] for number, _ in reader.fixed], dtype=np.int64)
    return GraphFile(
        ids=np.array(list(reader.index), dtype=np.int64),
        poses=np.array(reader.poses) if has_vertices else tree_guess(len(reader.index), edges, fixed),
        edges=edges,
        fixed=fixed,
        has_vertices=has_vertices,
    )


def write_g2o(path: Path, graph: GraphFile) -> None:
    """Write a graph atomically, every number in full precision."""
    lines = [f"VERTEX_SE2 {number} {x!r} {y!r} {yaw!r}" for number, (x, y, yaw) in zip(graph.ids, graph.poses.tolist())]
    lines += [f"FIX {graph.ids[index]}" for index in graph.fixed]
    edges = graph.edges
    for tail, head, motion, information in zip(edges.tail, edges.head, edges.motion.tolist(), edges.information.tolist()):
        numbers = [*motion, *(information[row][column] for row, column in _ROW_ORDER)]
        lines.append(f"EDGE_SE2 {graph.ids[tail]} {graph.ids[head]} {' '.join(map(repr, numbers))}")
    write_atomically(path, "\n".join(lines) + "\n", sync=True)
