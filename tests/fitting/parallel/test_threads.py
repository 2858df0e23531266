"""Linear algebra has one thread while a fit runs, also where numpy was loaded with more."""

from __future__ import annotations

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from fitting.calibration import estimate_coefficients
from fitting.parallel.threads import THREADS, with_one_thread
from fitting.pipeline import calibrate


def threads() -> set[int]:
    assert np.ones(2).sum() == 2.0
    found = {row["num_threads"] for row in threadpool_info()}
    assert found
    return found


def test_one_thread_while_it_runs_and_as_many_as_before_after(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in THREADS:
        monkeypatch.delenv(name, raising=False)
    with threadpool_limits(2):
        before = threads()
        assert with_one_thread(threads)() == {1}
        assert threads() == before == {2}

        def fails(value: int) -> None:
            raise ValueError(f"{value} {threads()}")

        with pytest.raises(ValueError, match=r"3 \{1\}"):
            with_one_thread(fails)(3)
        assert threads() == before


@pytest.mark.parametrize("entry", [calibrate, estimate_coefficients])
def test_fits_are_entered_by_it(entry: object) -> None:
    assert getattr(entry, "__wrapped__", None) is not None
