"""The sparse normal equations of a graph of poses: a symbolic pattern that is made once and filled in every iteration."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, csr_matrix
from scipy.sparse.linalg import splu

Index = NDArray[np.int64]


def adjacency(vertices: int, tail: Index, head: Index) -> csr_matrix:
    """Which vertices an edge joins, as an (N, N) matrix of ones."""
    return csr_matrix((np.ones(len(tail), dtype=np.int8), (tail, head)), shape=(vertices, vertices))


class BlockPattern:
    """Where the blocks of every edge land in the symmetric matrix of the free vertices.

    An edge adds four k x k blocks: tail-tail, tail-head, its (conjugate) transpose, head-head. Held vertices have no rows.
    """

    def __init__(self, vertices: int, tail: Index, head: Index, held: NDArray[np.bool_]) -> None:
        self._row = np.cumsum(~held) - 1
        self._row[held] = -1
        self.free = int((~held).sum())
        self._tail, self._head = self._row[tail], self._row[head]
        self._layouts: dict[int, tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int64], NDArray[np.bool_], Index]] = {}

    def _layout(self, k: int) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int64], NDArray[np.bool_], Index]:
        """CSC column pointers and row indices, the slot of every block entry, which entries exist, the diagonal's slots."""
        if k not in self._layouts:
            rows = np.concatenate((self._tail, self._tail, self._head, self._head))
            columns = np.concatenate((self._tail, self._head, self._tail, self._head))
            keep = (rows >= 0) & (columns >= 0)
            within = np.arange(k)
            r = (rows[keep][:, None, None] * k + within[None, :, None] + 0 * within[None, None, :]).ravel()
            c = (columns[keep][:, None, None] * k + 0 * within[None, :, None] + within[None, None, :]).ravel()
            n = self.free * k
            keys, slots = np.unique(c * n + r, return_inverse=True)
            pointers = np.searchsorted(keys, np.arange(n + 1) * n).astype(np.int32)
            diagonal = np.searchsorted(keys, np.arange(n) * (n + 1))
            self._layouts[k] = (pointers, (keys % n).astype(np.int32), slots.reshape(-1), keep, diagonal)
        return self._layouts[k]

    def assemble(self, tail_tail: NDArray[Any], tail_head: NDArray[Any], head_head: NDArray[Any]) -> csc_matrix:
        """The matrix from the edges' blocks, each (E, k, k), real or complex."""
        k = tail_tail.shape[1]
        pointers, rows, slots, keep, _ = self._layout(k)
        blocks = np.concatenate((tail_tail, tail_head, np.conj(tail_head.transpose(0, 2, 1)), head_head))[keep].ravel()
        if np.iscomplexobj(blocks):
            values = np.bincount(slots, blocks.real, len(rows)) + 1j * np.bincount(slots, blocks.imag, len(rows))
        else:
            values = np.bincount(slots, blocks, len(rows))
        n = self.free * k
        return csc_matrix((values, rows, pointers), shape=(n, n))

    def scatter(self, tail: NDArray[Any], head: NDArray[Any]) -> NDArray[Any]:
        """The vector from the edges' shares, each (E, k)."""
        k = tail.shape[1]
        result = np.zeros((self.free + 1, k), dtype=tail.dtype)  # the last row takes what belongs to held vertices
        np.add.at(result, self._tail, tail)
        np.add.at(result, self._head, head)
        return result[:-1].ravel()

    def solve(self, matrix: csc_matrix, right: NDArray[Any], damping: float = 0.0) -> NDArray[Any]:
        """x of (matrix + damping * diagonal) x = right."""
        if damping > 0.0:
            matrix = matrix.copy()
            matrix.data[self._layout(matrix.shape[0] // max(self.free, 1))[4]] *= 1.0 + damping
        factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        return np.asarray(factor.solve(right))
