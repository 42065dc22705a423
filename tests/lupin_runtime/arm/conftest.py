"""Fixtures of the arm's nodes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

from tests.support.arm_vendor import Console, Vendor

if TYPE_CHECKING:
    from tests.conftest import GraphHost


@pytest.fixture
def vendor(graph_host: GraphHost) -> Iterator[Any]:
    vendor = Vendor(graph_host)
    yield vendor
    vendor.close()


@pytest.fixture
def console(graph_host: GraphHost) -> Any:
    return Console(graph_host)
