"""Long records of two ships with known orders: the manoeuvres in them are found, named, and written as trials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cases.io.read import read_trials
from cases.operation.cut import cut_record, write_cut
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from mmg.errors import Missing
from tests.support.long_records import long_record

ORDERS = ("turning:35", "zigzag:10/10", "turning:-20", "zigzag:-20/10", "zigzag:15/5", "spiral:15/5", "crash-stop")
NAMES = [order.replace(":", "_").replace("/", "_") for order in ORDERS]

Record = tuple[Trial, list[float], float]


@pytest.fixture(scope="module", params=["esso_osaka_3m", "kvlcc2_full"])
def record(request: pytest.FixtureRequest) -> Record:
    model = request.param == "esso_osaka_3m"
    return long_record(request.param, ORDERS, 0.5 if model else 4.0, 3, "0.1:40" if model else "3:40")


def whole(trial: Trial) -> Trial:
    return trial


def with_gaps(trial: Trial) -> Trial:
    """A tenth of the rows is lost, a few of them together."""
    lost = np.repeat(np.random.default_rng(1).random(len(trial) // 2 + 1) < 0.1, 2)[: len(trial)]
    return replace(trial, columns={name: values[~lost] for name, values in trial.columns.items()})


def rounded(trial: Trial) -> Trial:
    degrees = {name: np.radians(np.round(np.degrees(trial[name]), 1)) for name in ("psi", "delta")}
    return trial.with_columns(**degrees)


def steered_by_pods(trial: Trial) -> Trial:
    columns = {name: values for name, values in trial.columns.items() if name not in ("n", "delta")}
    nothing = np.zeros(len(trial))
    columns |= {"n": nothing, "delta": nothing, "n_azimuth": trial["n"], "azimuth": -trial["delta"]}
    return replace(trial, columns=columns, ancestors={"n": (), "delta": ()})


@pytest.mark.parametrize("change", [whole, with_gaps, rounded, steered_by_pods])
@pytest.mark.parametrize("known", [True, False])
def test_manoeuvres_have_the_names_and_times_of_their_orders(
    record: Record, change: Callable[[Trial], Trial], known: bool
) -> None:
    trial, times, length = record
    parts = [part for part in cut_record(change(trial), length if known else None) if part.trial.kind != "acceleration"]
    assert [part.trial.name[3:] for part in parts] == NAMES
    unit = length / trial["u"][0]
    np.testing.assert_allclose([part.order_s for part in parts], times, atol=0.3 * unit)
    for part in parts:
        assert part.order_s - part.trial.t[0] > 10 * unit  # a straight approach
        assert abs(np.ptp(part.trial.psi_unwrapped[part.trial.t < part.order_s])) < 0.3
    ends = [(part.trial.t[0], part.trial.t[-1]) for part in parts]
    assert all(before[1] < after[0] for before, after in pairwise(ends))


def test_a_ship_that_gathers_way_and_what_has_no_kind_are_cut_as_well() -> None:
    trial, _, length = long_record("esso_osaka_3m", ["acceleration", "random:3", "turning:20"], 0.5)
    assert [part.trial.kind for part in cut_record(trial, length)] == ["acceleration", "turning"]
    assert [part.trial.kind for part in cut_record(trial, length, rest=True)] == ["acceleration", "", "turning"]


def test_a_record_without_a_manoeuvre_says_why(record: Record) -> None:
    trial, times, length = record
    rows = trial.t < times[0] - trial.dt
    straight = replace(trial, columns={name: values[rows] for name, values in trial.columns.items()})
    for given in (length, None):
        with pytest.raises(Missing):
            cut_record(straight, given)


def test_the_trials_keep_what_the_sidecar_of_the_record_says(record: Record, tmp_path: Path) -> None:
    trial, times, length = record
    write_trial(trial, tmp_path / "record.csv")
    middle = times[1]
    (tmp_path / "trials.toml").write_text(
        '[default]\ninputs = "sampled"\nday = "2026-11-22"\ngroup = "before"\nrole = "validate"\n'
        'std = { r = 1e-4 }\nderived = { r = ["psi"] }\n'
        f'[files."record.csv"]\nexclude = [[{middle - 9}, {middle - 4}]]\n'
    )
    (read,) = read_trials(tmp_path / "record.csv")
    (tmp_path / "parts").mkdir()
    write_cut(cut_record(read, length), tmp_path / "parts")
    parts = read_trials(tmp_path / "parts")
    assert len(parts) >= len(ORDERS)
    for part in parts:
        assert part.kind and part.role == "validate" and part.std == {"r": 1e-4} and part.ancestors == {"r": ("psi",)}
        assert part.meta["day"] == "2026-11-22" and part.meta["group"] == "before" and part.meta["inputs"] == "sampled"
        rows = (trial.t >= part.t[0]) & (trial.t <= part.t[-1])
        for name in ("t", "n", "delta"):
            np.testing.assert_array_equal(part[name], trial[name][rows])
    missing = [name.name for name in parts if np.isnan(name["psi"]).any()]
    assert missing == [part.name for part in parts if part.t[0] < middle < part.t[-1]] and len(missing) == 1
