"""The journal: what it keeps comes back bit for bit, what is torn or spoilt is as if not there."""

from pathlib import Path

import numpy as np
import pytest

from model import InputError
from planner.staging import abandon, remembered, told_kept
from planner.sweeps.journal import Journal
from planner.sweeps.variables import Rows, blank


def _rows(chunk: int) -> Rows:
    rows = blank("settle", 12, 2)
    rows.values["tip"][:] = np.random.default_rng(chunk).normal(size=(2, 3))
    rows.values["error"][:] = [np.nan, np.inf]
    rows.outcomes[:] = [f"chunk {chunk}", 'a "quoted" outcome\nof two lines']
    return rows


def _left(path: Path) -> dict[int, Rows]:
    with _journal(path) as journal:
        return {chunk: journal.read(chunk) for chunk in range(4) if chunk not in journal.left}


def _journal(path: Path, identity: str = "mine") -> Journal:
    return Journal(path, identity, 4, blank("settle", 12, 0))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    with _journal(tmp_path / "journal") as journal:
        for chunk in range(3):
            journal.add(chunk, _rows(chunk))
    return tmp_path / "journal"


def _same(found: Rows, wanted: Rows) -> bool:
    return found.outcomes == wanted.outcomes and all(
        found.values[name].tobytes() == own.tobytes() for name, own in wanted.values.items()
    )


def test_what_was_finished_comes_back_bit_for_bit(path: Path) -> None:
    left = _left(path)
    assert list(left) == [0, 1, 2]
    assert all(_same(rows, _rows(chunk)) for chunk, rows in left.items())


@pytest.mark.parametrize("lost", [1, 2, 40, 400])
def test_a_torn_last_line_is_ignored_and_written_after(path: Path, lost: int) -> None:
    path.write_bytes(path.read_bytes()[:-lost])
    # Only its end of line may be lacking: then nothing is lost.
    assert list(_left(path)) == ([0, 1, 2] if lost == 1 else [0, 1])
    with _journal(path) as journal:
        journal.add(3, _rows(3))
    left = _left(path)
    assert set(left) == ({0, 1, 2, 3} if lost == 1 else {0, 1, 3})
    assert _same(left[3], _rows(3))


def test_a_spoilt_line_is_ignored(path: Path) -> None:
    text = bytearray(path.read_bytes())
    middle = text.index(b"chunk 1")
    text[middle] ^= 1
    path.write_bytes(text)
    assert list(_left(path)) == [0, 2]


def test_a_torn_head_leaves_nothing(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:20])
    assert _left(path) == {}


def test_the_journal_of_another_sweep_is_refused_and_kept(path: Path) -> None:
    before = path.read_bytes()
    with pytest.raises(InputError, match="of another"):
        _journal(path, "another")
    assert path.read_bytes() == before


def test_a_journal_in_which_nothing_is_finished_goes_when_it_is_closed(tmp_path: Path) -> None:
    with _journal(tmp_path / "journal"):
        pass
    assert not (tmp_path / "journal").exists()


@pytest.mark.parametrize("chunks", [0, 1])
def test_what_ends_a_command_at_once_leaves_no_journal_of_nothing(
    tmp_path: Path, chunks: int
) -> None:
    """It used to say that nothing was written, beside a journal without a finished chunk."""
    with remembered():
        journal = _journal(tmp_path / "journal")
        for chunk in range(chunks):
            journal.add(chunk, _rows(chunk))
        told = told_kept()
        abandon()
        assert ("nothing" in told) == (chunks == 0)
        assert (tmp_path / "journal").exists() == (chunks > 0)
        journal.__exit__(None, None, None)
