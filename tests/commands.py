"""Studies run as users run them: by their commands, from the project's root."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
ALONE = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}


def study(name: str, *options: str | Path) -> str:
    """Run a study and return what it printed; fails with what it said where it does."""
    command = [sys.executable, "-m", f"studies.{name}", *map(str, options)]
    done = subprocess.run(
        command, cwd=ROOT, env=ALONE, capture_output=True, text=True, stdin=subprocess.DEVNULL
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
