"""The mark `quick`: which cases of a test run by default."""

from __future__ import annotations

import os
import signal
from collections import defaultdict
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import ArrayLike

# Matrices are small: threads that wait for each other take a tenth more processor time.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# A shell makes background processes ignore Ctrl-C, and also the commands that tests start and
# interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark cases that `quick` does not name as slow, before pytest selects by marks."""
    cases: dict[str, list[bool]] = defaultdict(list)
    for item in items:
        mark = item.get_closest_marker("quick")
        if mark is None:
            continue
        named = item.callspec.id in mark.args  # type: ignore[attr-defined]
        cases[item.nodeid.partition("[")[0]].append(named)
        if not named:
            item.add_marker(pytest.mark.slow)
    lost = [name for name, named in cases.items() if len(named) > 1 and not any(named)]
    # A selection of cases may contain none of the named ones.
    selected = config.getoption("lf", False) or any("::" in name for name in config.args)
    if lost and not selected:
        raise pytest.UsageError(f"quick names no case of {', '.join(lost)}")


@pytest.fixture
def deviation(record_property: Callable[[str, object], None]) -> Callable[..., float]:
    """Return a function that measures and records how far a result is from its reference.

    The arguments are result, reference and unit; the function returns the largest difference over
    the unit. `python -m studies.verification` collects the recorded values.
    """

    def measured(found: ArrayLike, wanted: ArrayLike, unit: float = 1.0) -> float:
        value = float(np.abs(np.subtract(found, wanted)).max() / unit)
        record_property("deviation", value)
        return value

    return measured
