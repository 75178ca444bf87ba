"""Tables of refusals: the attempt, the field in the message, and a part of the message."""

from __future__ import annotations

import pickle
from collections.abc import Callable

import pytest

from octoplan.model import InputError
from octoplan.model.support.errors import FileError, as_given

Refused = dict[str, tuple[Callable[[], object], str, str]]


def check_refusal(attempt: Callable[[], object], field: str, told: str = "") -> None:
    """Assert that an attempt raises InputError with the field, the given and the allowed value."""
    with pytest.raises(InputError) as caught:
        attempt()
    error = caught.value
    assert field in error.field
    assert error.allowed and told in str(error)
    if not isinstance(error, FileError):
        assert str(error) == f"{error.field} = {as_given(error.given)}: must be {error.allowed}"
    assert isinstance(error, ValueError)
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
