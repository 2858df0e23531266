"""The report: complete, self-contained, escaped, and honest about a run that did not converge."""

from __future__ import annotations

import html
import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from cases.trial import Trial
from fitting.design.planned_trial import in_words
from fitting.prediction.predict import Window, predict
from fitting.record import MessageRow
from fitting.report.plot_maneuvers import COLOURS as LINES
from fitting.report.plot_style import DASHES
from fitting.report.plots import trajectory_plot
from fitting.report.run_folder import RESULT, read_result, write_json
from fitting.report.sections import plus_minus, structure_section
from fitting.result import write_report
from mmg.errors import BadValue, Missing, NotWritable, UserError
from mmg.messages import has_code
from mmg.rollout import Simulator
from mmg_ident.commands.main import main
from tests.support.calibrated import FREE, small_result
from tests.support.colours import told_by_colour_alone

pytestmark = pytest.mark.usefixtures("blank_figures")
EVIL = '<script>alert("x")</script>'


def run_folder(folder: Path, iterations: int = 100, figures: bool = False, **extra: object) -> Path:
    """A run folder of the small calibration, with or without figures, ``extra`` attributes changed."""
    result = small_result(iterations)
    replace(result, **({} if figures else {"objects": None}), **extra).save(folder)  # type: ignore[arg-type]
    return folder


def words_of(page: str) -> str:
    """The text of a page without its tags."""
    return html.unescape(re.sub(r"<[^>]*>", " ", page))


def report(*folders: Path) -> str:
    """The page that mmg report writes on run folders."""
    out = folders[0].parent / "page.html"
    assert write_report(folders, out, imo=False) == out.read_text()
    return out.read_text()


@pytest.mark.slow
def test_all_of_a_run_is_in_the_page(tmp_path: Path) -> None:
    """And the page loads nothing from elsewhere."""
    folder = run_folder(tmp_path / "run", figures=True)
    text, content = report(folder), read_result(folder)
    words = words_of(text)
    shown = [*FREE, *(f"{symbol} = " for symbol in content["fixed"])]
    shown += [row["name"] for row in content["data"] + content["validation_data"]]
    shown += ["Ship particulars", "Mathematical model", "Trial data", "Causes of error", "Sensitivity", "a.csv --out"]
    assert [part for part in shown if not re.search(rf"(?<!\w){re.escape(part)}", words)] == []
    assert text.count("<img") == len(content["figures"]) >= 1
    assert "NOT CONVERGED" not in words
    links = re.findall(r"\b(?:src|href|srcset|data|action)=[\"']([^\"']+)", text)
    assert links and all(link.startswith(("data:image/png;base64,", "#")) for link in links)
    assert not re.search(r"<(script|link|iframe|object)\b|url\(|@import", text)


def test_words_from_files_are_escaped(tmp_path: Path) -> None:
    messages = tuple(MessageRow(level, "evil", EVIL) for level in ("warning", "notice"))
    ship = replace(small_result().ship, name=EVIL.replace("/", "_"))
    folder = run_folder(tmp_path / "run", ship_name=EVIL, ship=ship, command=EVIL, messages=messages)
    content = read_result(folder)
    row = {"value": 0.9, "std": 0.08, "unit": "s", "prior_value": 0.3, "prior_std": 0.4}
    content["campaigns"] = {
        "runs": {"2020-07-31": 2, EVIL: 2},
        "tried": [],
        "values": {"2020-07-31": {"gyro.T": row}, EVIL: {"gyro.T": row | {"value": 0.0}}},
        "left_out": {"without": 0.1393, "with": 0.1273, "error": 0.1},
        "sentences": [f"the lag of the turn rate differs, from 0 s (2020-07-31) to 0.9 s ({EVIL})"],
    }
    content["figures"] = [{"file": "../../etc/passwd", "title": EVIL, "caption": EVIL}]
    content["coefficients"][EVIL] = content["coefficients"]["Y_v"]
    content["coefficients"]["Y_v"]["description"] = EVIL
    write_json(folder / RESULT, content)
    text = report(folder, folder)
    assert "<script" not in text
    assert "&lt;script&gt;" in text
    assert "root:" not in text
    for part in ("0.1393", "0.1273", "gyro.T [s]", plus_minus(0.9, 0.08)):
        assert part in words_of(text), part


def test_a_run_is_reported_with_what_it_has_and_public_data_are_cited_where_used(tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "run")
    content = read_result(folder)
    del content["scores"]["validation"]
    content["campaigns"] = {"runs": {"2020-07-31": 2}, "tried": [], "values": None, "left_out": None, "sentences": []}
    write_json(folder / RESULT, content)
    text = report(folder)
    assert content["validation_data"][0]["name"] in text and "2020-07-31: 2 runs" in text and "Wakita, K." not in text
    content["scores"] = {}
    content["coefficients"]["Y_v"] |= {"std": None, "prior_share": None}
    content["data"][0]["name"] = "turn_cut_14-Sep-2020_15_58_08"
    write_json(folder / RESULT, content)
    text = report(folder)
    assert "No scores" in text
    assert "Wakita, K." in text and "Miyauchi, Y." in text and "CC BY-NC-SA 4.0" in text


@pytest.mark.slow
def test_several_runs_stand_side_by_side(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And the one that did not converge, whose best iterate is kept, says so before anything else."""
    assert all("NOT CONVERGED" in small_result(1).ship.coefficients[s].verdict for s in FREE)
    folders = [run_folder(tmp_path / name, iterations) for name, iterations in (("first", 100), ("second", 1))]
    monkeypatch.chdir(tmp_path)
    assert main(["report", *map(str, folders), "--no-imo"]) == 0
    text = Path("report.html").read_text()
    Path("kept.html").write_text("precious")
    assert main(["report", str(folders[0]), "--no-imo", "--out", "kept.html"]) == 2
    assert Path("kept.html").read_text() == "precious"
    assert text.index("2 calibrations") < text.index('id="run1"') < text.index('id="run2"')
    head = text[: text.index('id="run1"')]
    assert "NOT CONVERGED" in head
    text = report(folders[1])
    assert 'role="alert"' in text
    where = text.index("NOT CONVERGED")
    assert where < text.index("<table")


def test_a_folder_that_is_no_calibration_or_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Missing):
        report(tmp_path)
    write_json(tmp_path / RESULT, {"kind": "diagnosis"})
    with pytest.raises(BadValue):
        report(tmp_path)
    folder = run_folder(tmp_path / "run")
    with pytest.raises(NotWritable):
        write_report([folder], folder / RESULT / "report.html", imo=False)


@pytest.mark.parametrize(
    ("value", "std", "words"),
    [
        (-0.44137, 0.0484, "−0.441 ± 0.048"),
        (0.5, 0.0996, "0.50 ± 0.10"),
        (1234.5, 67.0, "1234 ± 67"),
        (12345.0, 670.0, "12345 ± 670"),
        (2.3e-9, 1.1e-10, "(2.30 ± 0.11)e−9"),
        (0.1, None, "0.1"),
        (None, 0.1, "–"),
    ],
)
def test_numbers_keep_two_figures_of_their_uncertainty(value: float, std: float, words: str) -> None:
    assert plus_minus(value, std) == words


# The lines on a planned trial
CONTENT: dict[str, Any] = {
    "title": "first",
    "time_s": 180.0,
    "area_m": {"length": 60.0, "width": 25.0, "margin": 0.25},
    "start": {"x_m": 40.0, "y_m": 10.0, "heading_deg": 150.0, "speed_m_s": 0.38, "n_rps": 7.0},
    "orders": [{"t_s": 0.0, "n_rps": 3.5, "delta_deg": -4.0}, {"t_s": 19.0, "n_rps": 10.5, "delta_deg": 35.0}],
    "wanted": {
        "Y_v": {"std_before": 0.07, "std_after": 0.035, "left": 0.5, "unit": "-"},
        "first_overshoot_20": {"std_before": 0.0174533, "std_after": 0.00174533, "left": 0.1, "unit": "rad"},
    },
    "mean_log_variance": -2.0,
    "library": [{"name": "turning:35", "mean_log_variance": -1.0, "stays_inside": False}],
    "best_two_of_the_library": {"library": {"names": ["turning:35", "crash-stop"], "mean_log_variance": -1.5}},
    "assumed": ["calm air"],
}


def test_a_plan_says_what_is_known_better_in_degrees_and_what_the_library_would_bring() -> None:
    lines = [line.split() for line in in_words(CONTENT, "next.csv")]
    assert ["19.0", "10.50", "35"] in lines and ["Y_v", "0.07", "->", "0.035", "(50%)"] in lines
    assert ["first_overshoot_20", "[deg]", "1", "->", "0.1", "(10%)"] in lines
    assert [line[0] for line in lines if "by" in line] == ["-2.00", "-1.00", "-1.50"]


# How a structure was chosen, on the page, from a file that may be damaged
ROW = {"words": "order 1", "unknowns": 20, "training": 0.2, "stable": 0, "sequences": 0, "left_out": ""}
GOOD = {
    "chosen": "b",
    "candidates": [
        {**ROW, "name": "a", "validation": None},
        {**ROW, "name": "b", "validation": 0.1},
        {**ROW, "name": "c", "validation": 0.05, "left_out": "too few samples"},
    ],
    "test": {"as given": 0.4, "chosen": None},
    "stability": {"sequences": 1000, "diverged": 0, "speed": 0.2},
}


def test_the_best_comes_first_and_what_was_not_tried_last_and_a_damaged_file_is_left_out(tmp_path: Path) -> None:
    assert structure_section(tmp_path) is None
    (tmp_path / "selection.json").write_text(json.dumps(GOOD))
    found = structure_section(tmp_path)
    assert found is not None and [row["name"] for row in found["rows"]] == ["b", "a", "c"]
    assert found["test"] == [("as given", 0.4), ("chosen", None)]
    for damaged in ("", "[]", "{", '{"chosen": 3}', json.dumps(GOOD | {"stability": None}), "\x00"):
        (tmp_path / "selection.json").write_text(damaged)
        assert structure_section(tmp_path) is None, damaged


# Run folders of earlier releases, with other names, and with what is gone


def test_a_run_of_an_earlier_release_is_read_with_present_names(tmp_path: Path) -> None:
    """Else the errors of its coefficients would not find the ship's, and its prediction bands would be too narrow."""
    old = {
        "kind": "fit",
        "coefficients": {"velocity_lag.tau": {"std": 0.1}, "Y_v": {"std": 0.2}},
        "correlation": {"symbols": ["Y_v", "velocity_lag.tau"], "matrix": [[1.0, 0.5], [0.5, 1.0]]},
        "settings": {"words": "the velocity_lag. stays"},
    }
    (tmp_path / "result.json").write_text(json.dumps(old), encoding="utf-8")
    found = read_result(tmp_path)
    assert list(found["coefficients"]) == ["velocity_filter.tau", "Y_v"] and found["settings"] == old["settings"]
    assert found["correlation"]["symbols"] == ["Y_v", "velocity_filter.tau"]


def test_a_ship_with_random_forces_is_read_without_them() -> None:
    text = dump_ship(load_ship("esso_osaka_3m").with_effect("tow"))
    ship = parse_ship(text.replace('effects = ["tow"]', 'effects = ["tow", "disturbance"]') + (
        '\n[coefficients."disturbance.X"]\nvalue = 0.3\nfixed = true\nunit = "N"\n'
    ))  # fmt: skip
    assert ship.effects == ("tow",) and has_code(ship.notices, "effect_gone")
    with pytest.raises(UserError, match="disturbance"):
        freeing_effects(ship, ["disturbance"])


# Figures: they show what they claim, at true scale, and leave matplotlib's global state alone
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


# Figures can be read in grey and with deuteranopia: where two colours look alike there, hatches or dashes differ
def test_lines_of_manoeuvres_differ_in_their_dashes() -> None:
    assert len(DASHES) == len(LINES) and len({str(d) for d in DASHES}) == len(DASHES)


@pytest.mark.parametrize(("dashes", "hatch", "alike"), [("-", "", 2), ("--", "////", 0)])
def test_what_only_colours_tell_apart_is_found(dashes: str, hatch: str, alike: int) -> None:
    figure = Figure()
    ax = figure.subplots()
    ax.plot([0, 1], color="#C00000", label="one")
    ax.plot([0, 1], color="#006000", ls=dashes, label="other")
    ax.bar([0, 1], [1, 1], color=["#C00000", "#006000"], hatch=["", hatch])
    assert len(told_by_colour_alone(figure)) == alike
