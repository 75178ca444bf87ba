"""The command line, parsed: what answers it, options that several commands have, scenes by them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_type_hints

from cyclopts import CycloptsError, Parameter

from model import InputError, OctoplanError
from model.checks import positive
from model.errors import FileError
from model.mesh import checked_accuracy
from model.time_limit import shorten
from octoplan.command_line import COMMANDS, app, printed
from planner.io.files import why
from planner.io.scene_file import Question, load

# What a search that was stopped at the time limit has left to verify what it found [s].
GRACE = 0.7
FigureKind = Literal["png", "pdf"]
FIGURES: tuple[FigureKind, ...] = get_args(FigureKind)


def _held_to(check: Callable[[Any], Any], **more: Any) -> Parameter:
    """Return the parameter of an option that a check of ours refuses by InputError."""

    def validate(_: Any, value: Any) -> None:
        try:
            if value is not None:
                check(value)
        except InputError as reason:
            raise ValueError(f"Allowed is {reason.allowed}.") from None

    return Parameter(validator=validate, **more)


def _checked_folder(_: Any, folder: Path | None) -> None:
    try:
        if folder is not None and folder.exists() and not folder.is_dir():
            raise ValueError("Allowed is a folder to write to, or one to make.")
    except OSError as reason:
        raise ValueError(f"Allowed is a folder to write to: {why(reason)}.") from None


SceneFile = Annotated[Path, Parameter(help="Scene file, SCENE.toml.")]
Folder = Annotated[Path, Parameter(validator=_checked_folder)]
Seconds = Annotated[float, _held_to(partial(positive, "--time-limit"))]
_ACCURACY = "Tip error over arm length; else the scene's."
Accuracy = Annotated[float, _held_to(checked_accuracy, help=_ACCURACY)]


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
    time_limit: Seconds | None = None
    verbose: Annotated[bool, Parameter(alias="-v")] = False

    def loaded(
        self, scene: Path, accuracy: float | None = None, compiled: bool = False
    ) -> Question:
        """Return the question of a scene file, with what these options have in place of its own.

        The scene's time limit holds from here on where there is no --time-limit. Raises FileError.
        """
        question = load(scene)
        if self.time_limit is None and question.time_limit is not None:
            self.time_limit = question.time_limit
            shorten(question.time_limit + GRACE)
        accuracy = question.accuracy if accuracy is None else accuracy
        return replace(question, accuracy=accuracy, compile=compiled or question.compile)


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
    figure: FigureKind | None = None

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

    def asked(self, scene: Path) -> Question:
        """Return the question of a scene file; see loaded."""
        return self.loaded(scene, self.accuracy, self.compile)


_TARGET = 'a [target] table, such as [target] type = "tip-position", position_mm = [250, 0, -150]'
_LIMITS = "a [limits] table, such as [limits] tension_max = 20.0 (N, each tendon)"


def check_plannable(question: Question, name: Path) -> None:
    """Raise FileError for a scene file that asks for no plan."""
    if not question.targets:
        raise FileError(str(name), "target", f"missing; needed is {_TARGET}")
    if "tension_max" not in question.options:
        raise FileError(str(name), "limits", f"missing; needed is {_LIMITS}")


def plan_arguments(question: Question, options: Options) -> dict[str, Any]:
    """Return the further arguments of plan that a scene file and options give."""
    more = {"accuracy": question.accuracy, "compile": question.compile}
    return {**question.options, **more, "time_limit": options.time_limit}


def held(question: Question, name: Path) -> dict[str, Any]:
    """Return what holds a scene file's tendons, as arguments of settle; FileError if nothing."""
    if question.winches:
        return {"tensions": question.tensions, **question.winches}
    return {"tensions": tensions_of(question, name)}


def tensions_of(question: Question, name: Path) -> Any:
    """Return the tensions of a scene file; FileError if it has none."""
    if question.tensions is None:
        rows = ", ".join(
            f"[{', '.join('0.0' for _ in section.angles)}]" for section in question.arm.sections
        )
        place = "at the top of the file, above the first [table]"
        needed = f"missing; needed is tensions = [{rows}] (N) {place}"
        raise FileError(str(name), "tensions", needed)
    return question.tensions


class UsageError(OctoplanError):
    """The command line is not one that the program knows."""


def parse(argv: Sequence[str]) -> tuple[Callable[[], Any], Options]:
    """Return what answers a command line, and the options that it has; raises UsageError.

    What it returns is an Answer, or a text where help or versions are wanted.
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
        command = next((item for item in argv if item in COMMANDS), "")
        where = " ".join(["octoplan", command]).strip()
        raise UsageError(f"{reason} (see {where} --help)") from None
    if call.__name__ not in COMMANDS:
        return partial(printed, line, partial(call, *bound.args, **bound.kwargs)), Options()
    kinds = get_type_hints(call)
    if "options" in kinds and "options" not in bound.arguments:
        bound.arguments["options"] = get_args(kinds["options"])[0]()
    options = bound.arguments.get("options", Options())
    return partial(call, *bound.args, **bound.kwargs), options
