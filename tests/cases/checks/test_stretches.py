from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stretches import KINDS, broken, judged
from cases.checks import check
from cases.checks.stretches import broken_stretches
from cases.io.leave_out import inside
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.trial import Trial
from cases.trial_set import TrialSet, ready
from fitting.nlp.windows import pieces_of
from fitting.prediction.score import score
from mmg.rollout import Simulator
from mmg_ident import simulate
from tests.support.trial_files import motion_columns, write_csv


@pytest.fixture(scope="module")
def runs() -> list[Trial]:
    return [trial for some in demo_trials(3) for trial in some]


@pytest.mark.parametrize("dt", [0.1, 0.5, 1.0])
def test_sound_runs_are_sound_at_every_rate(dt: float) -> None:
    for trial in (t for some in demo_trials(4, dt=dt) for t in some):
        assert broken_stretches(trial) == [], trial.name


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_break_is_found_where_it_is(kind: str, runs: list[Trial]) -> None:
    rng = np.random.default_rng(2)
    made = [(trial, broken(trial, kind, 1.0, rng)) for trial in runs if trial.kind != "berthing"]
    rows = [judged(trial, *one) for trial, one in made if one]
    assert len(rows) >= 4 and np.mean([found for found, _ in rows]) >= 0.7
    assert np.mean([lost for _, lost in rows]) <= 0.03


def test_a_record_that_changes_rarely_or_lies_at_rest_repeats_nothing(runs: list[Trial]) -> None:
    trial = runs[0]
    held = np.arange(len(trial)) // 10 * 10  # a log of 1 Hz written at 10 Hz
    columns = {name: trial[name][held] for name in ("x", "y", "psi", "u", "v", "r")}
    assert not [s for s in broken_stretches(trial.with_columns(**columns)) if "repeated" in s.what]
    still = {name: np.full(len(trial), trial[name][0]) for name in columns}
    still |= {name: np.zeros(len(trial)) for name in ("u", "v", "r")}
    assert broken_stretches(trial.with_columns(**still)) == []


def heading_off(trial: Trial, begin: float, end: float) -> Trial:
    rows = inside(trial, [(begin, end)])
    return trial.with_columns(psi=trial["psi"] + np.where(rows, 0.2, 0.0))


def test_a_break_is_named_left_out_and_counted(runs: list[Trial]) -> None:
    trial = heading_off(runs[0], 50.0, 56.0)
    finding = next(f for f in check([trial])[0].findings if f.code == "broken_stretch")
    assert "heading" in finding.text and "trials.toml" in finding.text
    kept = TrialSet.of([trial]).sound[0]
    gone = np.isnan(kept["psi"])
    assert gone[inside(trial, [(50.5, 55.5)])].all() and gone.mean() < 0.1
    assert np.isfinite(kept["delta"]).all() and np.isfinite(trial["psi"]).all()
    assert len(pieces_of([kept], 0.5)) == 2
    assert [m.code for m in TrialSet.of([kept]).remarks] == ["left_out"]
    assert TrialSet.of([kept]).sound[0] is kept and TrialSet.of([trial]).as_they_are.remarks == []


def test_a_score_runs_over_a_broken_instrument_and_does_not_count_its_rows(runs: list[Trial]) -> None:
    model = Simulator(load_ship("esso_osaka_3m"), compiled=False)
    sigma = np.array([5.0, 5.0, 1.0, 0.1, 0.1, 0.02])
    sound, broken = runs[0], heading_off(runs[0], 50.0, 56.0)
    before, after = score(model, [sound], sigma), score(model, TrialSet.of([broken]).sound, sigma)
    assert after.trials[0].windows >= before.trials[0].windows - 1
    assert after.window == pytest.approx(before.window, rel=0.15)


def test_the_sidecar_decides_before_the_checks(tmp_path) -> None:
    columns = motion_columns(60.0)
    columns["psi"] = columns["psi"] + np.where((columns["t"] > 30) & (columns["t"] < 36), 0.3, 0.0)
    path = write_csv(tmp_path / "a.csv", columns, rows=None)
    assert np.isnan(ready(read_trials(path))[0][0]["psi"]).any()
    (tmp_path / "trials.toml").write_text('[files."a.csv"]\nexclude = []\n')
    assert not np.isnan(ready(read_trials(path))[0][0]["psi"]).any()
    (tmp_path / "trials.toml").write_text("[default]\nexclude = [[10, 12.5]]\n")
    trial = ready(read_trials(path))[0][0]
    assert np.isnan(trial["u"]).sum() == 26 and np.isfinite(trial["n"]).all()


@pytest.mark.data
def test_the_touched_ship_and_the_broken_compass_are_named_within_two_seconds(frt) -> None:
    known = {
        "zigzag_31-Jul-2020_13_04_24": [(28.0, 28.0, False), (125.0, 140.2, True)],
        "zigzag_31-Jul-2020_14_10_05": [(125.0, 131.0, False)],
    }
    for name, spans in known.items():
        found = broken_stretches(read_trials(frt / "zigzag" / f"{name}.csv")[0])
        assert len(found) == len(spans)
        for stretch, (begin, end, moved) in zip(found, spans, strict=True):
            assert abs(stretch.begin_s - begin) <= 2.0 and abs(stretch.end_s - end) <= 2.0 and stretch.moved == moved


@pytest.mark.data
def test_real_records_lose_little_and_breaks_put_into_them_are_found(frt) -> None:
    trials = read_trials(sorted((frt / "zigzag").glob("*.csv"))[1:5])
    rows = []
    for number, trial in enumerate(trials):
        assert sum(s.end_s - s.begin_s for s in broken_stretches(trial)) < 0.06 * trial.duration
        made = [broken(trial, kind, 1.0, np.random.default_rng([5, number, k])) for k, kind in enumerate(KINDS)]
        rows += [judged(trial, *one) for one in made if one]
    assert np.mean([found for found, _ in rows]) >= 0.85
    assert np.mean([lost for _, lost in rows]) <= 0.03


@pytest.mark.parametrize(
    ("ship", "maneuver", "dt"),
    [("kvlcc2_full", "crash-stop", 1.0), ("kvlcc2_l7", "turning:35", 0.1), ("esso_osaka_3m", "zigzag:10/10", 0.1)],
)
@pytest.mark.parametrize("noise", [False, True])
def test_a_simulated_run_has_no_broken_stretch(ship: str, maneuver: str, dt: float, noise: bool) -> None:
    """Steady velocities without noise are not frozen, and noise about no turn is no hand at the ship."""
    assert broken_stretches(simulate(ship, maneuver, noise=noise, dt=dt, duration=300)) == []
