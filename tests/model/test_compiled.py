"""Compiled functions: the same digits, and a clear word where there is no compiler."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from model import Arm, OctoplanError, Scene, settle_many
from model.effects import Extension

ARM = Arm.from_paper("table-4")
SETS = np.random.default_rng(0).uniform(size=(20, 3, 4)) * np.array([0.1, 1.0, 4.0])[:, None]


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_compiled_tips_have_the_digits_of_interpreted_ones() -> None:
    plain = settle_many(ARM, SETS, Scene(Extension()), accuracy=1e-8, compile=False)
    fast = settle_many(ARM, SETS, Scene(Extension()), accuracy=1e-8, compile=True)
    assert np.abs(plain.tip - fast.tip).max() < 1e-15


def test_a_missing_compiler_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("CC", "nowhere")
    with pytest.raises(OctoplanError, match="C compiler"):
        settle_many(ARM, SETS, Scene(), accuracy=1e-3, compile=True)


@pytest.mark.skipif(shutil.which("false") is None, reason="no program that fails")
def test_a_compiler_that_fails_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "false")
    with pytest.raises(OctoplanError, match="failed"):
        settle_many(ARM, SETS, Scene(), accuracy=1e-2, compile=True)
