"""The command line `octoplan`: options, output and exit codes; see octoplan.command_line."""

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
from octoplan.model import InputError, OctoplanError
from octoplan.model.support.errors import (
    CompilerError,
    Described,
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
from octoplan.model.support.units import UnitWarning
from octoplan.planner.frontends.io.files import system_message, to_json, write_together
from octoplan.planner.frontends.io.scene_file import SceneFile, load


@dataclass(frozen=True)
class Output:
    """The result of a command, in all output formats.

    Attributes
    ----------
    text : function
        Returns the text for people.
    record : msgspec.Struct or dict
        The data for --json and files.
    name : str
        Name of the files, without suffix.
    draw : function or None
        Returns the figure.
    tables : mapping
        Functions that return the contents of further files, by name, such as "plan.csv".
    reached : bool
        Whether the command succeeded; selects the exit code.
    """

    text: Callable[[], str]
    record: Any = None
    name: str = ""
    draw: Callable[[], Any] | None = None
    tables: Mapping[str, Callable[[], bytes]] = field(default_factory=dict)
    reached: bool = True


# Maximal length of messages, in characters.
_LONG = 2000


def _check_folder(_: Any, folder: Path | None) -> None:
    try:
        if folder is not None and folder.exists() and not folder.is_dir():
            raise ValueError("Must be a folder, existing or new.")
    except OSError as reason:
        raise ValueError(f"Must be a folder, existing or new: {system_message(reason)}.") from None


ScenePath = Annotated[Path, Parameter(help="Scene file, SCENE.toml.")]
Folder = Annotated[Path, Parameter(validator=_check_folder)]
Accuracy = Annotated[
    float,
    Parameter(
        validator=Number(gte=1e-12, lte=0.1),
        help="Tip error over arm length; default: the scene's.",
    ),
]


@Parameter(name="*")
@dataclass
class Options:
    """Options of all commands that compute.

    Attributes
    ----------
    json : bool
        Print JSON, in SI units; `octoplan schema` describes the keys.
    time_limit : float
        Stop after this time [s], with the best result; default: time_limit_s of the scene.
    verbose : bool
        Show the log of the solver on stderr.
    """

    json: bool = False
    time_limit: Annotated[float | None, Parameter(validator=Number(gt=0))] = None
    verbose: Annotated[bool, Parameter(alias="-v")] = False

    def loaded(
        self, scene: Path, accuracy: float | None = None, compiled: Compile = False
    ) -> SceneFile:
        """Return the contents of a scene file, with the values of these options.

        Without --time-limit, the time limit of the scene applies from now on. Raises FileError.
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
    """Options of commands whose results are data and a figure.

    Attributes
    ----------
    out : Path
        Also write data and figure to this folder.
    figure : "png" or "pdf"
        Format of the figure in --out (png).
    """

    out: Folder | None = None
    figure: Literal["png", "pdf"] | None = None

    def __post_init__(self) -> None:
        """Raise InputError for a figure format without a folder."""
        if self.out is None and self.figure is not None:
            allowed = f"a folder for the figure, with --figure {self.figure}"
            raise InputError("--out", Described("none"), allowed)


@Parameter(name="*")
@dataclass
class SceneOptions(FileOptions):
    """Options of commands whose results are computed from a scene.

    Attributes
    ----------
    compile : bool
        Compile the equations with a C compiler and cache the code: same results, faster.
    """

    accuracy: Accuracy | None = None
    compile: bool = False

    def question(self, scene: Path) -> SceneFile:
        """Return the contents of a scene file; see loaded."""
        return self.loaded(scene, self.accuracy, self.compile)


class UsageError(OctoplanError):
    """The command line is invalid."""


class OutputError(OctoplanError):
    """Standard output cannot be written."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"standard output cannot be written: {reason}")


# Exit codes by exception; EXIT_CODES describes them.
_CODES: tuple[tuple[Any, int], ...] = (
    (BrokenPipeError, 141),
    (OutputError, 74),
    ((CompilerError, InputError, UsageError, MissingExtraError), 2),
    (OctoplanError, 1),
)


def parse(argv: Sequence[str]) -> tuple[Callable[[], Any], Options]:
    """Return the command for a command line, and the options; raise UsageError.

    The command returns an Output, or a text for help and versions.
    """
    if not argv:
        raise UsageError("no command; to start: octoplan new (see octoplan --help)")
    if argv[0].endswith(".toml"):
        raise UsageError(f"no command before {argv[0]}; for example: octoplan plan {argv[0]}")
    line = app()
    try:
        call, bound, _ = line.parse_args(
            argv, exit_on_error=False, print_error=False, verbose=False
        )
    except CycloptsError as reason:
        where = " ".join(["octoplan", *[item for item in argv if item in COMMANDS][:1]])
        raise UsageError(f"{reason} (see {where} --help)") from None
    bound.apply_defaults()
    # Copy the default options, which the scene changes.
    options = copy(bound.arguments.get("options", Options()))
    if "options" in bound.arguments:
        bound.arguments["options"] = options
    command = partial(call, *bound.args, **bound.kwargs)
    return command if call.__name__ in COMMANDS else partial(printed, line, command), options


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command, write and print the output, and return the exit code."""
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
    """Write the warnings of the block to stderr as sentences, once each."""
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
    """Write the files for --out, all or none, then print JSON, or text and the names of files.

    Raises OutputError if standard output cannot be written, BrokenPipeError if the reader has
    exited.
    """
    if isinstance(options, FileOptions) and options.out is not None:
        files = {name: content() for name, content in output.tables.items()}
        files[f"{output.name}.json"] = to_json(output.record)
        if output.draw is not None:
            kind = options.figure or "png"
            # Load matplotlib for figures only.
            drawn = import_module("octoplan.planner.frontends.plots.plan").render
            files[f"{output.name}.{kind}"] = drawn(output.draw(), kind)
        write_together(options.out, files)
        written = f"\n\nwritten to {options.out}: {', '.join(files)}"
    else:
        written = ""
    text = to_json(output.record).decode() if options.json else output.text() + written
    if sys.stdout is None:
        raise OutputError("it is closed")
    try:
        sys.stdout.write(text.rstrip("\n") + "\n")
        sys.stdout.flush()
    except (OSError, ValueError) as reason:
        # Discard the buffer, so that Python does not report an error at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(reason, BrokenPipeError):
            raise
        raise OutputError(system_message(reason)) from None
