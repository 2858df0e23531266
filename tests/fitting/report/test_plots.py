"""Figures: they show what they claim, at true scale, and leave matplotlib's global state alone."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from cases.trial import Trial
from fitting.prediction.predict import Window, predict
from fitting.report.plot_maneuvers import COLOURS as LINES
from fitting.report.plot_style import DASHES, FigureFolder
from fitting.report.plots import error_growth_plot, rms_with_error, trajectory_plot, write_figures
from mmg.rollout import Simulator
from tests.support.calibrated import small_result
from tests.support.colours import apart, told_by_colour_alone


@cache
def held_out_run() -> tuple[Simulator, Trial, list[Window]]:
    """The simulator of the calibrated ship, the held-out trial and its windows of 50 s."""
    objects = small_result().objects
    assert objects
    trial = objects.validation[0]
    return objects.after, trial, predict(objects.after, trial, 50.0, 50.0)[0]


def test_tracks_have_equal_scales_and_run_north_up() -> None:
    _, trial, windows = held_out_run()
    figure = trajectory_plot(trial, windows, windows, length=3.0)
    figure.draw_without_rendering()
    track = figure.axes[0]
    pixels = track.transData.transform([(0, 0), (1, 0), (0, 1)])
    assert pixels[1, 0] - pixels[0, 0] == pytest.approx(pixels[2, 1] - pixels[0, 1], rel=1e-6)
    measured = track.lines[0]
    np.testing.assert_array_equal(measured.get_xdata(), trial["y"])
    np.testing.assert_array_equal(measured.get_ydata(), trial["x"])
    low, high = track.get_xlim()
    assert low <= trial["y"].min() and trial["y"].max() <= high
    scale = track.lines[-1].get_xdata()
    assert track.texts[-1].get_text() == f"{np.ptp(scale):g} m"


def test_a_runaway_prediction_does_not_flatten_the_measured_histories() -> None:
    _, trial, good = held_out_run()
    wild = [type(w)(w.number, w.first, w.last, w.states * 1e4) for w in good]
    ax = trajectory_plot(trial, wild, good).axes[1]
    measured, runaway = ax.lines[0].get_ydata(), ax.lines[1].get_ydata()  # of u, in strips of the height 1
    assert np.ptp(measured) > 0.2 and np.nanmax(runaway) <= 5.0 and np.nanmin(runaway) >= 4.0


def test_a_trial_without_positions_gets_histories_only() -> None:
    _, trial, windows = held_out_run()
    blind = Trial("blind", {k: v for k, v in trial.columns.items() if k not in ("x", "y")})
    figure = trajectory_plot(blind, windows, windows)
    (ax,) = figure.axes
    assert "r [deg/s]" in [t.get_text() for t in ax.texts]


TWIN = {"delta_port": 0.1, "delta_starboard": -0.1, "n": 8.0}


@pytest.mark.parametrize(
    ("inputs", "labels", "lines"),
    [
        (TWIN, ["angles [deg]: delta_port, delta_starboard", "n [1/s]"], 3),
        ({"n": 8.0, "n_2": 7.0}, ["n [1/s]: n, n_2"], 2),
        ({"n": 0.0, "delta": 0.0, "azimuth": 1.0, "n_azimuth": 3.0}, ["angles [deg]", "n [1/s]"], 2),
        ({"n": 0.0, "delta": 0.0}, ["delta [deg]", "n [1/s]"], 2),
    ],
)
def test_every_input_that_moves_is_drawn(inputs: dict[str, float], labels: list[str], lines: int) -> None:
    _, trial, windows = held_out_run()
    states = {c: v for c, v in trial.columns.items() if c not in ("n", "delta")}
    other = Trial("twin", {**states, **{c: np.full(len(trial), v) for c, v in inputs.items()}})
    ax = trajectory_plot(other, windows, windows).axes[1]
    words = [t.get_text() for t in ax.texts if "[" in t.get_text()]
    assert words == ["u [m/s]", "v [m/s]", "r [deg/s]", *labels]
    assert len(ax.lines) == 3 * 3 + lines


def test_strips_stand_over_the_whole_trial_and_mark_where_windows_start() -> None:
    _, trial, windows = held_out_run()
    ax = trajectory_plot(trial, windows, windows).axes[1]
    assert ax.get_xlim() == (0.0, trial.t[-1] - trial.t[0])
    starts = trial.t[[w.first for w in windows]] - trial.t[0]
    np.testing.assert_allclose([s[0, 0] for s in ax.collections[-1].get_segments()], starts)


def test_errors_start_at_zero_and_the_end_is_the_rms_of_the_windows() -> None:
    model, trial, _ = held_out_run()
    figure = error_growth_plot({"after": model}, [trial], horizon=40.0, stride=20.0)
    windows = predict(model, trial, 40.0, 20.0, short_last=False)[0]
    ends = [np.hypot(*(w.states[-1, :2] - trial.states[w.last, :2])) for w in windows]
    line = figure.axes[0].lines[0].get_ydata()
    assert line[0] == 0
    assert line[-1] == pytest.approx(np.sqrt(np.mean(np.square(ends))), rel=1e-9)
    assert f"{len(windows)} windows" in figure.texts[0].get_text()
    assert np.ptp(figure.axes[0].patches[0].get_path().vertices[:, 1]) > 0, "a single trial has windows"
    shorter = error_growth_plot({"before": model}, [trial], horizon=5000.0)
    assert shorter.axes[0].lines, "windows longer than every trial fall back to what there is"


def test_the_standard_error_of_an_rms_is_that_of_leaving_out_trials() -> None:
    squares, run = np.array([[1.0], [1.0], [4.0], [9.0], [np.nan]]), np.array([0, 0, 1, 2, 2])
    rms, std = rms_with_error(squares, run)
    without = np.sqrt([13 / 2, 11 / 3, 6 / 3])
    assert rms[0] == pytest.approx(np.sqrt(15 / 4))
    assert std[0] == pytest.approx(np.sqrt(2 / 3 * np.sum((without - without.mean()) ** 2)))
    assert np.isnan(rms_with_error(squares[:2], run[:2])[1]).all()


@pytest.mark.slow
def test_figures_are_written_and_nothing_global_changes(tmp_path: Path) -> None:
    result = small_result()
    assert result.objects
    before = dict(mpl.rcParams)
    written, o = FigureFolder(tmp_path), result.objects
    write_figures(written, result, (o.before, o.after), o.trials, o.validation)
    assert dict(mpl.rcParams) == before
    names = [entry["file"] for entry in written.rows]
    assert names == ["error_growth.png", *(f"track_{k + 1}.png" for k in range(len(names) - 1))] and len(names) > 1
    for entry in written.rows:
        assert (tmp_path / entry["file"]).stat().st_size > 3000 and entry["title"] and entry["caption"]
    assert o.validation[0].name in written.rows[1]["title"]


# Figures can be read in grey and with deuteranopia: where two colours look alike there, hatches or dashes differ
def test_lines_of_manoeuvres_differ_in_their_dashes() -> None:
    assert len(DASHES) == len(LINES) and len({str(d) for d in DASHES}) == len(DASHES)


def test_two_blues_are_told_apart_and_equal_greys_are_not() -> None:
    assert apart("#0072B2", "#7FB8D9") and not apart("#C00000", "#006000") and not apart("#808080", "#818181")


@pytest.mark.parametrize(("dashes", "hatch", "alike"), [("-", "", 2), ("--", "////", 0)])
def test_what_only_colours_tell_apart_is_found(dashes: str, hatch: str, alike: int) -> None:
    figure = Figure()
    ax = figure.subplots()
    ax.plot([0, 1], color="#C00000", label="one")
    ax.plot([0, 1], color="#006000", ls=dashes, label="other")
    ax.bar([0, 1], [1, 1], color=["#C00000", "#006000"], hatch=["", hatch])
    assert len(told_by_colour_alone(figure)) == alike
