"""Every verb is a function with the options' names; ships follow inputs that a program gives; figures are axes."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
import pytest

import mmg_ident as mi
from cases.simulation.simulate import write_trial
from residual.settings import KINDS
from tests.support.calibrated import FREE
from tests.support.synthetic_runs import coarse_runs

# Of commands alone: what is printed and where files go; trials and models are arguments of other names there
PRINTED = {"json", "out", "force", "resume", "no_report", "scheduler", "plot", "pdf", "command"}
NAMES: dict[str, dict[str, str]] = {
    "simulate": {"effect": "effects", "controls": "maneuver"},
    "imo": {"ships_and_trials": "model", "ship": "model"},
    "diagnose": {"run": "model"},
    "gap": {"run": "model"},
    "score": {"runs_and_trials": "model"},
    "scale": {"run": "model", "rho": "density"},
}
"""Of a verb: name of an argument -> that of the function, where one argument takes what two options do."""
LEFT: dict[str, set[str]] = {
    "fit": set(),
    "simulate": {"scatter", "members"},  # imo gives figures of draws, simulate_many their runs; each of ship.members
    "predict": {"campaign"},  # TrialSet.said_campaign
    "diagnose": {"campaign"},
    "gap": {"time_limit"},  # of the parts that a folder keeps
    "select": {"list_", "terms", "write"},  # looks at the candidates of a command line
    "check": {"ship", "every"},
    "score": {"campaign", "sigma_from"},  # sigma takes numbers
}
FUNCTIONS = {"fit": "calibrate", "import": "import_logs"}
VERBS = ("fit", "train", "select", "score", "predict", "imo", "diagnose", "gap", "plan", "months", "fleet", "view",
         "import", "simulate", "check", "scale", "compare", "card")  # fmt: skip


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> mi.FitResult:
    train, held_out = coarse_runs()
    options = {"only": list(FREE), "next_trial": False, "estimator": "windows"}
    return mi.calibrate("esso_osaka_3m", train[:2], held_out[:1], **options)


@pytest.mark.parametrize("verb", VERBS)
def test_a_function_takes_what_its_command_takes(verb: str) -> None:
    name = "import_" if verb == "import" else verb
    command = getattr(import_module(f"mmg_ident.commands.{name}"), name)
    function = getattr(mi, FUNCTIONS.get(verb, verb))
    options = set(inspect.signature(command).parameters) - PRINTED - {"settings"}
    wanted = {NAMES.get(verb, {}).get(option, option) for option in options - LEFT.get(verb, set())}
    assert wanted <= set(inspect.signature(function).parameters)


def test_what_contradicts_itself_is_refused_unless_told_to_take_it() -> None:
    trial = coarse_runs()[0][0]
    wrong = trial.with_columns(u=3.0 * trial["u"])
    assert {report.verdict for report in mi.check([wrong])} == {"contradictory"}
    for verb in (mi.score, mi.predict):
        with pytest.raises(mi.UserError, match="contradictory"):
            verb("esso_osaka_3m", [wrong])
        assert verb("esso_osaka_3m", [wrong], unchecked=True)


# Inputs over time


def test_inputs_over_time_move_her_as_those_of_a_trial_do() -> None:
    turn = mi.simulate("esso_osaka_3m", "turning:35", duration=20.0, dt=0.1)
    again = mi.simulate("esso_osaka_3m", turn.t, n=turn["n"], delta=turn["delta"], x0=turn.states[0])
    follow = mi.simulate("esso_osaka_3m", turn)
    assert np.abs(again.states - follow.states).max() < 1e-12


def test_numbers_arrays_and_functions_of_time_are_inputs() -> None:
    t = np.arange(0.0, 10.0, 0.1)
    angle = 0.2 * np.sin(t)
    one = mi.simulate("esso_osaka_3m", t, n=10.0, delta=angle)
    two = mi.simulate("esso_osaka_3m", t, n=lambda _: 10.0, delta=lambda s: 0.2 * np.sin(s))
    assert np.abs(one.states - two.states).max() < 1e-12 and one["u"][-1] > 0.03
    windy = mi.simulate("esso_osaka_3m", t, n=0.0, delta=0.0, wind_speed=5.0, wind_direction=np.pi / 2)
    assert windy["v"][-1] < -1e-4  # from the east: she drifts to the west, heading north


def test_draws_are_simulated_one_by_one() -> None:
    ship = mi.load_ship("esso_osaka_3m")
    value = ship.coefficients["N_r"].value
    draws = pd.DataFrame({"N_r": [value, 1.5 * value]})
    same, damped = mi.simulate_many(draws, "turning:35", ship=ship, duration=20.0)
    own = mi.simulate(ship, "turning:35", duration=20.0)
    assert np.array_equal(same.states, own.states) and damped["r"][-1] < same["r"][-1]
    assert len(mi.simulate_many([ship, "kvlcc2_l7"], "turning:35", duration=5.0)) == 2


# Results


@pytest.fixture
def axes() -> Iterator[Callable[[], Any]]:
    matplotlib.use("agg")
    from matplotlib import pyplot

    yield lambda: pyplot.figure().add_subplot()
    pyplot.close("all")


@pytest.mark.slow
def test_figures_of_a_fit_are_drawn_on_the_axes_given(fit: mi.FitResult, axes: Callable[[], Any]) -> None:
    for draw in (fit.plot.tracks, fit.plot.residuals, fit.plot.forces, fit.plot.coefficients, fit.plot.correlation):
        ax = axes()
        assert draw(ax) is ax and (ax.lines or ax.images)
    assert len(fit.plot.tracks(axes(), trial=1, window=0.0).lines) == 3
    line = fit.plot.residuals(axes(), channel="u").lines[0]
    assert abs(line.get_ydata()[0]) < 1e-12  # windows begin at the measured state


@pytest.mark.slow
def test_forces_of_a_figure_are_those_of_the_right_hand_side(fit: mi.FitResult, axes: Callable[[], Any]) -> None:
    trial = fit.fitted_objects.trials[0]
    drawn = {line.get_label(): line.get_ydata() for line in fit.plot.forces(axes(), component="N").lines}
    controls = {"n": trial["n"][50], "delta": trial["delta"][50], "wind_north": trial.wind_vector[50, 0],
                "wind_east": trial.wind_vector[50, 1]}  # fmt: skip
    table = fit.ship.rhs.forces(trial.states[50], controls)
    assert drawn["hull"][50] == pytest.approx(table.loc["hull", "N [N m]"], rel=1e-9)
    assert set(drawn) == set(table.index)


@pytest.mark.slow
def test_figures_of_standard_manoeuvres_and_trials_are_axes(axes: Callable[[], Any]) -> None:
    judged = mi.imo("esso_osaka_3m", scatter=0)
    assert {row.figure for row in judged.rows} >= {"advance", "tactical_diameter", "overshoot_1"}
    ax = axes()
    assert judged.plot(ax=ax) is ax and len(ax.lines) >= 2
    for given in (("zigzag:10/10", axes()), (axes(), "zigzag:10/10")):
        assert judged.plot(*given).lines
    assert judged.plot(ax) is ax and judged.plot("zigzag:10/10", ax=ax) is ax and judged.plot(ax, kind="turning") is ax
    with pytest.raises(mi.UserError):
        judged.plot("pirouette")
    turn = mi.simulate("esso_osaka_3m", "turning:35", duration=150.0)
    ax = axes()
    assert turn.plot(ax) is ax and np.array_equal(ax.lines[0].get_xdata(), turn["y"])
    simulated = mi.imo("esso_osaka_3m", scatter=0, speed=float(turn["u"][0]))
    pair = [{r.figure: r.value for r in one.rows} for one in (mi.imo("esso_osaka_3m", [turn]), simulated)]
    assert pair[0]["tactical_diameter"] == pytest.approx(pair[1]["tactical_diameter"], rel=0.02)


@pytest.mark.slow
def test_results_say_what_they_are_in_a_few_lines(fit: mi.FitResult) -> None:
    turn = mi.simulate("esso_osaka_3m", "turning:35", duration=20.0)
    held_out = coarse_runs()[1][:1]
    judged = (mi.imo("esso_osaka_3m", scatter=0), mi.score(fit.ship, held_out), mi.predict(fit.ship, held_out)[0])
    objects = (fit, fit.ship, turn, mi.TrialSet.of([turn]), *judged, fit.loss, fit.plot, fit.ship.rhs, fit.problem)
    assert {type(one).__name__: repr(one).count("\n") for one in objects if len(repr(one)) > 1500} == {}


@pytest.mark.slow
def test_a_summary_begins_with_what_the_data_say(fit: mi.FitResult) -> None:
    lines = fit.summary().splitlines()
    first = min(fit.estimates.items(), key=lambda row: row[1].prior_share)
    at = next(k for k, line in enumerate(lines) if line.startswith("  "))
    assert lines[at].split()[:2] == [first[0], f"{first[1].value:.4g}"] and len(lines) < 40
    assert fit._repr_html_().count("<tr>") <= 21


def test_raw_logs_become_trials_and_what_is_open_is_an_error(tmp_path: Path) -> None:
    write_trial(coarse_runs()[0][0], tmp_path / "log.csv")
    trials = mi.import_logs(tmp_path / "log.csv", tmp_path / "trials", reference_point=[0.0, 0.0])
    assert len(trials) == 1 and (tmp_path / "trials" / "import.toml").exists()
    with pytest.raises(mi.UserError):
        mi.import_logs(tmp_path / "log.csv", tmp_path / "others", rudder_positive="larboard")
    assert not (tmp_path / "others").exists()


@pytest.mark.slow
def test_structures_are_chosen_from_python() -> None:
    train, held_out = coarse_runs()
    choice = mi.select("esso_osaka_3m", train[:2], held_out[:1], only="mmg")
    assert choice.chosen == "mmg" and choice.result.converged


@pytest.mark.parametrize("model", KINDS)
def test_a_black_box_is_trained_by_its_name(model: str) -> None:
    found = mi.train("esso_osaka_3m", coarse_runs()[0], model=model, epochs=1, seeds=1, width=4, step=1.0)
    assert found.model == model and found.black_box is not None
