"""Gross effects are named and nothing is named where nothing is missing: a fixed dozen of the study's cases."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from benchmarks.planted.cases import dozen
from benchmarks.planted.score import score
from benchmarks.planted.trial import Trial, run_trial

if TYPE_CHECKING:
    from benchmarks.planted.cases import Case


@pytest.mark.slow
@pytest.mark.dozen
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("case", dozen(), ids=lambda c: f"{c.name}-{'-'.join(c.planted) or 'nothing'}")
def test_what_is_gross_is_named_and_nothing_else(case: Case) -> None:
    record = run_trial(Trial(case, 0, ""))
    found = score(record["truth"], record["diagnosis"])
    assert found.all_named, f"named {found.groups}"
    assert found.false == 0, f"named {found.groups}"
    assert found.verdict == ("explained" if case.planted else "nothing_missing")
    assert found.falls, found.unseen
