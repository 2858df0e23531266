"""What a model takes from the columns of a trial: held from sample to sample, or as they are at each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases.checks import check
from cases.inputs import SAMPLED, actuator_columns, model_inputs, step_means, straight_means, with_corners
from cases.io.read import read_trial
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate, write_trial
from cases.trial import Trial
from cases.trial_set import TrialSet, ready, shared_rows
from diagnosis.estimation.gridded_trials import possible_readings
from mmg.errors import UserError
from tests.support.trial_files import make_trial

HEADER = "t [s],psi [deg],u [m/s],v [m/s],r [rad/s],n [rps],delta [deg]\n"


def file_with(tmp_path: Path, sidecar: str) -> Path:
    rows = "".join(f"{k},0,1,0,0,{10 + k},{3 * k}\n" for k in range(5))
    (tmp_path / "run.csv").write_text(HEADER + rows, encoding="utf-8")
    (tmp_path / "trials.toml").write_text(sidecar, encoding="utf-8")
    return tmp_path / "run.csv"


def test_a_sidecar_says_that_actuators_are_as_they_are_at_each_sample(tmp_path: Path) -> None:
    held = read_trial(file_with(tmp_path, '[default]\ninputs = "held"\n'))
    assert model_inputs(held).array[:, 0] == pytest.approx([10, 11, 12, 13, 14])
    sampled = read_trial(file_with(tmp_path, '[default]\ninputs = "sampled"\n'))
    found = model_inputs(sampled).array
    assert found[:, 0] == pytest.approx([10.5, 11.5, 12.5, 13.5, 14])  # the last has no next one
    assert np.degrees(found[:, 1]) == pytest.approx([1.5, 4.5, 7.5, 10.5, 12])
    assert np.degrees(sampled["delta"]) == pytest.approx([0, 3, 6, 9, 12])  # the column stays as it was logged
    assert any(note.code == "inputs" for note in sampled.notices) and not any(n.code == "inputs" for n in held.notices)
    silent = read_trial(file_with(tmp_path, ""))
    assert model_inputs(silent).array == pytest.approx(model_inputs(held).array)
    assert possible_readings([silent]) == (False, True)  # by its moves
    assert possible_readings([held]) == possible_readings([sampled]) == (False,)  # not joined by lines twice
    assert possible_readings([silent, sampled]) == (False,)
    with pytest.raises(UserError, match="inputs"):
        read_trial(file_with(tmp_path, '[default]\ninputs = "later"\n'))


def test_a_missing_sample_is_held_and_a_direction_past_half_a_turn_goes_the_short_way() -> None:
    azimuth = np.array([3.0, -3.1, -3.0, -2.8])
    n = np.array([1.0, 9.0, np.nan, 2.0])
    columns = {name: np.zeros(4) for name in ("psi", "u", "v", "r")}
    trial = Trial("run", columns | {"t": np.arange(4.0), "n": n, "azimuth": azimuth}, meta={"inputs": SAMPLED})
    found, _ = actuator_columns(trial, ["n", "azimuth"])
    assert found[:, 0] == pytest.approx([5.0, 9.0, np.nan, 2.0], nan_ok=True)
    short = 0.5 * (3.0 + 2 * np.pi - 3.1)
    assert np.angle(np.exp(1j * found[:, 1])) == pytest.approx([short, -3.05, -2.9, -2.8])


def test_revolutions_that_hold_are_those_of_a_hull_polynomial_and_others_are_nobodys(tmp_path: Path) -> None:
    mariner, path = load_ship("mariner").inputs, tmp_path / "run.csv"
    assert "n" not in mariner

    def trial(*revolutions: float) -> Trial:
        path.write_text(HEADER + "".join(f"{k},0,1,0,0,{n},{k}\n" for k, n in enumerate(revolutions)))
        return read_trial(path)

    ignored = {note.code: str(note) for note in model_inputs(trial(10, 9, 8, 9, 10), mariner).notices}
    assert " n:" in ignored["input_ignored"]
    for revolutions in ((10, 8, 2, 2, 2), (10, 5, 0, -5, -5)):
        with pytest.raises(UserError, match="10 rps"):
            model_inputs(trial(*revolutions), mariner)


def test_held_directions_either_side_of_ahead_have_a_mean_ahead_over_a_step() -> None:
    """A pod at 359 deg for a second and at 1 deg for the next pushes ahead, not astern."""
    zeros = {name: np.zeros(3) for name in ("psi", "u", "v", "r", "n_azimuth_2")}
    trial = Trial("run", zeros | {"t": np.arange(3.0), "azimuth_2": np.radians([359.0, 1.0, 1.0])})
    found, _ = actuator_columns(trial, ["azimuth_2"])
    assert np.cos(step_means(trial.t, found, np.array([0.0, 2.0]))) == pytest.approx(np.ones((1, 1)))


@pytest.mark.slow
def test_a_check_asks_whether_a_rudder_on_its_way_is_held() -> None:
    ship = load_ship("esso_osaka_3m")
    plan = parse_maneuver("zigzag:20/20", ship, speed=0.8)
    codes = {}
    for dt in (0.05, 0.4):
        trial = simulate(ship, plan, dt)
        codes[dt] = [f.code for f in check([trial])[0].findings]
        for words in (SAMPLED, "held"):
            said = check([replace(trial, meta={"inputs": words})])[0]
            assert "held_rudder" not in [f.code for f in said.findings]
    assert "held_rudder" in codes[0.4] and "held_rudder" not in codes[0.05]


def orders_followed(
    rate: float, seed: int, fine: float = 0.002, seconds: float = 200.0
) -> tuple[np.ndarray, np.ndarray]:
    """Times and angles of an actuator that follows orders at a limited ``rate``."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, seconds, fine)
    angle, order, until = np.zeros(len(t)), 0.0, 0.0
    for i in range(1, len(t)):
        if t[i] >= until:
            order, until = rng.uniform(-35, 35), t[i] + rng.uniform(3, 12)
        angle[i] = angle[i - 1] + np.clip(order - angle[i - 1], -rate * fine, rate * fine)
    return t, angle


@pytest.mark.slow
@pytest.mark.parametrize(("every", "noise", "share"), [(0.78, 0.0, 0.35), (0.3, 0.0, 0.25), (0.78, 0.1, 0.5)])
def test_where_an_actuator_of_limited_rate_starts_and_stops_between_samples_is_found(
    every: float, noise: float, share: float
) -> None:
    fine, angle = orders_followed(13.0, 1)
    step = round(every / 0.002)
    t, at = fine[::step], angle[::step]
    at = at + noise * np.random.default_rng(2).standard_normal(len(at))
    shown = fine <= t[-1]

    def error(times: np.ndarray, values: np.ndarray) -> float:
        return float(np.std(np.interp(fine[shown], times, values) - angle[shown]))

    times, values = with_corners(t, at)
    assert len(times) > len(t) and (np.diff(times) > 0).all() and np.isin(t, times).all()
    assert error(times, values) < share * error(t, at)
    edges = np.linspace(0, t[-1], 300)
    means = [straight_means(t, at[:, None], edges)[:, 0], straight_means(fine, angle[:, None], edges)[:, 0]]
    assert np.std(means[0] - means[1]) < share * error(t, at)


def test_other_actuators_are_joined_by_straight_lines() -> None:
    t, rng = np.arange(300) * 0.5, np.random.default_rng(1)
    for values in (np.sin(t / 3), np.sin(t / 3) + 0.01 * rng.standard_normal(300), np.zeros(300), np.cumsum(
        rng.standard_normal(300)), np.where(t > 50, 1.0, 0.0), np.where(t > 50, np.nan, t)):  # fmt: skip
        times, same = with_corners(t, values)
        assert times is t and same is values
    edges = np.linspace(0.0, t[-1], 400)
    own = straight_means(t, np.column_stack([np.sin(t), t]), edges)
    inner = np.linspace(edges[:-1], edges[1:], 201)
    np.testing.assert_allclose(own[:, 0], np.interp(inner, t, np.sin(t)).mean(axis=0), atol=2e-3)
    np.testing.assert_allclose(own[:, 1], 0.5 * (edges[:-1] + edges[1:]), rtol=1e-12, atol=1e-12)


# A set of trials works out what is known of it once, and is made of files, folders and trials alike
def test_files_folders_and_trials_make_the_same_set(tmp_path: Path) -> None:
    trials = [make_trial(name) for name in ("a", "b")]
    for trial in trials:
        write_trial(trial, tmp_path / f"{trial.name}.csv")
    of_folder, of_files = TrialSet.of(tmp_path), TrialSet.of([tmp_path / "a.csv", trials[1]])
    assert [t.name for t in of_folder] == [t.name for t in of_files] == ["a", "b"]
    np.testing.assert_allclose(of_folder[0]["u"], trials[0]["u"], atol=1e-6)
    assert TrialSet.of(of_files) is of_files and of_files[:1] == (of_files.trials[0],) and len(of_files) == 2
    with pytest.raises(UserError):
        TrialSet.of(tmp_path / "absent.csv")


def test_only_the_trials_that_share_rows_stay_together_whatever_another_folder_calls_its_own() -> None:
    other = make_trial("run", u=make_trial()["u"] + 0.01)
    trials = TrialSet.of([make_trial("run"), other, make_trial("copy")])
    assert trials.sharing == [(0, 2)] and trials.apart == [(0, 2), (1,)]
    assert len(shared_rows(trials, [])) == 1 and shared_rows(trials[1:2], trials[2:]) == []


def test_what_is_known_is_worked_out_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    counted = lambda trials, copies: calls.append(len(trials)) or check(trials, copies)  # noqa: E731
    monkeypatch.setattr("cases.trial_set.check", counted)
    some = TrialSet.of([make_trial("a")])
    assert some.reports is some.reports and some.sound is some.sound
    ready([some[0]])  # the same trials once more, as a second fit of a session asks for them
    assert calls == [1] and ready([some[0]])[0] is ready(some)[0]
    with pytest.raises(ValueError, match="read-only"):
        some[0]["u"][0] = 9.0


def test_a_measured_column_is_its_own_root_and_a_derived_one_rests_on_others() -> None:
    columns = make_trial().columns
    trial = Trial("a", columns, ancestors={"u": ("x", "y", "psi"), "r": ("psi",), "n": ()})
    assert trial.roots("u", "v") == {"x", "y", "psi", "v"} and trial.roots("n") == frozenset()
    assert trial.measured("psi") and not trial.measured("u") and not trial.measured("n_2")


def test_a_trial_is_a_table_with_the_headers_of_a_trial_file():
    trial = Trial("a<b", {"t": np.arange(3.0), "u": np.array([1.0, np.nan, 3.0]), "n_3": np.zeros(3)})
    assert list(trial.to_pandas()) == ["t [s]", "u [m/s]", "n_3 [rps]"]
    page = trial._repr_html_()
    assert "a&lt;b" in page and "u [m/s]" in page and "<td>2</td>" in page


def test_a_ship_is_a_table_of_its_coefficients():
    ship = load_ship("esso_osaka_3m")
    table = ship.to_pandas()
    assert table.loc["Y_v", "value"] == ship.coefficients["Y_v"].value and tuple(table.index) == ship.symbols
    assert "esso_osaka_3m" in ship._repr_html_() and "Y_v" in ship._repr_html_()


def test_the_rudder_of_a_trial_is_its_own_the_mean_of_two_or_none():
    t = np.arange(3.0)
    columns = {"t": t, "delta_port": 0.2 * t, "delta_starboard": 0.4 * t}
    np.testing.assert_allclose(Trial("twin", columns).rudder, 0.3 * t)
    np.testing.assert_array_equal(Trial("single", {**columns, "delta": t}).rudder, t)
    np.testing.assert_array_equal(Trial("azimuth", {"t": t}).rudder, np.zeros(3))
