from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from benchmarks.coverage import plant_trials
from cases.evidence.kinematics import consistency
from cases.io.read import read_trials
from cases.shipfiles.effects import with_instruments
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import TRAIN, demo_trials
from cases.simulation.simulate import logged
from cases.trial import Trial
from mmg.effects.gyro import low_passed_samples
from mmg.motion.flow import STATES
from tests.support.disturbed_trials import Disturbed, disturbed_trials
from tests.support.trial_files import make_trial, motion_columns

SHIP = load_ship("esso_osaka_3m")


@lru_cache(maxsize=1)
def clean():
    return tuple(demo_trials(3)[0])


def changed(trials, change):
    """Trials with columns replaced by those that ``change`` makes of the columns."""
    return [trial.with_columns(**change(dict(trial.columns))) for trial in trials]


def late(*names, seconds):
    return lambda c: {name: np.interp(c["t"] - seconds, c["t"], c[name]) for name in names}


def position_off(arm):
    return lambda c: dict(zip("xy", complex_parts(c["x"] + 1j * c["y"] + arm * np.exp(1j * c["psi"])), strict=True))


def course_turned(angle):
    return lambda c: dict(zip("uv", complex_parts((c["u"] + 1j * c["v"]) * np.exp(-1j * angle)), strict=True))


def complex_parts(values):
    return values.real, values.imag


def with_defect(trials, name, **values):
    """The trials as an effect of the library logs them."""
    ship = SHIP.with_effect(name, values)
    out = []
    for trial in trials:
        columns = logged(ship, trial.t, trial.states)
        out.append(trial.with_columns(**dict(zip(STATES, columns.T, strict=True))))
    return out


def symbols(found):
    return [r.symbol for r in found.found]


@pytest.mark.slow
def test_clean_trials_have_no_fault_and_say_what_cannot_be_seen():
    found = consistency(clean(), SHIP)
    assert found.found == () and found.effects() == {}
    assert not [r for run in found.runs for r in run.readings if r.sentence]
    assert len(found.warnings) == 1
    assert all(name in found.warnings[0] for name in ("heading_bias", "gnss_delay", "antenna_offset"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "values", "symbol"),
    [
        ("velocity_filter", {"tau": 0.2}, "lag"),
        ("log_scale", {"share": 0.01}, "gain_u"),
        ("gyro", {"share": -0.013}, "gain_r"),
        ("gyro", {"T": 0.4}, "lag_r"),
        ("antenna_offset", {"x": 0.4, "y": 0.2}, ""),  # these move position and velocity alike: no alarm
        ("heading_bias", {"psi": 0.05}, ""),
        ("gnss_delay", {"tau": 0.6}, ""),
    ],
)
def test_a_fault_of_the_library_is_named_and_measured_where_it_can_be_seen(effect, values, symbol):
    found = consistency(with_defect(clean(), effect, **values), SHIP)
    assert symbols(found) == [symbol] * bool(symbol)
    if symbol:
        ((parameter, truth),) = values.items()
        value, std = found.effects()[effect][parameter]
        assert abs(value - truth) < 3 * std and std < 0.2 * abs(truth)
        reading = found.pooled[symbol]
        assert reading.effect == effect and effect in reading.sentence


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "symbol", "truth"),
    [
        (position_off(0.3), "arm_x", 0.3),
        (position_off(-0.3j), "arm_y", -0.3),
        (late("x", "y", seconds=0.5), "lag", -0.5),
        (course_turned(0.05), "heading", 0.05),
        (lambda c: {"v": 1.2 * c["v"]}, "gain_v", 0.2),
        (lambda c: {"v": c["v"] + 0.02}, "bias_v", 0.02),
        (lambda c: {"x": c["x"] - 0.04 * (c["t"] - c["t"][0])}, "drift_x", -0.04),
        (lambda c: {"r": c["r"] + 0.002}, "bias_r", 0.002),
    ],
)
def test_faults_without_an_effect_of_the_library_are_measured_but_not_freed(change, symbol, truth):
    found = consistency(changed(clean()[:4], change), SHIP)
    reading = found.pooled[symbol]
    assert symbols(found) == [symbol] and found.effects() == {}
    assert abs(reading.value - truth) < 3 * reading.std + 1e-3 * abs(truth)


def test_late_columns_are_told_from_a_late_velocity_over_ground():
    body = consistency(changed([make_trial()], late("u", "v", seconds=0.8)), SHIP)
    earth = consistency(with_defect([make_trial()], "velocity_filter", tau=0.8), SHIP)
    assert (body.pooled.frame, earth.pooled.frame) == ("body", "earth")
    for found in (body, earth):
        assert found.pooled["lag"].value == pytest.approx(0.8, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("axes", ["body", "earth"])
def test_the_axes_of_a_short_filter_are_told_in_the_noise_of_usual_sensors(axes):
    """A low pass of 0.35 s in body axes leaves a steady turn as it is: in the earth frame no lag is seen then, and the
    rows that show it would count as outliers."""
    how = Disturbed(X=0.05, Y=0.15, N=0.1, noise_tau=0.01, defects=())
    trials = []
    for trial in disturbed_trials(SHIP, TRAIN, 4, how):
        turn = np.exp(1j * np.where(axes == "body", 0.0, trial["psi"]))
        w = (trial["u"] + 1j * trial["v"]) * turn
        late = low_passed_samples(trial.t, w.real, 0.35) + 1j * low_passed_samples(trial.t, w.imag, 0.35)
        trials.append(trial.with_columns(u=(late / turn).real, v=(late / turn).imag))
    found = consistency(trials, SHIP)
    lag = found.pooled["lag"]
    assert symbols(found) == ["lag"] and found.pooled.frame == axes
    assert abs(lag.value - 0.35) < 3 * lag.std < 0.3
    assert found.form_of("velocity_filter") == ("velocity_filter" + (":body_axes=1" if axes == "body" else ""))
    assert found.form_of("gyro") == "gyro"
    ship = with_instruments(SHIP, ("velocity_filter",), trials)
    assert ship.coefficients["velocity_filter.body_axes"].value == (axes == "body")
    assert "velocity_filter.tau" in ship.free and "velocity_filter.body_axes" not in ship.free


def test_velocities_of_another_run_are_a_fault_of_the_data():
    other = replace(clean()[2], name="mixed up")
    length = min(len(other), len(clean()[0]))
    columns = {name: c[:length] for name, c in other.columns.items()}
    columns |= {name: clean()[0][name][:length] for name in ("u", "v", "r")}
    columns["psi"] = columns["psi"] + 2.0
    found = consistency([*clean(), replace(other, columns=columns)], SHIP)
    assert [run.name for run in found.runs if run.faults] == ["mixed up"]
    assert found.found == ()


def test_without_positions_only_the_turn_rate_is_checked():
    bare = [Trial(t.name, {c: v for c, v in t.columns.items() if c not in "xy"}) for t in clean()]
    found = consistency(changed(bare, lambda c: {"r": 1.02 * c["r"]}), SHIP)
    assert all(math.isnan(r.value) for r in found.pooled.readings if not r.symbol.endswith("_r"))
    assert symbols(found) == ["gain_r"]
    assert any(bare[0].name in w for w in found.warnings)
    mixed = consistency([*bare[:2], *clean()[2:]], SHIP)
    assert not mixed.found and abs(mixed.pooled["lag"].value) < 0.1


def test_gaps_coarse_clocks_and_hopeless_runs_do_no_harm():
    gappy, rng = [], np.random.default_rng(1)
    for trial in with_defect(clean(), "velocity_filter", tau=0.7):
        keep = np.ones(len(trial), dtype=bool)
        keep[200:320] = False
        columns = {name: c[keep][::5].copy() for name, c in trial.columns.items()}
        columns["x"][rng.integers(0, len(columns["x"]), 10)] = np.nan
        gappy.append(replace(trial, columns=columns))
    c = motion_columns(30.0)
    rest = make_trial("rest", **{name: np.zeros(3000) for name in ("x", "y", "u", "v", "r", "psi")})
    short = Trial("short", {name: column[:30] for name, column in c.items()})
    found = consistency([*gappy, rest, short], SHIP)
    assert symbols(found) == ["lag"]
    assert abs(found.pooled["lag"].value - 0.7) < 3 * found.pooled["lag"].std
    assert not any(r.sentence for run in found.runs[-2:] for r in run.readings)
    assert all(math.isnan(r.value) for r in consistency([rest], SHIP).pooled.readings)


def test_values_and_thresholds_grow_with_the_ship():
    factor = 100.0
    big = replace(SHIP, particulars={**SHIP.particulars, "L": factor * SHIP.particulars["L"]})
    root = math.sqrt(factor)
    power = {"t": root, "x": factor, "y": factor, "u": root, "v": root, "r": 1 / root}
    small = with_defect(clean()[:4], "velocity_filter", tau=0.7)
    large = [t.with_columns(**{name: p * t[name] for name, p in power.items()}) for t in small]
    a, b = consistency(small, SHIP).pooled["lag"], consistency(large, big).pooled["lag"]
    assert b.value == pytest.approx(root * a.value, rel=0.05) and a.sentence and b.sentence


@pytest.mark.slow
def test_as_bad_as_real_sensors_a_hidden_lag_is_still_recovered():
    how = Disturbed(X=0.05, Y=0.15, N=0.1, defects=("velocity_filter:tau=0.7", "log_scale:share=0.01"))
    found = consistency(disturbed_trials(SHIP, TRAIN, 1, how), SHIP)
    assert set(symbols(found)) == {"lag", "gain_u"}
    for symbol, truth in (("lag", 0.7), ("gain_u", 0.01)):
        assert abs(found.pooled[symbol].value - truth) < 3 * found.pooled[symbol].std


@pytest.mark.longest
@pytest.mark.slow
def test_false_alarms_are_rare_on_clean_trials():
    how = Disturbed(X=0.05, Y=0.15, N=0.1, defects=())
    results = [consistency(disturbed_trials(SHIP, TRAIN, seed, how), SHIP) for seed in range(20)]
    alarms = sum(len(found.found) for found in results)
    assert alarms <= 0.05 * sum(len(found.pooled.readings) for found in results)


@pytest.mark.data
def test_the_real_records_have_late_velocities_and_a_gyro_that_reads_low(frt):
    names = ("random_31-Jul-2020_12_29_58", "random_06-Aug-2020_16_24_25_1", "turn_14-Sep-2020_13_39_32")
    paths = [p for p in sorted(frt.rglob("*.csv")) if p.stem in names]
    found = consistency(read_trials(paths), SHIP)
    assert 0.85 < found.pooled["lag"].value < 1.0
    assert -0.02 < found.pooled["gain_r"].value < -0.008
    assert set(symbols(found)) == {"lag", "gain_r"}


def test_the_same_logs_are_compared_once_and_others_anew():
    trials = list(clean())[:2]
    first = consistency(trials, SHIP)
    assert consistency(trials, SHIP) is first
    other = consistency(changed(trials, lambda c: {"r": 1.05 * c["r"]}), SHIP)
    assert other != first and symbols(other) != symbols(first)


@pytest.mark.slow
def test_a_filter_is_fitted_along_where_trials_show_it_or_cannot_tell_and_not_where_they_rule_it_out():
    def freed(ship, trials):
        return {s for s in with_instruments(ship, ["shown"], trials).free if s.startswith("velocity_filter")}

    blind = [replace(t, columns={k: v for k, v in t.columns.items() if k not in ("x", "y")}) for t in clean()]
    assert freed(SHIP, with_defect(clean(), "velocity_filter", tau=1.0))
    assert freed(SHIP, blind) and not freed(SHIP, clean())
    ship, zigzags, _ = plant_trials(51)  # another plant with other noise and sampling
    assert not freed(ship, zigzags)
    assert freed(ship, [trial for t in zigzags for trial in changed([t], late("u", "v", seconds=2 * t.dt))])
