"""The command line `octoplan`; `--help` lists exit codes."""

from __future__ import annotations

import logging
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import CycloptsError, Parameter
from cyclopts.validators import Number

from octoplan.command_line import COMMANDS, app, printed
from octoplan.model import InputError, OctoplanError, UnitWarning
from octoplan.model.support.errors import (
    CompilerError,
    MissingExtraError,
    TimeLimitError,
    shortened,
)
from octoplan.model.support.machine.compiled import Compile
from octoplan.model.support.progress import (
    GRACE,
    OutOfTime,
    ProgressLine,
    report,
    tighten_limit,
    time_limit,
)
from octoplan.planner.frontends.io.files import to_json, why, write_together
from octoplan.planner.frontends.io.scene_file import SceneFile, load


@dataclass(frozen=True)
class Output:
    """What a command computed, in the forms in which it can be handed out.

    Attributes
    ----------
    text : function
        Returns what people read.
    record : msgspec.Struct or dict
        What machines read.
    name : str
        Of the files, without suffix.
    draw : function or None
        Returns the figure.
    tables : mapping
        Functions that return the contents of further files, by name, such as "plan.csv".
    reached : bool
        Whether it is what was asked for.
    """

    text: Callable[[], str]
    record: Any = None
    name: str = ""
    draw: Callable[[], Any] | None = None
    tables: Mapping[str, Callable[[], bytes]] = field(default_factory=dict)
    reached: bool = True


# Of messages, in characters.
_LONG = 2000


def _check_folder(_: Any, folder: Path | None) -> None:
    try:
        if folder is not None and folder.exists() and not folder.is_dir():
            raise ValueError("Allowed is a folder to write to, or one to make.")
    except OSError as reason:
        raise ValueError(f"Allowed is a folder to write to: {why(reason)}.") from None


ScenePath = Annotated[Path, Parameter(help="Scene file, SCENE.toml.")]
Folder = Annotated[Path, Parameter(validator=_check_folder)]
Accuracy = Annotated[
    float,
    Parameter(
        validator=Number(gte=1e-12, lte=0.1), help="Tip error over arm length; else the scene's."
    ),
]


@Parameter(name="*")
@dataclass
class Options:
    """What all commands have that compute something.

    Attributes
    ----------
    json : bool
        Print JSON, in SI units; `octoplan schema` tells its keys.
    time_limit : float
        Stop after so many seconds, with the best by then; else the scene's time_limit_s.
    verbose : bool
        Show the solver's own log on stderr.
    """

    json: bool = False
    time_limit: Annotated[float | None, Parameter(validator=Number(gt=0))] = None
    verbose: Annotated[bool, Parameter(alias="-v")] = False

    def loaded(
        self, scene: Path, accuracy: float | None = None, compiled: Compile = False
    ) -> SceneFile:
        """Return the question of a scene file, with what these options have in place of its own.

        The scene's time limit holds from here on where there is no --time-limit. Raises FileError.
        """
        question = load(scene)
        if self.time_limit is None and question.time_limit is not None:
            self.time_limit = question.time_limit
            tighten_limit(question.time_limit + GRACE)
        accuracy = question.accuracy if accuracy is None else accuracy
        compiled = compiled or question.options["compile"]
        return question.but(accuracy=accuracy, compile=compiled, time_limit=self.time_limit)


@Parameter(name="*")
@dataclass
class FileOptions(Options):
    """What commands have whose results are data and a figure.

    Attributes
    ----------
    out : Path
        Also write data and figure to this folder.
    figure : "png" or "pdf"
        Of which kind the figure in --out is (png).
    """

    out: Folder | None = None
    figure: Literal["png", "pdf"] | None = None

    def __post_init__(self) -> None:
        """Refuse a kind of figure without a folder that it goes to."""
        if self.out is None and self.figure is not None:
            allowed = f"--figure {self.figure} with --out DIR, the folder that it is written to"
            raise InputError("--out", "nothing", allowed)


@Parameter(name="*")
@dataclass
class SceneOptions(FileOptions):
    """What commands have whose results are computed from a scene.

    Attributes
    ----------
    compile : bool
        Work by machine code, built by a C compiler and kept: the same digits, sooner.
    """

    accuracy: Accuracy | None = None
    compile: bool = False

    def question(self, scene: Path) -> SceneFile:
        """Return the question of a scene file; see loaded."""
        return self.loaded(scene, self.accuracy, self.compile)


class UsageError(OctoplanError):
    """The command line is not one that the program knows."""


class OutputError(OctoplanError):
    """Standard output takes nothing."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"standard output cannot be written to: {reason}")


# With what the program exits, by what is raised.
_CODES: tuple[tuple[Any, int], ...] = (
    (BrokenPipeError, 141),
    (OutputError, 74),
    ((CompilerError, InputError, UsageError, MissingExtraError), 2),
    (OctoplanError, 1),
)


def parse(argv: Sequence[str]) -> tuple[Callable[[], Any], Options]:
    """Return what answers a command line, and the options that it has; raises UsageError.

    What it returns is an Output, or a text where help or versions are wanted.
    """
    if not argv:
        raise UsageError("no command; to begin: octoplan new (see octoplan --help)")
    if argv[0].endswith(".toml"):
        raise UsageError(f"what to do with {argv[0]}? For example: octoplan plan {argv[0]}")
    line = app()
    try:
        call, bound, _ = line.parse_args(
            argv, exit_on_error=False, print_error=False, verbose=False
        )
    except CycloptsError as reason:
        where = " ".join(["octoplan", *[item for item in argv if item in COMMANDS][:1]])
        raise UsageError(f"{reason} (see {where} --help)") from None
    bound.apply_defaults()
    # Defaults are shared, and change with the scene.
    options = copy(bound.arguments.get("options", Options()))
    if "options" in bound.arguments:
        bound.arguments["options"] = options
    command = partial(call, *bound.args, **bound.kwargs)
    return command if call.__name__ in COMMANDS else partial(printed, line, command), options


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command, write and print what it computed, and return the exit code."""
    options = Options()
    try:
        command, options = parse(sys.argv[1:] if argv is None else argv)
        with time_limit(None if options.time_limit is None else options.time_limit + GRACE):
            with _warned(), _logged() if options.verbose else ProgressLine():
                report("working")
                output = command()
            if not isinstance(output, Output):
                output = Output(partial(str, output))
            deliver(output, options)
        return 0 if output.reached else 1
    except OutOfTime:
        reason: Exception = TimeLimitError(options.time_limit or 0.0)
    except (OctoplanError, BrokenPipeError) as error:
        reason = error
    if isinstance(reason, OctoplanError):
        print(f"octoplan: {shortened(str(reason), _LONG)}", file=sys.stderr)
    return next(code for kinds, code in _CODES if isinstance(reason, kinds))


@contextmanager
def _warned() -> Iterator[None]:
    """Tell warnings as sentences, each once."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UnitWarning)
        try:
            yield
        finally:
            details = (getattr(item.message, "details", str(item.message)) for item in caught)
            for text in dict.fromkeys(details):
                sys.stderr.write(f"octoplan: beware: {shortened(text, _LONG)}\n")


@contextmanager
def _logged() -> Iterator[None]:
    """Show the log of octoplan on stderr inside the block."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(name)s: %(message)s"))
    logger = logging.getLogger("octoplan")
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(logging.NOTSET)


def deliver(output: Output, options: Options) -> None:
    """Write the files that --out asks for, all or none, then what --json or people are shown.

    Raises OutputError where standard output takes nothing; BrokenPipeError where its reader is
    gone.
    """
    if isinstance(options, FileOptions) and options.out is not None:
        files = {name: content() for name, content in output.tables.items()}
        files[f"{output.name}.json"] = to_json(output.record)
        if output.draw is not None:
            kind = options.figure or "png"
            # Matplotlib is loaded for figures alone.
            drawn = import_module("octoplan.planner.frontends.plots.plan").drawn
            files[f"{output.name}.{kind}"] = drawn(output.draw(), kind)
        write_together(options.out, files)
    text = to_json(output.record).decode() if options.json else output.text()
    if sys.stdout is None:
        raise OutputError("it is closed")
    try:
        sys.stdout.write(text.rstrip("\n") + "\n")
        sys.stdout.flush()
    except (OSError, ValueError) as reason:
        # What is left in the buffer goes nowhere, so that Python does not complain at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(reason, BrokenPipeError):
            raise
        raise OutputError(why(reason)) from None
