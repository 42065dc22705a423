"""Every test that needs a graph gets one of its own: a claimed DDS domain on loopback, for this test process only."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from lupin_runtime.stack.dds import claim_domain, loopback_environment


@pytest.fixture(scope="session", autouse=True)
def private_graph(tmp_path_factory: pytest.TempPathFactory):
    """Put this process, and all that it starts, into a DDS domain that nobody else is in."""
    claim = claim_domain()
    directory: Path = tmp_path_factory.mktemp("dds")
    before = dict(os.environ)
    os.environ.clear()
    os.environ.update(loopback_environment(claim.domain, directory, before))
    yield claim.domain
    os.environ.clear()
    os.environ.update(before)
    claim.release()
