"""Run studies as users do: by their commands, from the project's root."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
ALONE = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}


def source(command: str) -> str:
    """Return the source of the study, or of the one of a folder, that a command line runs."""
    _, _, module, *words = shlex.split(command)
    place = ROOT / module.replace(".", "/")
    if place.is_dir():
        named = re.search(rf'"{words[0]}": \("([\w.]+)"', (place / "__main__.py").read_text())
        place = ROOT / named[1].replace(".", "/") if named else place / words[0]
    return place.with_suffix(".py").read_text()


def study(name: str, *options: str | Path) -> str:
    """Run a study and return its output; fail with its error message if the study fails."""
    command = [sys.executable, "-m", *f"studies.{name}".split(), *map(str, options)]
    done = subprocess.run(
        command, cwd=ROOT, env=ALONE, capture_output=True, text=True, stdin=subprocess.DEVNULL
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
