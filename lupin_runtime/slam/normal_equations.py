"""The sparse normal equations of a pose graph: its elimination order and pattern are computed once."""

from __future__ import annotations

from ctypes import c_int, c_int64
from pathlib import Path
from typing import Any

import numpy as np
from numpy.ctypeslib import ndpointer
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix, identity
from scipy.sparse.linalg import splu

from lupin_runtime.native import load_kernels

Array = NDArray[np.floating]
Index = NDArray[np.int64]

_F = ndpointer(np.float64, flags="C_CONTIGUOUS")
_I = ndpointer(np.int32, flags="C_CONTIGUOUS")
_L = ndpointer(np.int64, flags="C_CONTIGUOUS")
_B = ndpointer(np.uint8, flags="C_CONTIGUOUS")
_library = load_kernels(Path(__file__).parent)
_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "block_symbolic": (c_int64, [c_int, _I, _I, _I, _I, _I]),
    "add_blocks": (None, [_F, _I, _B, c_int, c_int, _F]),
    "block_factor": (c_int, [c_int, c_int, _I, _I, _F, _F, _I, _L, _I, _F, _L, _I, _I, _F]),
    "block_solve": (None, [c_int, c_int, _L, _I, _F, _F]),
}
for _name, (_result, _arguments) in _SIGNATURES.items():
    _function = getattr(_library, _name)
    _function.restype, _function.argtypes = _result, _arguments


class Indefinite(ArithmeticError):
    """The matrix is not positive definite: these equations have no minimum."""


def adjacency(vertices: int, tail: Index, head: Index) -> csr_matrix:
    """The adjacency of the vertices: an (N, N) matrix with ones where an edge joins two."""
    return csr_matrix((np.ones(len(tail), dtype=np.int8), (tail, head)), shape=(vertices, vertices))


def elimination_order(vertices: int, tail: Index, head: Index) -> Index:
    """An order of the vertices with little fill-in: SuperLU's minimum degree on the graph's Laplacian."""
    if vertices < 3:
        return np.arange(vertices, dtype=np.int64)
    joined = coo_matrix((np.full(len(tail), -1.0), (tail, head)), shape=(vertices, vertices))
    laplacian = (joined + joined.T).tocsc() + identity(vertices, format="csc") * (2.0 * len(tail) + 1.0)
    factor = splu(csc_matrix(laplacian), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return np.argsort(np.asarray(factor.perm_c, dtype=np.int64))


class BlockPattern:
    """The position of every edge's blocks in the symmetric matrix of the free vertices, in elimination order.

    An edge adds a block to each of its two vertices and one between them. Held vertices have no rows.
    """

    def __init__(self, vertices: int, tail: Index, head: Index, held: NDArray[np.bool_]) -> None:
        free = np.flatnonzero(~held)
        self.size = len(free)
        at = np.full(vertices, -1, dtype=np.int64)
        at[free] = np.arange(self.size)
        both = ~held[tail] & ~held[head]
        order = elimination_order(self.size, at[tail[both]], at[head[both]])
        self._vertex = free[order]  # the vertex of every row
        row = np.full(vertices, -1, dtype=np.int64)
        row[self._vertex] = np.arange(self.size)
        self._tail, self._head = row[tail].astype(np.int32), row[head].astype(np.int32)
        low, high = np.minimum(self._tail, self._head), np.maximum(self._tail, self._head)
        # Upper blocks, by column: parallel edges share one.
        keys = high.astype(np.int64) * max(self.size, 1) + low
        joined = np.flatnonzero(both)
        unique, slot = np.unique(keys[joined], return_inverse=True)
        self._between = np.full(len(tail), -1, np.int32)
        self._between[joined] = slot.reshape(-1)
        self._flip = (self._tail > self._head).astype(np.uint8)
        self._straight = np.zeros(len(tail), np.uint8)
        n = max(self.size, 1)
        self._rows = (unique % n).astype(np.int32)
        self._starts = np.searchsorted(unique // n, np.arange(self.size + 1)).astype(np.int32)
        self._parent, count, self._mark = (np.empty(self.size, np.int32) for _ in range(3))
        total = _library.block_symbolic(self.size, self._starts, self._rows, self._parent, count, self._mark)
        self._columns = np.concatenate(([0], np.cumsum(count, dtype=np.int64)))
        self._low_rows = np.empty(total, np.int32)
        self._filled, self._stack = np.empty(self.size, np.int64), np.empty(self.size, np.int32)

    def solve(
        self, tail_tail: Array, tail_head: Array, head_head: Array, tail_rhs: Array, head_rhs: Array, damping: float = 0.0
    ) -> Array:
        """Solve (sum of blocks) x = (sums of `tail_rhs` and `head_rhs` (E, k) over the edges) for x.

        x is (N, k) with a row for every vertex up to the last free one, and zeros for held vertices.
        Blocks are (E, k, k), k 2 or 3; the diagonal is multiplied by 1 + `damping`. Raises Indefinite.
        """
        k = tail_tail.shape[1]
        diagonal, upper = np.zeros((self.size, k, k)), np.zeros((len(self._rows), k, k))
        right = np.zeros((self.size + 1, k))  # the last row takes what belongs to held vertices
        for blocks, to, flip, into in (
            (tail_tail, self._tail, self._straight, diagonal),
            (head_head, self._head, self._straight, diagonal),
            (tail_head, self._between, self._flip, upper),
        ):
            _library.add_blocks(np.ascontiguousarray(blocks), to, flip, len(to), k, into)
        for column in range(k):
            right[:, column] = np.bincount(self._tail + 1, tail_rhs[:, column], self.size + 1)
            right[:, column] += np.bincount(self._head + 1, head_rhs[:, column], self.size + 1)
        if damping > 0.0:
            within = np.arange(k)
            present = diagonal[:, within, within]  # a zero has zeros in its whole row: any damping makes it definite
            diagonal[:, within, within] = np.where(present == 0.0, damping, present * (1.0 + damping))
        low, scratch = np.empty((len(self._low_rows), k, k)), np.empty((self.size, k, k))
        if not _library.block_factor(
            self.size, k, self._starts, self._rows, upper, diagonal, self._parent, self._columns, self._low_rows, low,
            self._filled, self._mark, self._stack, scratch,
        ):  # fmt: skip
            raise Indefinite("the normal equations are not positive definite")
        solution = np.ascontiguousarray(right[1:])
        _library.block_solve(self.size, k, self._columns, self._low_rows, low, solution)
        result = np.zeros((self.size if not len(self._vertex) else int(self._vertex.max()) + 1, k))
        result[self._vertex] = solution
        return result
