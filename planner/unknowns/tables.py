"""The table of an unknown in files."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from model import InputError
from model.errors import FileError
from planner.fit.unknowns import Unknown
from planner.scenes.keys import Table


class UnknownTable(Table, frozen=True):
    """A number to be found; see planner.Unknown."""

    key: Annotated[str | list[str], Meta(description="key path in the scene file, or several")]
    lower: Annotated[float, Meta(description="in the key's unit")]
    upper: Annotated[float, Meta(description="in the key's unit")]
    prior: Annotated[
        tuple[float, float] | None, Meta(description="mean and standard deviation known beforehand")
    ] = None
    session: Annotated[str | None, Meta(description="the shapes that it belongs to")] = None


def unknown_of(table: UnknownTable, name: str, where: str) -> Unknown:
    """Return the unknown of a table; FileError with the file and the place in it."""
    key = tuple(table.key) if isinstance(table.key, list) else table.key
    try:
        return Unknown(key, table.lower, table.upper, table.prior, table.session)
    except InputError as reason:
        raise FileError.of(reason, name, where) from None
