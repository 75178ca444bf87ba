"""Tension allocation for tendon-driven arms: all public names in one place, and the command line.

`octoplan.plan`, `octoplan.Arm`, `octoplan.Weight` and the others are defined in the packages
`octoplan.model` and `octoplan.planner`, which are loaded at first use: `import octoplan` alone
costs nothing.
"""

from __future__ import annotations

# What is loaded here is loaded before Ctrl-C is heard: as little as can be.
import os
import signal
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from octoplan.model import *
    from octoplan.model.effects import *
    from octoplan.model.extensions.contact import *
    from octoplan.model.extensions.obstacles import *
    from octoplan.model.extensions.printed import *
    from octoplan.planner import *
    from octoplan.planner.frontends.plots import *
    from octoplan.planner.targets import *

    __version__: str

_MODULES = (
    "octoplan.model",
    "octoplan.model.effects",
    "octoplan.model.extensions.contact",
    "octoplan.model.extensions.obstacles",
    "octoplan.model.extensions.printed",
    "octoplan.planner",
    "octoplan.planner.targets",
    "octoplan.planner.frontends.plots",
)
_ENDINGS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}


def main() -> int:
    """Run the command line and return its exit code; see octoplan.planner.frontends.cli.

    Ctrl-C and SIGTERM end it at once, while it is being loaded too. A KeyboardInterrupt would not:
    CasADi makes a warning of it in the middle of ipopt, which goes on.
    """
    for number in _ENDINGS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end)
    if sys.argv[1:] in (["--help"], ["-h"], ["--version"]) and _print_help():
        return 0
    from octoplan.planner.frontends.cli import main as run

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
    end = getattr(sys.modules.get("octoplan.planner.frontends.io.files"), "end", None)
    kept = "nothing was written" if end is None else end()
    try:
        os.write(2, f"octoplan: {_ENDINGS[signal.Signals(number)]}; {kept}\n".encode())
    finally:
        os._exit(128 + number)


def __getattr__(name: str) -> Any:
    """Return a public name, or the version as it is installed."""
    from functools import partial
    from importlib import import_module

    if name == "__version__":
        return import_module("importlib.metadata").version("octoplan")
    if name == "__all__":
        return _names()
    if name in ("model", "planner"):
        return import_module(f"octoplan.{name}")
    if not name.startswith("_"):
        # Figures of arms and shapes are the planner's, which is loaded where one is drawn.
        import_module("octoplan.model.support.text").register_display(
            partial(import_module, "octoplan.planner.frontends.report")
        )
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

    return sorted({name for module in map(import_module, _MODULES) for name in module.__all__})
