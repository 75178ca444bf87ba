"""Ctrl-C in a study: what was finished is reported."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from studies import hard_cases


def test_families_that_were_finished_are_told_and_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    judge, calls = hard_cases.judge, []

    def interrupted(*args: Any) -> Any:
        calls.append(args)
        if len(calls) > 3:
            raise KeyboardInterrupt
        return judge(*args)

    monkeypatch.setattr(hard_cases, "judge", interrupted)
    chosen = ["many turns", "compression, paper"]
    hard_cases.main(["--members", "2", "--out", str(tmp_path), "--family", *chosen])
    told = capsys.readouterr()
    assert "interrupted" in told.err
    assert any(name in told.out for name in chosen) and "from base to tip" in told.out
    assert (tmp_path / "hard_cases.png").stat().st_size > 0
