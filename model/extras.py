"""What is needed for some tasks only: extras of the package, imported when they are needed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from model.errors import OctoplanError


class MissingExtraError(OctoplanError):
    """A package is needed that `pip install octoplan` alone does not bring.

    Attributes
    ----------
    package : str
        What could not be imported.
    extra : str
        The extra of octoplan that brings it.
    """

    def __init__(self, package: str, extra: str) -> None:
        self.package, self.extra = package, extra
        super().__init__(
            f"{package} is needed for this and is not installed; "
            f"it comes with: python -m pip install 'octoplan[{extra}]'"
        )

    def __reduce__(self) -> tuple[type, tuple[str, str]]:
        return type(self), (self.package, self.extra)


def needed(package: str, extra: str) -> Any:
    """Return a package that an extra brings; MissingExtraError where it is not installed."""
    try:
        return import_module(package)
    except ModuleNotFoundError as reason:
        raise MissingExtraError(reason.name or package, extra) from None
