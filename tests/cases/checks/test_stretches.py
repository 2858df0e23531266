from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.stretches import KINDS, broken, judged
from cases.checks import check
from cases.checks.single import spikes
from cases.checks.stretches import broken_stretches
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.trial import Trial, inside
from cases.trial_set import DOUBT, TrialSet, ready
from fitting.nlp.windows import pieces_of
from fitting.prediction.score import score
from mmg.messages import Message
from mmg.rollout import Simulator
from mmg_ident import simulate
from tests.support.trial_files import make_trial, motion_columns, write_csv


@pytest.fixture(scope="module")
def runs() -> list[Trial]:
    return [trial for some in demo_trials(3, dt=0.2) for trial in some]


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.data
def test_real_records_lose_little_and_breaks_put_into_them_are_found(frt) -> None:
    trials = read_trials(sorted((frt / "zigzag").glob("*.csv"))[1:4])
    rows = []
    for number, trial in enumerate(trials):
        assert sum(s.end_s - s.begin_s for s in broken_stretches(trial)) < 0.06 * trial.duration
        made = [broken(trial, kind, 1.0, np.random.default_rng([5, number, k])) for k, kind in enumerate(KINDS)]
        rows += [judged(trial, *one) for one in made if one]
    assert np.mean([found for found, _ in rows]) >= 0.85
    assert np.mean([lost for _, lost in rows]) <= 0.03


@pytest.mark.parametrize(
    ("ship", "maneuver", "dt"),
    [
        ("kvlcc2_full", "crash-stop", 1.0), ("kvlcc2_l7", "turning:35", 0.1), ("esso_osaka_3m", "zigzag:10/10", 0.1),
        ("esso_osaka_3m", "random:4", 0.5), ("esso_osaka_3m", "berthing", 1.0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("noise", [False, True])
def test_a_simulated_run_has_no_broken_stretch(ship: str, maneuver: str, dt: float, noise: bool) -> None:
    """Steady velocities without noise are not frozen, and noise about no turn is no hand at the ship."""
    assert broken_stretches(simulate(ship, maneuver, noise=noise, dt=dt, duration=300)) == []


def test_a_coarse_turn_rate_that_repeats_itself_by_chance_is_not_frozen_beside_a_noisy_heading() -> None:
    step, run = np.radians(0.5) / 60, simulate("kvlcc2_full", "zigzag:10/10", dt=1.0, duration=900)
    rng = np.random.default_rng(1)
    r = np.round((run["r"] + np.radians(0.012) * rng.normal(size=len(run))) / step) * step
    psi = run.psi_unwrapped + np.radians(0.05) * rng.normal(size=len(run))
    r[300:307] = r[300]
    assert broken_stretches(run.with_columns(r=r, psi=psi)) == []
    r[300:360] = r[300]
    assert len(broken_stretches(run.with_columns(r=r, psi=psi))) == 1


def codes(trial: Trial) -> set[str]:
    return {finding.code for finding in check([trial])[0].findings}


def test_spikes_are_single_samples_off_both_neighbours_doubtful_and_named() -> None:
    r = make_trial()["r"].copy()
    assert spikes(r) == 0 and spikes(np.sign(r)) == 0 and spikes(np.full(50, np.nan)) == 0 and spikes(r[:2]) == 0
    r[[500, 900]] += 40 * r.std()
    assert spikes(r + 1e-3 * np.random.default_rng(1).normal(size=len(r))) == 2
    r[600:660] = np.nan
    (report,) = check([make_trial(r=r)])
    (found,) = [finding for finding in report.findings if finding.code == "spikes"]
    assert report.verdict == "doubtful" and "2 in r" in found.text


def test_a_heading_that_turns_far_between_samples_is_sampled_too_coarsely() -> None:
    columns = motion_columns()
    columns["r"] = 0.05 * np.sign(np.sin(0.05 * columns["t"]))
    assert "coarse_sampling" not in codes(make_trial(**columns))
    thin = {name: values[::100] for name, values in columns.items()}
    assert "coarse_sampling" in codes(make_trial(**thin))


def test_copies_of_a_trial_are_left_out_and_named() -> None:
    late = make_trial("late", t=make_trial()["t"] + 1000.0)
    other = make_trial("other", u=make_trial()["u"] + 0.01)
    copies = [make_trial(f"run {k}") for k in range(50)]
    kept, (message,) = TrialSet.of([*copies, late, other]).training()
    assert [trial.name for trial in kept] == ["run 0", "other"] and message.code == "copies_left_out"


def test_a_file_that_lies_in_two_campaigns_counts_for_the_first_which_is_said() -> None:
    first, again = (replace(make_trial(f"run_{day}"), path=None) for day in ("2026-03-01", "2026-03-02"))
    kept, (_, message) = TrialSet.of([first, again, make_trial("other", u=make_trial()["u"] + 0.01)]).training()
    assert [trial.name for trial in kept] == ["run_2026-03-01", "other"]
    assert message.code == "same_file_in_two_campaigns" and "2026-03-01" in message


DEG = np.pi / 180.0
COARSE = {"psi": 0.1 * DEG, "r": 0.05 * DEG, "u": 0.05, "v": 0.05, "x": 0.1, "y": 0.1, "delta": 0.5 * DEG}


def steady_after_weaving(resolution: dict[str, float], stuck: tuple[str, ...] = ()) -> Trial:
    """A ship of 7 m/s that weaves for 150 s and runs straight on with a wander of a tenth of a degree, at 2 Hz.

    resolution: column -> what it is rounded to; stuck: columns that keep one value from 30 to 45 s.
    """
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 400.0, 0.5)
    weave = np.where(t < 150, np.sin(2 * np.pi * t / 75), 0.0)
    psi = (8.0 * weave + 0.08 * np.sin(t / 9) + 0.06 * np.sin(t / 4 + 1)) * DEG
    r = np.gradient(psi, t)
    u, v = 7.0 - 0.4 * weave**2 + 0.01 * np.sin(t / 11), -20.0 * r
    w = (u + 1j * v) * np.exp(1j * psi)
    place = np.concatenate([[0.0], np.cumsum(0.25 * (w[1:] + w[:-1]))])
    exact = {"x": place.real, "y": place.imag, "psi": psi, "u": u, "v": v, "r": r, "n": 2.0 + 0 * t}
    sizes = {"x": 0.02, "y": 0.02, "psi": 0.01 * DEG, "u": 0.005, "v": 0.005, "r": 0.01 * DEG, "n": 0.0}
    columns = {name: values + sizes[name] * rng.standard_normal(len(t)) for name, values in exact.items()}
    columns |= {"t": t, "delta": -10.0 * DEG * weave}
    for name, step in resolution.items():
        columns[name] = np.round(columns[name] / step) * step
    for name in stuck:
        columns[name][60:90] = columns[name][60]
    return Trial("steady", columns)


ROUNDED = [{"psi": 0.5 * DEG}, {"psi": 1.0 * DEG}, *({name: step for name in "uv"} for step in (0.05, 0.1)), COARSE,
           dict.fromkeys("xy", 1.0)]  # fmt: skip


@pytest.mark.parametrize(
    ("resolution", "bias"),
    [*((each, 0.0) for each in ROUNDED), ({"psi": 0.1 * DEG}, 0.002), ({"psi": 0.1 * DEG}, 0.02)],
    ids=str,
)
def test_a_rounded_column_that_stands_still_in_a_steady_stretch_is_sound_also_beside_a_gyro_with_a_bias(
    resolution: dict[str, float], bias: float
) -> None:
    whole = steady_after_weaving(resolution)
    for trial in (whole, whole[160.5:]):
        assert broken_stretches(trial.with_columns(r=trial["r"] + bias * DEG)) == []


@pytest.mark.parametrize(("ship", "dt"), [("mariner", 1.0), ("kvlcc2_full", 0.2)])
def test_a_heading_that_stands_still_is_sound_beside_a_gyro_with_noise(ship: str, dt: float) -> None:
    trial = simulate(ship, "zigzag:2/2", dt=dt, duration=900, seed=3)
    noise = 0.05 * DEG * np.random.default_rng(1).standard_normal(len(trial))
    psi = np.round(trial["psi"] / (0.1 * DEG)) * 0.1 * DEG
    assert broken_stretches(trial.with_columns(psi=psi, r=trial["r"] + noise)) == []


@pytest.mark.parametrize("stuck", [("psi",), ("r",), ("x", "y")], ids=", ".join)
def test_a_rounded_column_that_stands_still_while_the_ship_weaves_is_broken(stuck: tuple[str, ...]) -> None:
    (found,) = broken_stretches(steady_after_weaving(COARSE, stuck))
    assert abs(found.begin_s - 30.0) <= 3.0 and abs(found.end_s - 45.0) <= 3.0


def test_the_same_doubt_of_several_trials_is_said_once() -> None:
    doubt = "doubtful: u is 2% below what the positions say"
    trials = [
        replace(make_trial(), name=name, notices=(Message(f"{name}: {text}", DOUBT),))
        for name, text in [("a", doubt), ("b", "doubtful: psi jumps"), ("c", doubt)]
    ]
    said = TrialSet(tuple(trials)).remarks
    assert [(m, m.code) for m in said] == [(f"a, c: {doubt}", DOUBT), ("b: doubtful: psi jumps", DOUBT)]


@pytest.mark.parametrize(("begin", "end"), [(60.0, 250.0), (60.0, 100.0)])
def test_a_rudder_that_was_logged_as_held_while_she_weaves_is_broken(begin: float, end: float) -> None:
    trial = simulate("kvlcc2_l7", "zigzag:20/20", noise=True, dt=0.2, duration=250, seed=3)
    held = np.where(inside(trial, [(begin, end)]), trial["delta"][int(begin / 0.2)], trial["delta"])
    trial = trial.with_columns(delta=held)
    (found,) = broken_stretches(trial)
    assert found.begin_s <= begin and found.end_s == pytest.approx(end, abs=20.0)
    assert found.channels == ("delta",) and found.moved
    assert "frozen_channel" in codes(trial)


def test_a_rudder_that_is_held_in_all_of_a_zigzag_is_refuted_by_other_files_and_one_of_a_straight_run_is_not() -> None:
    orders = ("zigzag:20/20", "turning:35", "straight", "crash-stop", "zigzag:10/10")
    runs = [simulate("kvlcc2_l7", order, noise=True, dt=0.2, duration=250, seed=3) for order in orders]
    yaw = 0.02 * np.sin(2.0 * runs[2].t)  # in waves
    runs[2] = runs[2].with_columns(r=runs[2]["r"] + yaw, psi=runs[2]["psi"] - 0.01 * np.cos(2.0 * runs[2].t))
    runs[4] = runs[4].with_columns(delta=np.zeros(len(runs[4])))
    levels = [{f.level for f in report.findings if f.code == "frozen_channel"} for report in check(runs)]
    assert levels == [set(), set(), set(), set(), {"contradictory"}]


@pytest.mark.parametrize("back", [True, False])
def test_no_window_runs_over_a_jump_that_stays(back: bool) -> None:
    """Positions that count from 40 m further from 30 s on; for 4 s alone, they break and the rest is sound."""
    trial = make_trial(**motion_columns(120.0))
    there = (trial.t >= 30.0) & ((trial.t < 34.0) | (not back))
    broken = broken_stretches(replace(trial, columns={**trial.columns, "x": trial["x"] + 40.0 * there}))
    assert [found.moved for found in broken if found.channels == ("x", "y")] == [not back]
