"""Frozen values that are looked up often: their hash is worked out once."""

from __future__ import annotations

from typing import Any, TypeVar

C = TypeVar("C", bound=type[Any])
_KEY = "_hash"


def remembers_hash(cls: C) -> C:
    """Let instances of a frozen dataclass keep their hash; to be put above `@dataclass`.

    It does not travel with a pickle: hashes of one process mean nothing in another.
    """
    values: Any = cls
    work_out = values.__hash__

    def remembered(self: Any) -> int:
        known = self.__dict__.get(_KEY)
        if known is None:
            known = self.__dict__[_KEY] = work_out(self)
        return int(known)

    def state(self: Any) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != _KEY}

    values.__hash__, values.__getstate__ = remembered, state
    return cls
