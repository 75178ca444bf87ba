"""Checks of warnings whose text is constant and whose details hold numbers."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from octoplan.model.support.errors import DetailedWarning


@contextmanager
def detailed(
    category: type[DetailedWarning], pattern: str
) -> Iterator[list[warnings.WarningMessage]]:
    """Check that a block warns, with details that match a pattern."""
    with pytest.warns(category) as told:
        yield told.list
    found = [own.message.details for own in told if isinstance(own.message, category)]
    assert any(re.search(pattern, details) for details in found), found
