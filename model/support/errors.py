"""Exceptions and warnings; all errors that octoplan raises on purpose are OctoplanErrors."""

from __future__ import annotations

import math
from functools import partial
from importlib import import_module
from typing import Any, Self

# Largest difference of the load fractions at which an arm snaps on two meshes that agree.
_SNAP_AGREEMENT = 1e-2
# The same if the arm snaps sooner on the finer mesh, so that still finer ones do not revive it [-].
_SNAP_FALL = 3e-2
# Largest number of characters of a given value in a message.
_LONG = 300


def shortened(text: str, most: int = _LONG) -> str:
    """Return a text, truncated to `most` characters, with the full length if truncated."""
    return text if len(text) <= most else f"{text[:most]} ... ({len(text)} characters)"


class Described(str):
    """The description of a given value; messages show descriptions without quotes."""

    __slots__ = ()


def as_given(value: object) -> str:
    """Return the representation of a value in messages, in one line."""
    if isinstance(value, Described):
        return shortened(str(value))
    try:
        text = repr(value)
    except ValueError:  # an integer with more digits than Python converts to text
        return f"a {type(value).__name__} too long to show"
    name = type(value).__name__
    is_several = "\n" in text and not isinstance(value, str)
    return f"a{'n' * (name[0] in 'AEIO')} {name}" if is_several else shortened(text)


class OctoplanError(Exception):
    """Base class of all errors of octoplan; errors pickle with the arguments of their constructor.

    Attributes
    ----------
    which : str
        The set of tensions or lengths that failed, if there are several; otherwise empty.
    """

    which: str = ""
    _made_of: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls, *args: Any, **more: Any) -> Self:
        """Store the arguments, for pickling and `of_set`."""
        made = super().__new__(cls, *args)
        made._made_of = args, more
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        args, more = self._made_of
        state = {"which": self.which} if self.which else None
        return partial(type(self), **more), args, state

    def __str__(self) -> str:
        message = super().__str__()
        return f"{self.which}: {message}" if self.which else message

    def of_set(self, which: str) -> Self:
        """Return this error for one set of several; the message starts with the set."""
        args, more = self._made_of
        error = type(self)(*args, **more)
        error.which = which
        return error


class InputError(OctoplanError, ValueError):
    """A given value is not allowed.

    Attributes
    ----------
    field : str
        Name of the value (in a scene file: its key path).
    given : object
        The value.
    allowed : str
        Description of allowed values.
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        self.field = field
        self.given = value
        self.allowed = allowed
        super().__init__(f"{shortened(field)} = {as_given(value)}: must be {allowed}")


class TimeLimitError(OctoplanError):
    """The time limit was reached before there was a result.

    Attributes
    ----------
    seconds : float
        The limit.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        super().__init__(f"nothing was found within the time limit of {seconds:g} s")


class UncertifiedError(OctoplanError):
    """The shape of a plan is not settled, because the time limit was reached first."""


class FileError(InputError):
    """A file has an invalid entry, or cannot be read or written.

    Attributes
    ----------
    path : str
        The file.
    where : str
        The place in the file: a line, or a key path such as "effects.weight.g[1]".
    problem : str
        The rule that is violated, such as "must be a number above 0".
    entry : str
        The invalid value as the file has it; empty if no single value is invalid.
    message : str
        The error without the path of the file.
    """

    def __init__(self, path: str, where: str, problem: str, entry: str = "") -> None:
        self.path = path
        self.where = where
        self.problem = problem
        self.entry = entry
        self.field = f"{shortened(path)}: {shortened(where)}" if where else shortened(path)
        self.given = entry or where
        self.allowed = problem
        place = f"{shortened(where)} = {entry}" if entry else shortened(where)
        self.message = f"{place}: {problem}" if place else problem
        OctoplanError.__init__(self, f"{shortened(path)}: {self.message}")

    @classmethod
    def of(cls, reason: InputError, path: str, where: str) -> FileError:
        """Return an InputError as the error of the file that contains the invalid value."""
        named = reason.field == where.rsplit(".", 1)[-1]
        value = float(f"{reason.given:.9g}") if isinstance(reason.given, float) else reason.given
        if named:
            return cls(path, where, f"must be {reason.allowed}", as_given(value))
        problem = f"{reason.field} = {as_given(value)}: must be {reason.allowed}"
        return cls(path, where, problem)


class CollapsedError(OctoplanError):
    """The tensions shorten a cross-section to nothing: 1 + q reaches 0.

    Attributes
    ----------
    s : float
        Arc length of the cross-section [m].
    stretch : float
        The value of 1 + q there.
    """

    def __init__(self, s: float, stretch: float) -> None:
        self.s = s
        self.stretch = stretch
        super().__init__(
            f"the arm is crushed at s = {s:.6g} m: "
            f"1 + q = {stretch:.4g}, it has to stay above 0; "
            "lower the tensions that cross this section or raise E A there"
        )


class ConvergenceError(OctoplanError):
    """No equilibrium was found to the requested accuracy.

    Attributes
    ----------
    asked, reached : float
        Requested and reached tip error over arm length.
    """

    def __init__(self, request: float, reached: float, remedy: str) -> None:
        self.asked = request
        self.reached = reached
        self.remedy = remedy
        how = f"settled to {reached:.2g} of its length, {request:.2g} was asked"
        super().__init__(
            f"the arm was {how if math.isfinite(reached) else 'not settled'}; {remedy}"
        )


class UnsettledSectionError(ConvergenceError):
    """No equilibrium of a cross-section was found.

    Attributes
    ----------
    s : float
        Arc length of the cross-section [m].
    """

    def __init__(self, s: float) -> None:
        self.s = s
        self.asked = 0.0
        self.reached = float("inf")
        self.remedy = "lower the tensions that cross it"
        OctoplanError.__init__(
            self, f"no equilibrium of the section at s = {s:.6g} m was found; {self.remedy}"
        )


class UnsettledContactError(ConvergenceError):
    """No equilibrium of an arm in contact was found; there may be one.

    Attributes
    ----------
    share : float
        Reached fraction of tensions and loads, from 0 to 1.
    why : str
        The error at this fraction.
    """

    def __init__(self, share: float, why: str) -> None:
        self.share = share
        self.why = why
        self.asked = 0.0
        self.reached = float("inf")
        self.remedy = "other tensions, or fewer obstacles, may do"
        OctoplanError.__init__(
            self,
            f"no equilibrium with contact was found: at {100 * share:.1f} % of tensions and loads "
            f"{why}; {self.remedy}",
        )


class SnapError(OctoplanError):
    """The arm loses its equilibrium before loads and tensions act in full.

    Attributes
    ----------
    load_factor, tension_factor : float
        Fractions of the loads and of the tensions, from 0 to 1, at which the arm snaps.
    why : str
        Description of the instability.
    history : "loads first", "tensions first" or "together"
        Order in which loads and tensions acted.
    """

    def __init__(
        self,
        load_factor: float,
        why: str,
        tension_factor: float = 1.0,
        history: str = "together",
        unpulled: str = "",
    ) -> None:
        self.load_factor = load_factor
        self.tension_factor = tension_factor
        self.why = why
        self.history = history
        self.unpulled = unpulled
        bears = f"the arm does not bear its loads: {unpulled}at {100 * load_factor:.1f} % of them"
        message = {
            "loads first": f"the arm does not follow its tendons: under its loads, at "
            f"{100 * tension_factor:.1f} % of the tensions {why}, and no equilibrium beyond is "
            "connected with the arm without tension; lower the tensions, or pass near= a shape",
            "tensions first": f"{bears} {why}; lower the loads or stiffen the arm",
            "together": f"at {100 * load_factor:.1f} % of loads and tensions {why}; lower both",
        }
        super().__init__(message[history])

    def agrees(self, other: SnapError | None) -> bool:
        """Return whether two meshes agree on the fraction at which the arm snaps, well before 1."""
        if other is None or self.history != other.history:
            return False
        now = self.load_factor * self.tension_factor
        change = now - other.load_factor * other.tension_factor
        tolerance = _SNAP_AGREEMENT if change > 0 else _SNAP_FALL
        return abs(change) < min(tolerance, (1 - now) / 2)


class SingularError(OctoplanError):
    """A requested matrix does not exist; the message names the singular direction."""


class DetailedWarning(UserWarning):
    """A warning with a constant text for each kind of case.

    Python shows a text once for each line of a script, so that a loop does not repeat the text.

    Attributes
    ----------
    details : str
        The text with the values of this case.
    """

    def __init__(self, text: str, details: str = "") -> None:
        super().__init__(text)
        self.details = details or text


class ShapeWarning(DetailedWarning):
    """A settled shape that no real arm takes: bent too sharply, or stretched too far."""


class CompilerWarning(DetailedWarning, RuntimeWarning):
    """No C compiler works, or compiled code cannot be stored."""


class CompilerError(OctoplanError):
    """The C compiler is missing or failed; the message is the compiler's."""


class MissingExtraError(OctoplanError):
    """An optional package is required that `pip install octoplan` does not install.

    Attributes
    ----------
    package : str
        Name of the package.
    extra : str
        The extra of octoplan that installs the package.
    """

    def __init__(self, package: str, extra: str) -> None:
        self.package = package
        self.extra = extra
        super().__init__(
            f"{package} is needed for this and is not installed; "
            f"it comes with: python -m pip install 'octoplan[{extra}]'"
        )


def needed(package: str, extra: str) -> Any:
    """Import a package of an extra; MissingExtraError if not installed."""
    try:
        return import_module(package)
    except ModuleNotFoundError as reason:
        raise MissingExtraError(reason.name or package, extra) from None
