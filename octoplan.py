"""The command `octoplan`: Ctrl-C and SIGTERM end it at once, while it is being loaded too."""

from __future__ import annotations

import os
import signal
import sys

_SAID = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}


def main() -> int:
    """Run the command line and return its exit code; see planner.cli."""
    for number in _SAID:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end)
    from planner.cli import main as run

    return run()


def _end(number: int, _: object) -> None:
    os.write(2, f"octoplan: {_SAID[signal.Signals(number)]}\n".encode())
    os._exit(128 + number)


if __name__ == "__main__":
    sys.exit(main())
