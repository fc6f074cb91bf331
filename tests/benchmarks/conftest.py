"""A benchmark sets torch up for a process of its own; after a test of it, this process is what it was."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch


@pytest.fixture(autouse=True)
def torch_as_it_was() -> Iterator[None]:
    """Restore what benchmarks change: the number of threads, and small numbers that are flushed to 0."""
    threads = torch.get_num_threads()
    yield
    torch.set_num_threads(threads)
    torch.set_flush_denormal(False)
