"""The package mmg_ident: names, what importing it costs; every verb is a function and does what the command does."""

from __future__ import annotations

import ast
import inspect
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
import pytest

import mmg_ident
import mmg_ident as mi
from cases.simulation.simulate import write_trial
from fitting.calibrate import FitOptions
from mmg_ident import shadowing_mmg
from mmg_ident.commands.main import main
from residual.settings import KINDS
from tests.support.calibrated import FREE
from tests.support.commands import shown
from tests.support.synthetic_runs import coarse_runs
from tests.support.trial_files import write_trials

# The package mmg_ident: its names, what importing it costs, and that it does what the commands do
pytestmark = pytest.mark.usefixtures("blank_figures")
ROOT = Path(__file__).parents[2]
HEAVY = ("torch", "casadi", "matplotlib", "pandas", "pydantic", "scipy", "numpy")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Trial files, and what the functions of the package make of them."""
    folder = tmp_path_factory.mktemp("door")
    train, held_out = coarse_runs()
    write_trials(folder / "train", train[:2])
    write_trial(held_out[0], folder / "held_out.csv")
    ship = mmg_ident.load_ship("esso_osaka_3m")
    ship = ship.fixing([s for s in ship.symbols if s not in FREE])
    fit = mmg_ident.calibrate(ship, folder / "train", folder / "held_out.csv", options=FitOptions(next_trial=False))
    fit.save(folder / "run")
    return folder


def loaded_after(code: str) -> list[str]:
    """Heavy modules in memory after ``code`` in a new process."""
    done = in_python("-c", f"{code}\nimport sys; print([name for name in {HEAVY} if name in sys.modules])")
    assert done.returncode == 0, done.stderr
    return list(ast.literal_eval(done.stdout.splitlines()[-1]))


def without_times(value: Any) -> Any:
    """A part of result.json without what the clock decides."""
    if isinstance(value, dict):
        return {key: without_times(item) for key, item in value.items() if "seconds" not in key}
    return [without_times(item) for item in value] if isinstance(value, list) else value


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "allowed"),
    [
        ("import mmg_ident", set()),
        ("from mmg_ident.commands.main import main; main(['--help'])", set()),
        ("from mmg_ident.commands.main import main; main(['fit', '--help'])", {"numpy", "pydantic"}),
        ("from mmg_ident import calibrate, load_ship, read_trials, score", {*HEAVY} - {"torch", "matplotlib"}),
    ],
)
def test_nothing_heavy_is_imported_before_it_is_used(code: str, allowed: set[str]) -> None:
    assert set(loaded_after(code)) <= allowed


def test_every_public_name_can_be_taken_and_is_documented() -> None:
    for name in mmg_ident.__all__:
        assert getattr(mmg_ident, name) is not None
    assert set(dir(mmg_ident)) == set(mmg_ident.__all__)
    with pytest.raises(AttributeError, match="'nonsense'"):
        mmg_ident.nonsense  # noqa: B018


def test_types_that_an_editor_sees_are_those_that_are_loaded() -> None:
    tree = ast.parse(Path(mmg_ident.__file__).read_text())
    guarded = next(node for node in tree.body if isinstance(node, ast.If))
    named = {
        alias.asname or alias.name: (node.module, alias.name)
        for node in guarded.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert set(named) | {"__version__"} == set(mmg_ident.__all__)
    for name, (module, there) in named.items():
        assert getattr(__import__(str(module), fromlist=[there]), there) is getattr(mmg_ident, name)


@pytest.mark.slow
def test_a_notebook_and_the_command_leave_the_same_folder(folder: Path, tmp_path: Path) -> None:
    arguments = ["fit", "esso_osaka_3m", str(folder / "train"), "--validate", str(folder / "held_out.csv")]
    options = ["--only", ",".join(FREE), "--no-next-trial"]
    assert main([*arguments, *options, "--out", str(tmp_path / "run")]) == 0
    names = [sorted(str(p.relative_to(f)) for p in f.rglob("*")) for f in (folder / "run", tmp_path / "run")]
    assert names[0] == names[1]
    ours, theirs = (json.loads((f / "result.json").read_text()) for f in (folder / "run", tmp_path / "run"))
    assert set(ours) == set(theirs)
    for key in set(ours) - {"created", "command", "timings_s"}:
        assert without_times(ours[key]) == without_times(theirs[key]), key
    assert (folder / "run" / "ship.toml").read_text() == (tmp_path / "run" / "ship.toml").read_text()


@pytest.mark.slow
def test_scores_are_those_of_the_command_and_tables_as_predictions_are(folder: Path) -> None:
    held_out = mmg_ident.read_trials([folder / "held_out.csv"])
    ours = mmg_ident.score(mmg_ident.load_run(folder / "run"), held_out)
    assert ours.window < mmg_ident.score("esso_osaka_3m", held_out).window
    theirs = shown("score", folder / "run", folder / "held_out.csv")["models"][str(folder / "run")]
    assert (theirs["window"], theirs["paper"]) == (ours.window, ours.paper)
    assert theirs["units"]["pooled"]["v_m_s"] == ours.units.pooled.v_m_s
    table = ours.to_pandas()
    assert list(table["window"]) == [trial.window for trial in ours.trials]
    assert list(table["v_m_s"]) == [run.v_m_s for run in ours.units.runs] and "v_m_s" in ours._repr_html_()
    assert "baseline" in mmg_ident.score(folder / "run", held_out, baseline=folder / "held_out.csv").units.ratio
    (found,) = mmg_ident.predict(folder / "run", folder / "held_out.csv")
    assert found.to_pandas()["window"].nunique() == len(found.windows) and found.trial.name in found._repr_html_()


def test_a_folder_that_is_no_run_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text('{"kind": "poem"}')
    with pytest.raises(mmg_ident.UserError, match="poem"):
        mmg_ident.load_run(tmp_path)


# Another package named mmg is met with one clear line; ours is found wherever it is installed


def in_python(
    *words: str, folder: Path = ROOT, first: str = "", **environment: str
) -> subprocess.CompletedProcess[str]:
    """What a new Python with these words in a ``folder`` ended with; first: in its path before the repository."""
    more = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, (first, str(ROOT))))}
    return subprocess.run([sys.executable, *words], cwd=folder, env=more, capture_output=True, text=True, check=False)


def test_another_mmg_before_ours_stops_every_command_in_one_line(tmp_path: Path) -> None:
    assert shadowing_mmg() == ""
    other = tmp_path / "site" / "mmg"
    other.mkdir(parents=True)
    (other / "__init__.py").write_text("raise SystemExit('the other package was executed')\n")
    done = in_python("-m", "mmg_ident", "ships", folder=tmp_path, first=str(tmp_path / "site"))
    assert done.returncode == 2 and done.stdout == ""
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("mmg: ") and str(other) in line


# Every verb is a function with the options' names; ships follow inputs that a program gives; figures are axes
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
    pair = [
        {r.figure: r.value for r in one.rows if r.run in ("turning_35", "turning:35")}
        for one in (mi.imo("esso_osaka_3m", [turn]), simulated)
    ]
    assert pair[0]["tactical_diameter"] == pytest.approx(pair[1]["tactical_diameter"], rel=1e-5)


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
