"""Number of tested members of each family of hard cases."""

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that `python -m studies.hard_cases` sets."""
    parser.addoption("--members", type=int, default=1, help="members of each family of hard cases")
