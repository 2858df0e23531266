"""Derived velocities are as wrong as they say."""

from __future__ import annotations

import numpy as np
import pytest

from cases.importing.derived_motion import derived_velocities, resolution_of, smoothed
from mmg.errors import TooFewData
from mmg_ident import simulate
from tests.support import raw_logs

H = 0.5  # s


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.02, 0.5, 2.0])
def test_the_standard_error_of_a_rate_is_that_of_repeated_noise(noise: float) -> None:
    """A rate that was measured as well makes it smaller."""
    t, n = np.arange(800) * H, 800
    path, speed = 60 * np.sin(t / 40) + 1.2 * t, 1.5 * np.cos(t / 40) + 1.2
    errors = []
    for with_rate in (False, True):
        squares, claims = [], []
        for seed in range(6):
            rng = np.random.default_rng(seed)
            rate = speed + 0.1 * rng.standard_normal(n) if with_rate else None
            found = smoothed(H, path + noise * rng.standard_normal(n), rate)
            squares.append(np.mean((found.rate - speed)[20:-20] ** 2))
            claims.append(found.rate_std)
        errors.append(np.sqrt(np.mean(squares)))
        assert 0.5 < errors[-1] / np.mean(claims) < 1.4, (with_rate, errors, claims)
    assert noise < 2.0 or errors[1] < 0.8 * errors[0]


@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_lines_between_rare_measurements_do_not_count_as_measurements(noise: float) -> None:
    """Positions of every second in rows of ten a second: the standard errors were over ten times too small."""
    truth = raw_logs.run()
    rng = np.random.default_rng(1)
    t, seconds = np.arange(0.0, 170.0, 0.1), np.arange(0.0, 171.0)
    rare = {c: np.interp(seconds, truth.t, truth[c]) + noise * rng.standard_normal(len(seconds)) for c in ("x", "y")}
    columns = {c: np.interp(t, seconds, values) for c, values in rare.items()}
    new, std, *_ = derived_velocities(
        t, {**columns, "psi": np.interp(t, truth.t, truth.psi_unwrapped)}, {"x": 1.0, "y": 1.0, "psi": 0.5}
    )
    errors = [np.sqrt(np.nanmean((new[c] - np.interp(t, truth.t, truth[c]))[50:-50] ** 2)) for c in "uv"]
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) / std["u"] < 1.6, (errors, std)


def test_surge_and_sway_of_a_turning_ship() -> None:
    """A ship in a zigzag: within three standard errors in nearly all rows, and gaps stay gaps."""
    truth = raw_logs.run()
    rng = np.random.default_rng(3)
    x, y = (truth[c] + 0.03 * rng.standard_normal(len(truth)) for c in ("x", "y"))
    x[120:150] = np.nan
    new, std, _, said = derived_velocities(truth.t, {"x": x, "y": y, "psi": truth["psi"]})
    gap = np.isnan(new["u"])
    assert gap[120:150].all() and gap.sum() == 30
    for name in "uv":
        error = (new[name] - truth[name])[~gap][10:-10]
        assert np.mean(np.abs(error) < 3 * std[name]) > 0.95
        assert np.std(error) < 0.02
    assert "r" in new and len(said) == 2


def test_speed_and_course_alone_suffice() -> None:
    truth = raw_logs.run()
    sog, cog = raw_logs.ground(truth)
    columns = {"sog": sog * raw_logs.KNOT, "cog": np.radians(cog), "psi": truth["psi"], "r": truth["r"]}
    new, std, *_ = derived_velocities(truth.t, columns)
    assert max(np.abs(new[c] - truth[c]).max() for c in "uv") < 3e-4 and set(std) == {"u", "v"}


def derived_of(ship: str, dt: float, digits: int, noise: float = 0.0, sog: int | None = None, seed: int = 0):
    """Derived motion of a zigzag whose positions, headings and speeds were rounded to so many digits, and the truth."""
    truth = simulate(ship, "zigzag:20/20", dt=dt, duration=150 if "3m" in ship else 900, seed=1)
    rng = np.random.default_rng(seed)
    columns = {c: np.round(truth[c] + noise * rng.standard_normal(len(truth)), digits) for c in "xy"}
    columns["psi"] = np.radians(np.round(np.degrees(truth.psi_unwrapped), digits))
    if sog is not None:
        speed, course = raw_logs.ground(truth)
        columns |= {"sog": np.round(speed, sog) * raw_logs.KNOT, "cog": np.radians(np.round(course, sog))}
    grain = {name: resolution_of(values) for name, values in columns.items()}
    return derived_velocities(truth.t, columns, {}, grain), truth


@pytest.mark.slow
@pytest.mark.parametrize(("ship", "dt"), [("esso_osaka_3m", 0.1), ("kvlcc2_full", 1.0)])
@pytest.mark.parametrize(("digits", "noise"), [(1, 0.0), (2, 0.0), (3, 0.0), (6, 0.05)])
def test_the_standard_error_holds_what_rounding_adds(ship: str, dt: float, digits: int, noise: float) -> None:
    """Noiseless tracks had 1e-17 or so; fine rows of a slow ship were smoothed with no digits left."""
    found, truth = derived_of(ship, dt, digits, noise)
    for name in "uvr" if digits < 3 else "uv":
        off = (found.columns[name] - truth[name])[10:-10]
        least = 0.3 if digits < 3 else 0.05  # tenths of a millimetre are more than the step resolves
        assert least < np.sqrt(np.nanmean(off**2)) / found.std[name] < 2.0, name


@pytest.mark.slow
def test_speeds_rounded_to_a_tenth_of_a_knot_do_not_outweigh_good_positions() -> None:
    alone, truth = derived_of("kvlcc2_full", 0.1, 2)
    both, _ = derived_of("kvlcc2_full", 0.1, 2, sog=1)
    off = [float(np.nanstd((d.columns["u"] - truth["u"])[50:-50])) for d in (alone, both)]
    assert off[1] < 2 * off[0] and both.std["u"] > 0.5 * off[1]


def test_speeds_that_disagree_with_the_positions_widen_the_standard_error() -> None:
    truth = raw_logs.run()
    sog, cog = raw_logs.ground(truth)
    columns = {"x": truth["x"], "y": truth["y"], "psi": truth["psi"], "cog": np.radians(cog)}
    speeds, grain = [scale * sog * raw_logs.KNOT for scale in (1.0, 1.05)], {"x": 0.05, "y": 0.05}
    right, wrong = (derived_velocities(truth.t, {**columns, "sog": speed}, {}, grain).std["u"] for speed in speeds)
    assert wrong > 3 * right


@pytest.mark.parametrize("step", [0.1, 0.01, 1852 / 3600 / 10, np.radians(0.1), 1 / 600000])
def test_the_resolution_of_a_column_is_what_divides_its_differences(step: float) -> None:
    rng = np.random.default_rng(0)
    values = step * np.round((40.0 + 0.3 * np.cumsum(rng.standard_normal(400))) / step)
    assert resolution_of(values) == pytest.approx(step, rel=1e-6)
    assert resolution_of(rng.standard_normal(400)) < 1e-9


@pytest.mark.parametrize("values", [{0: 0.0, 700: 1e-300, 1499: 1e300}, {3: 1.0}, {0: 0.0, 1499: 1.0}])
def test_values_that_no_sizes_smooth_are_refused_in_a_line(values: dict[int, float]) -> None:
    wild = np.full(1500, np.nan)
    wild[list(values)] = list(values.values())
    with pytest.raises(TooFewData):
        smoothed(0.1, wild)


@pytest.mark.parametrize(("step", "said"), [(2.0, True), (0.01, False)])
def test_positions_that_are_coarse_against_their_track_are_said(step: float, said: bool) -> None:
    """And columns that never change have a standard error."""
    t = np.arange(0.0, 100.0)
    columns = {"x": step * np.round(0.5 * t / step), "y": 0.0 * t, "psi": 0.0 * t}
    found = derived_velocities(t, columns, {}, {"x": step, "y": step})
    assert ("coarse_positions" in {m.code for m in found.said}) is said
    assert min(derived_velocities(t, columns | {"x": 5.0 * t}).std.values()) > 1e-9
