"""Tension allocation for tendon-driven arms: all public names in one place, and the command line.

`octoplan.plan`, `octoplan.Arm`, `octoplan.Weight` and the others are those of `model`, `planner`,
`model.effects`, `model.obstacles`, `planner.targets` and `planner.plots`, which remain importable
themselves. They are loaded at first use, so that `import octoplan` costs nothing.
"""

from __future__ import annotations

# What is loaded here is loaded before Ctrl-C is heard: as little as can be.
import os
import signal
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from model import *
    from model.effects import *
    from model.obstacles import *
    from planner import *
    from planner.plots import *
    from planner.targets import *

    __version__: str

_MODULES = (
    "model",
    "model.effects",
    "model.obstacles",
    "planner",
    "planner.targets",
    "planner.plots",
)
_ENDINGS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}


def main() -> int:
    """Run the command line and return its exit code; see planner.cli.

    Ctrl-C and SIGTERM end it at once, while it is being loaded too. A KeyboardInterrupt would not:
    CasADi makes a warning of it in the middle of ipopt, which goes on.
    """
    for number in _ENDINGS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end)
    if sys.argv[1:] in (["--help"], ["-h"], ["--version"]) and _print_help():
        return 0
    try:
        check_own("model", "planner")
    except ImportError as reason:
        sys.stderr.write(f"octoplan: {reason}\n")
        return 2
    from planner.cli import main as run

    code = run()
    # All is written and told: what is left is the interpreter's own end.
    for number in _ENDINGS:
        signal.signal(number, signal.SIG_IGN)
    return code


def _print_help() -> bool:
    """Print help or versions, for which nothing else is loaded; return whether they were taken."""
    from octoplan.command_line import app, printed

    line = app()
    show, bound, _ = line.parse_args(sys.argv[1:])
    text = printed(line, lambda: show(*bound.args, **bound.kwargs))
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except (AttributeError, OSError, ValueError):
        return False
    return True


def _end(number: int, _: object) -> None:
    """End at once; what is being written is removed, what is written is told."""
    end = getattr(sys.modules.get("planner.io.files"), "end", None)
    kept = "nothing was written" if end is None else end()
    try:
        os.write(2, f"octoplan: {_ENDINGS[signal.Signals(number)]}; {kept}\n".encode())
    finally:
        os._exit(128 + number)


def check_own(*names: str) -> None:
    """Raise ImportError where a user's file hides a package; see octoplan_packages."""
    from octoplan_packages import check_own as check

    check(*names)


def __getattr__(name: str) -> Any:
    """Return a public name, or the version as it is installed."""
    from functools import partial
    from importlib import import_module

    if name == "__version__":
        return import_module("importlib.metadata").version("octoplan")
    if name == "__all__":
        return _names()
    if not name.startswith("_"):
        check_own("model", "planner")
        # Figures of arms and shapes are the planner's, which is loaded where one is drawn.
        import_module("model.text").shown_later(partial(import_module, "planner.report"))
        for module in map(import_module, _MODULES):
            if name in module.__all__:
                return getattr(module, name)
    import difflib

    near = difflib.get_close_matches(name, [] if name.startswith("_") else _names(), n=1)
    advice = f"; did you mean {near[0]!r}?" if near else ""
    if near and sys._getframe(1).f_code.co_name == "_handle_fromlist":
        # Of an AttributeError `from octoplan import ...` would drop the advice.
        raise ImportError(f"cannot import name {name!r} from 'octoplan'{advice}", name="octoplan")
    raise AttributeError(f"module 'octoplan' has no attribute {name!r}{advice}")


def __dir__() -> list[str]:
    return [*globals(), "__version__", *_names()]


def _names() -> list[str]:
    from importlib import import_module

    check_own("model", "planner")
    return sorted({name for module in map(import_module, _MODULES) for name in module.__all__})
