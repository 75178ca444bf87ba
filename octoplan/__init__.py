"""Tension allocation for tendon-driven arms: the public names, and the command line.

The names such as `octoplan.plan`, `octoplan.Arm` and `octoplan.Weight` are defined in the packages
`octoplan.model` and `octoplan.planner`, which are imported at first use: `import octoplan` alone is
fast.
"""

from __future__ import annotations

# Modules imported here delay the handling of Ctrl-C: keep them few.
import os
import signal
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import ModuleType
    from typing import Any

    from octoplan.model import *
    from octoplan.model.effects import *
    from octoplan.model.extensions.contact import *
    from octoplan.model.extensions.cross_sections import *
    from octoplan.model.extensions.friction import *
    from octoplan.model.extensions.obstacles import *
    from octoplan.model.extensions.printed import *
    from octoplan.planner import *
    from octoplan.planner.extensions.contact import *
    from octoplan.planner.targets import *

    __version__: str

_MODULES = (
    "octoplan.model",
    "octoplan.model.effects",
    "octoplan.model.extensions",
    "octoplan.planner",
    "octoplan.planner.extensions",
    "octoplan.planner.targets",
)
_ENDINGS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}


def main() -> int:
    """Run the command line and return its exit code; see octoplan.planner.frontends.cli.

    SIGINT and SIGTERM end the process at once, even during imports. A KeyboardInterrupt would not:
    CasADi converts it to a warning inside ipopt, and continues.
    """
    for number in _ENDINGS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end)
    if sys.argv[1:] in (["--help"], ["-h"], ["--version"]) and _print_help():
        return 0
    from octoplan.planner.frontends.cli import main as run

    code = run()
    # All output is complete; ignore signals until the interpreter exits.
    for number in _ENDINGS:
        signal.signal(number, signal.SIG_IGN)
    return code


def _print_help() -> bool:
    """Print help or versions without further imports; return False if the output failed."""
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
    """End the process at once; remove incomplete files, and report those that are complete."""
    end = getattr(sys.modules.get("octoplan.planner.frontends.io.files"), "discard_staged", None)
    kept = "nothing was written" if end is None else end()
    try:
        os.write(2, f"octoplan: {_ENDINGS[signal.Signals(number)]}; {kept}\n".encode())
    finally:
        os._exit(128 + number)


def __getattr__(name: str) -> Any:
    """Return a public name, or the installed version."""
    from functools import partial
    from importlib import import_module

    if name == "__version__":
        return import_module("importlib.metadata").version("octoplan")
    if name == "__all__":
        return _names()
    if name in ("model", "planner"):
        return import_module(f"octoplan.{name}")
    if not name.startswith("_"):
        # Figures of arms and shapes are defined in the planner, imported with the first figure.
        import_module("octoplan.model.support.text").register_display(
            partial(import_module, "octoplan.planner.frontends.report")
        )
        for module in _public_modules():
            if name in module.__all__:
                return getattr(module, name)
    import difflib

    near = difflib.get_close_matches(name, [] if name.startswith("_") else _names(), n=1)
    advice = f"; did you mean {near[0]!r}?" if near else ""
    if near and sys._getframe(1).f_code.co_name == "_handle_fromlist":
        # `from octoplan import ...` omits the message of an AttributeError.
        raise ImportError(f"cannot import name {name!r} from 'octoplan'{advice}", name="octoplan")
    raise AttributeError(f"module 'octoplan' has no attribute {name!r}{advice}")


def __dir__() -> list[str]:
    return [*globals(), "__version__", *_names()]


def _names() -> list[str]:
    return sorted({name for module in _public_modules() for name in module.__all__})


def _public_modules() -> Iterator[ModuleType]:
    """Yield the modules whose names are public, each loaded when its turn comes."""
    from importlib import import_module

    for name in _MODULES:
        if name.endswith(".extensions"):
            yield from import_module(name).public_extensions()
        else:
            yield import_module(name)
