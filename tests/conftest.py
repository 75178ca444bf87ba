"""The mark `quick`: which cases of a test run by default."""

from __future__ import annotations

import os
import signal
from collections import defaultdict

import pytest

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
