"""Windows lie where the ship is under way and the log is sound, wherever it is divided into pieces."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from cases.operation.log import Cut, cut_log, window_rows
from tests.support.operation_logs import sailed

LENGTH = 3.0


@pytest.fixture(scope="module")
def log() -> dict[str, np.ndarray]:
    """Two hours: moored from 0:30 to 0:50, u missing from 1:00 to 1:05, a frozen heading at 1:20, a gap at 1:40."""
    columns = sailed(2.0)
    t = columns["t"]
    moored = (t >= 1800) & (t < 3000)
    for name in ("u", "v", "r", "n", "delta"):
        columns[name] = np.where(moored, 0.0, columns[name])
    columns["u"] = np.where((t >= 3600) & (t < 3900), np.nan, columns["u"])
    columns["psi"] = np.where((t >= 4800) & (t < 4860), columns["psi"][4800], columns["psi"])
    return {name: values[(t < 6000) | (t >= 6100)] for name, values in columns.items()}


def pieces(columns: dict[str, np.ndarray], rows: int) -> Iterator[dict[str, np.ndarray]]:
    for first in range(0, len(columns["t"]), rows):
        yield {name: values[first : first + rows] for name, values in columns.items()}


def seconds_in(cut: Cut, begin: float, end: float) -> float:
    """Seconds of windows between two times."""
    return sum(max(0.0, min(w.end, end) - max(w.begin, begin)) for w in cut.windows)


@pytest.mark.parametrize(("begin", "end"), [(1830, 2970), (3600, 3900), (4805, 4855), (6000, 6100)])
def test_no_window_lies_where_the_log_tells_nothing(log: dict[str, np.ndarray], begin: float, end: float) -> None:
    assert seconds_in(cut_log(pieces(log, 100_000), LENGTH), begin, end) == 0


def test_what_is_sound_is_cut_into_windows(log: dict[str, np.ndarray]) -> None:
    cut = cut_log(pieces(log, 100_000), LENGTH)
    sound = 7200 - 1200 - 300 - 60 - 100
    assert 0.85 * sound < sum(w.end - w.begin for w in cut.windows) <= sound
    assert {"moored", "missing values", "gaps"} <= set(cut.seconds)
    assert sum(cut.seconds.values()) == pytest.approx(cut.end - cut.begin, rel=0.01)


def test_windows_hardly_depend_on_the_pieces(log: dict[str, np.ndarray]) -> None:
    whole, parts = (cut_log(pieces(log, rows), LENGTH) for rows in (100_000, 1100))
    kinds = [sum(cut.seconds[name] for name in ("manoeuvring", "steady")) for cut in (whole, parts)]
    assert kinds[1] == pytest.approx(kinds[0], rel=0.05)
    for begin, end in ((1830, 2970), (3600, 3900), (6000, 6100)):
        assert seconds_in(parts, begin, end) == 0


def test_rudder_revolutions_and_turns_make_a_window_manoeuvring() -> None:
    t = np.arange(3600.0)
    still = {name: np.zeros(3600) for name in ("v", "r", "delta", "psi")}
    rng = np.random.default_rng(0)
    log = {"t": t, **still, "u": 0.8 + 0.01 * rng.standard_normal(3600), "n": np.full(3600, 10.0)}
    log = {name: values + (1e-4 * rng.standard_normal(3600) if name != "t" else 0) for name, values in log.items()}
    assert not any(w.manoeuvring for w in cut_log([log], LENGTH).windows)
    for name, step in (("delta", 0.2), ("n", -3.0), ("psi", 0.5)):
        changed = {**log, name: log[name] + step * ((t > 1000) & (t < 1020))}
        windows = [w for w in cut_log([changed], LENGTH).windows if w.manoeuvring]
        assert all(w.begin < 1020 and w.end > 1000 for w in windows)
        assert windows or name == "psi"  # a heading that jumps alone is broken, not a manoeuvre


def test_the_rows_of_a_window_are_those_of_the_log(log: dict[str, np.ndarray]) -> None:
    cut = cut_log(pieces(log, 900), LENGTH)
    for rows in (700, 100_000):
        found = list(window_rows(pieces(log, rows), cut.windows))
        assert [window for window, _ in found] == cut.windows
        for window, columns in found:
            inside = (log["t"] >= window.begin) & (log["t"] <= window.end)
            np.testing.assert_array_equal(columns["u"], log["u"][inside])
