"""Conditions of trials, limits of use, the form for IMO and the cards aboard say what is known, and what is not."""

from __future__ import annotations

import base64
import html
import io
import math
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imsave

import mmg_ident as mi
from cases.criteria import imo
from cases.criteria.imo import imo_figures
from cases.maneuvers.self_propulsion import speed_for
from cases.quantities import KNOT
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from fitting.identifiability.analysis import KINDS
from fitting.prediction.envelope import trial_envelope
from fitting.prediction.figure_intervals import JudgedFigures
from fitting.report import imo_form as imo_form_module
from fitting.report.imo_form import drawn_maneuvers, imo_form, likely_causes, standard_figures
from fitting.report.page import build_page, needs_weasyprint, write_pdf
from fitting.report.ship_card import ABOARD, SHARES, Figure
from fitting.report.use import (
    FAILED,
    FULFILLED,
    LATER,
    UNKNOWN,
    Delivered,
    beaufort,
    condition_rows,
    first_screen,
    limit_rows,
    use_rows,
)
from fitting.result import read_fit, write_report
from mmg.errors import UserError
from mmg.messages import has_code
from mmg.rollout import Simulator
from mmg_ident.api import simulate
from mmg_ident.commands.main import main
from tests.support.calibrated import small_result
from tests.support.commands import refusal, shown

pytestmark = pytest.mark.usefixtures("blank_figures")
SHIP = load_ship("kvlcc2_full")
TURNS = ("turning:35", "turning:-35")


def straight(name: str, seconds: int = 20, **columns: float) -> Trial:
    """A run straight ahead with constant columns."""
    given = {"x": 0.0, "y": 0.0, "psi": 0.0, "u": 7.0, "v": 0.0, "r": 0.0, "n": 1.5, "delta": 0.0} | columns
    t = np.arange(seconds + 1.0)
    return Trial(name, {"t": t, **{key: np.full(len(t), value) for key, value in given.items()}})


def verdicts(trials: list[Trial], full_load: float | None = None) -> dict[str, str]:
    return {c.name: c.verdict for c in condition_rows(SHIP, trials, full_load)}


@pytest.mark.parametrize(("speed", "number"), [(0.0, 0), (1.0, 1), (9.35, 5), (11.0, 6), (40.0, 12)])
def test_beaufort_numbers_are_those_of_the_scale(speed: float, number: int) -> None:
    assert beaufort(speed) == number


def test_conditions_are_judged_where_they_are_known_and_unknown_where_not(tmp_path: Path) -> None:
    calm, storm = (straight(name, wind_speed=w, wind_direction=0.0) for name, w in (("calm", 5.0), ("storm", 15.0)))
    assert verdicts([calm])["wind"] == FULFILLED
    assert verdicts([calm, storm])["wind"] == FAILED
    assert verdicts([calm, straight("silent")])["wind"] == UNKNOWN
    assert set(verdicts([straight("silent")]).values()) == {UNKNOWN}
    draught = SHIP.particulars["d"]
    assert verdicts([calm], 1.04 * draught)["loading"] == FULFILLED
    assert verdicts([calm], 1.2 * draught)["loading"] == FAILED
    write_trial(calm, tmp_path / "calm.csv")
    there = replace(calm, path=tmp_path / "calm.csv")
    for depth, verdict in ((5 * draught, FULFILLED), (2 * draught, FAILED)):
        (tmp_path / "site.toml").write_text(f"[water]\ndepth = {depth:.6g}\n")
        assert verdicts([there])["water depth"] == verdict


def test_limits_are_shown_in_the_units_of_the_bridge() -> None:
    ranges = trial_envelope(SHIP, [straight("a", v=1.0, r=0.02, delta=0.3), straight("b", u=5.0, v=-1.0, n=1.0)])
    rows = {row["name"]: row for row in limit_rows(ranges, 320.0)}
    assert rows["delta"]["unit"] == "deg" and rows["delta"]["high"] == pytest.approx(np.degrees(0.3))
    assert rows["r"]["unit"] == "deg/s" and rows["u"]["low"] == 5.0 and rows["n"]["unit"] == "1/s"
    assert "0.91" in rows["r"]["more"]  # 0.02 320 / 7
    beta = rows["beta"]  # 1 m/s to starboard at 7 m/s ahead, where the water comes from starboard, and to port at 5 m/s
    assert (beta["low"], beta["high"]) == pytest.approx(np.degrees([-np.arctan(1 / 7), np.arctan(1 / 5)]))
    assert "from port" in beta["words"]


def test_the_advice_follows_from_what_the_trials_held() -> None:
    limits = ("reversed propeller", "going astern", "n hardly changed", "hard-over", "cross flow", "shallow water")
    wide = [straight("a", u=-1.0, v=3.0, n=-1.0, delta=0.65), straight("b")]
    for trials, said in (([straight("a", v=0.2, delta=0.2)], [*limits]), (wide, ["shallow water"])):
        good, bad = use_rows(trial_envelope(SHIP, trials), SHIP)
        assert good and [words for words in limits if any(words in line for line in bad)] == said
    names = ("delta", "delta_port", "delta_starboard")  # sentences on rudders in one order, whatever the process
    _, twin = use_rows({name: [-0.1, 0.1] for name in reversed(names)}, SHIP)
    assert [line.split()[2] for line in twin if line.startswith("hard-over")] == list(names)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder of the small calibration with its page."""
    folder = tmp_path_factory.mktemp("use") / "run"
    replace(small_result(), objects=None).save(folder)
    return folder


@pytest.fixture(scope="module")
def known() -> Delivered:
    """The form of a ship whose trials are her own standard manoeuvres."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(imo_form_module, "DRAWS", 40)
        patched.setattr(imo, "STANDARD", TURNS)
        fit = small_result()
        trials = tuple(simulate(fit.ship, text) for text in TURNS)
        model = standard_figures(fit.to_dict(), fit.ship)
        form = imo_form(fit.ship, trials, model, fit.to_dict(), 1.1 * fit.ship.particulars["d"])
        drawn = drawn_maneuvers(model)
        return Delivered(trials, (), form, "", 1.1 * fit.ship.particulars["d"], drawn)


def first_figure(known: Delivered) -> tuple[Any, ...]:
    """The form, the first side of its first figure, what was tested there and the ends of the model's single trials."""
    form: Any = known.form
    side = form.rows[0].sides[0]
    return form, side, side.tested, side.model.of_trial


@pytest.mark.slow
def test_the_form_has_port_and_starboard_tested_model_and_corrected(known: Any) -> None:
    form = known.form
    assert form.tested and form.corrected and form.intervals and known.figure
    rows = {(row.group.split(",")[0], row.name): row for row in form.rows}
    assert len(form.rows) == 7 and [len(row.sides) for row in form.rows] == [2] * 6 + [1]
    for side in rows["Turning circle", "Advance"].sides:
        low, high = side.model.interval
        assert low < side.model.value < high and side.model.interval != side.corrected.interval
        assert side.tested.value == pytest.approx(side.model.value, rel=0.1)
        assert side.corrected.value != pytest.approx(side.tested.value, rel=1e-4)
    assert any("R = T F / B" in line for line in form.remarks)
    zigzag = rows["Zig-zag 20°/20°", "1st overshoot angle"]
    assert all(side.tested is None and side.corrected is None for side in zigzag.sides)


@pytest.mark.slow
def test_tested_figures_outside_of_the_models_intervals_are_the_first_line(
    known: Delivered, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(imo, "STANDARD", TURNS)
    form, side, tested, ends = first_figure(known)
    assert form.contradiction == "" and side.contradicts is False
    end, reading = ends[1], tested.reading
    readable, outside = (replace(side, tested=replace(tested, value=end + share * reading)) for share in (0.9, 1.1))
    assert reading > 0 and outside.contradicts and readable.contradicts is False
    assert replace(outside, tested=None).contradicts is None and replace(outside, is_other=True).contradicts is None
    wrong = replace(form, rows=(replace(form.rows[0], sides=(outside,)), *form.rows[1:]))
    assert " 1 of 3 " in wrong.contradiction
    fit = small_result()
    page = build_page([(fit, fit.ship, tmp_path)], [replace(known, form=wrong)])
    assert page.index(" 1 of 3 ") < page.index('class="headline"')
    stated = {k: v for k, v in fit.ship.particulars.items() if k != "rudder_rate"}
    by_rule, known_rate = (
        likely_causes(replace(fit.ship, particulars=own), known.trials, JudgedFigures.of(imo.imo_figures(fit.ship)), {})
        for own in (stated, {**stated, "rudder_rate": 0.3})
    )
    assert len(known_rate) == len(by_rule) - 1


@pytest.mark.slow
def test_the_first_screen_compares_tested_and_model_figures_and_says_what_hangs_on_a_rule(known: Delivered) -> None:
    fit, (form, side, tested, ends) = small_result(), first_figure(known)
    given = fit.to_dict(), fit.ship
    screen = first_screen(*given, known, ["turns: to 35 deg"], ["waves: none"])
    assert (screen.good, screen.bad, screen.doubtful, screen.causes) == (("turns",), ("waves",), False, ())
    assert len(screen.rows) == 7 and {len(row) for row in screen.rows} == {5}
    assert screen.rows[0][1] == f"{tested.value:.2f} ±{tested.reading:.2f}"
    assert screen.rows[0][3] == f"{side.model.value:.2f} [{ends[0]:.2f}, {ends[1]:.2f}]"
    far, untested = replace(side, tested=replace(tested, value=2 * tested.value)), replace(side, tested=None)
    wrong, alone = (replace(form, rows=(replace(form.rows[0], sides=(one,)),)) for one in (far, untested))
    wrong = replace(wrong, causes=("a",), rules={"rate by rule": ("Turn,",)})
    screen = first_screen(*given, replace(known, form=wrong), [], [])
    assert screen.doubtful and screen.causes == ("a",) and screen.rows[0][1].endswith("(!)")
    assert len(screen.rules) == 1 and screen.rules[0].startswith("rate by rule")
    other = replace(wrong, rows=(replace(form.rows[0], sides=(replace(far, is_other=True),)),))
    screen = first_screen(*given, replace(known, form=other), [], [])
    assert not screen.doubtful and screen.rows[0][1].endswith("(*)")
    # what does not converge, or is worse than nothing, is not right, nor is an interval that holds everything
    right = first_screen(*given, known, [], [])
    worse = [{"code": "worse_than_persistence", "text": "worse than nothing", "level": "warning"}]
    failed, doubted = ({**given[0], "converged": False}, {**given[0], "messages": worse})
    vague = replace(side, model=replace(side.model, of_trial=(0.0, 3 * tested.value)))
    assert vague.is_vague and not side.is_vague and vague.contradicts is False
    said = [first_screen(one, given[1], known, [], []) for one in (failed, doubted)]
    rows = tuple(replace(row, sides=(vague,)) for row in form.rows[:1])
    said.append(first_screen(*given, replace(known, form=replace(form, rows=rows)), [], []))
    assert len({right.verdict, *(one.verdict for one in said)}) == 4
    assert [one.doubtful for one in (right, *said)] == [False, True, True, False]
    screen = first_screen(*given, replace(known, form=alone), [], [])
    assert len(screen.groups) == 1 and [row[1:2] for row in screen.by_side[1]] == [("",)]


def test_without_a_form_the_first_screen_has_the_measured_runs_and_the_errors_in_units() -> None:
    fit = small_result()
    result = fit.to_dict()
    runs = [{"name": "turn", "windows": 2, "maneuvers": [{"title": "turning 20", "figures": [
        {"figure": "advance", "unit": "m", "measured": 10.0, "predicted": None}]}]}]  # fmt: skip
    pooled = {"position_end_m": 0.5 * fit.ship.particulars["L"], "heading_end_deg": 3.0}
    units = {"units": {"runs": runs, "pooled": pooled, "window_s": 40.0}}
    held_out = first_screen({**result, "scores": {"validation": {"after": units}}}, fit.ship, Delivered(), [], [])
    assert held_out.rows == (("turn", "turning 20: advance [m]", "10", ""),) and LATER in held_out.note
    assert "1 held-out trial " in held_out.errors and "(0.5 L)" in held_out.errors and "40 s" in held_out.errors
    nothing = first_screen({**result, "scores": {}}, fit.ship, Delivered(), [], [])
    assert nothing.errors == "" and nothing.rows == () and nothing.verdict != held_out.verdict


def test_coefficients_at_their_prior_are_one_line_until_it_is_opened(tmp_path: Path) -> None:
    fit = small_result()
    findings = fit.identifiability["coefficients"]
    symbols = list(findings)
    known = zip(symbols, ("silent", "prior", *["determined"] * len(symbols)), strict=False)
    kinds = {symbol: {**findings[symbol], "kind": kind} for symbol, kind in known}
    still = replace(fit, identifiability={**fit.identifiability, "coefficients": kinds})
    page = build_page([(still, fit.ship, tmp_path)])
    line = page.index("2 coefficients ")
    assert f"{symbols[0]}, {symbols[1]}</summary>" in page[line:]
    for number, symbol in enumerate(symbols):
        assert (page.index(f'id="run1-{symbol}"') > line) == (number < 2)


def test_a_tested_stop_is_judged_where_that_of_the_model_is_the_priors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imo_form_module, "DRAWS", 20)
    monkeypatch.setattr(imo, "STANDARD", ("crash-stop",))
    fit = small_result()
    ship = replace(fit.ship, particulars={**fit.ship.particulars, "scale": 108.33})
    result = fit.to_dict() | {"envelope": fit.envelope | {"n": [0.0, 30.0]}}
    model = standard_figures(result, ship)
    for trials, verdict in (((), "not judged"), ((simulate(fit.ship, "crash-stop"),), "pass")):
        form = imo_form(ship, trials, model, result)
        (side,) = form.rows[-1].sides
        assert side.verdict.split(",")[0] == verdict and bool(side.tested) == bool(trials)
        low, high = side.model.interval
        assert low < side.model.value < high
        assert any(model.basis in line for line in form.remarks) and "crash-stop" in model.basis


@pytest.mark.slow
def test_what_cannot_be_corrected_or_has_no_covariance_is_said() -> None:
    fit = small_result()
    model = standard_figures({**fit.to_dict(), "correlation": None}, fit.ship)
    assert not model.scatter and drawn_maneuvers(model) is None
    form = imo_form(fit.ship, (), model)
    assert next(row for row in form.rows if row.group.startswith("Zig-zag 20")).limit == 25.0
    assert not form.tested and not form.corrected and not form.intervals
    words = " ".join(form.remarks)
    assert "--full-load-draught" in words
    with pytest.raises(UserError, match=r"0\.4 to 2\.5"):
        imo_form(fit.ship, (), model, full_load=9.0)


@pytest.mark.slow
def test_the_page_has_the_form_the_limits_and_the_advice(
    known: Delivered, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit = small_result()
    form = build_page([(fit, fit.ship, tmp_path)], [known])
    for words in ("tested", "model, calm and deep [90 %]", "corrected to full load [90 %]", "Stopping"):
        assert words in form
    model = first_figure(known)[1].model
    assert f"{model.value:.2f} [{model.interval[0]:.2f}, " in form
    assert set(fit.envelope) >= {"u", "v", "r", "n", "delta", "beta"}
    text = (run / "report.html").read_text()
    for heading in ("11. Trial conditions", "12. Manoeuvring data for IMO", "13. Limits of use", "14. How to use"):
        assert heading in text
    assert read_fit(run).envelope == fit.envelope
    monkeypatch.setattr(imo_form_module, "DRAWS", 20)
    monkeypatch.setattr(imo, "STANDARD", TURNS)
    text = write_report([run], run / "page.html")
    assert "appendix 6" in text and "[90" in text and "starboard" in text


def test_the_counts_of_the_page_are_those_of_the_console_and_no_column_is_empty(run: Path) -> None:
    text = (run / "report.html").read_text()
    words = " ".join(text[text.index("free coefficients: ") : text.index("Shift: estimate")].split())
    counts = small_result().identifiability["counts"]
    assert words == "free coefficients: " + ", ".join(f"{n} {KINDS[kind]}" for kind, n in counts.items() if n) + "."
    assert not re.findall(r"<th[^>]*></th>", text)
    for table in re.findall(r"(?s)<table.*?</table>", text):
        rows = [re.findall(r"(?s)<td[^>]*>(.*?)</td>", row) for row in re.findall(r"(?s)<tr.*?</tr>", table)]
        for column in zip(*[row for row in rows if len(row) == max(map(len, rows)) > 1], strict=True):
            assert any(re.sub(r"<.*?>", "", cell).strip() for cell in column), (table[:300], column)


@pytest.mark.slow
def test_the_pdf_holds_every_heading_and_the_pictures_of_its_page_and_no_others(run: Path, tmp_path: Path) -> None:
    try:
        needs_weasyprint()
    except UserError as error:
        pytest.skip(str(error))
    pypdf = pytest.importorskip("pypdf")
    assert main(["report", str(run), "--pdf", "--no-imo"]) == 0
    text = (run / "report.html").read_text()
    pages = pypdf.PdfReader(run / "report.pdf").pages
    words = " ".join(" ".join(page.extract_text() for page in pages).split())
    headings = [" ".join(re.sub(r"<.*?>", "", h).split()) for h in re.findall(r"(?s)<h[123][^>]*>(.*?)</h[123]>", text)]
    assert len(headings) > 15
    assert [h for h in map(html.unescape, headings) if h.replace(" ", "") not in words.replace(" ", "")] == []
    with pytest.raises(UserError):
        write_pdf("<p>x</p>", run / "nowhere" / "x.pdf")
    picture = io.BytesIO()
    imsave(picture, np.zeros((2, 3, 3)), format="png")
    (tmp_path / "other.png").write_bytes(picture.getvalue())
    inside = f"data:image/png;base64,{base64.b64encode(picture.getvalue()).decode()}"
    for source, count in ((inside, 1), ((tmp_path / "other.png").as_uri(), 0)):
        write_pdf(f'<p>x</p><img src="{source}" width="30">', tmp_path / "page.pdf")
        assert sum(len(page.images) for page in pypdf.PdfReader(tmp_path / "page.pdf").pages) == count


def test_without_weasyprint_one_line_says_what_to_do_and_nothing_is_written(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    out = run / "without.html"
    assert main(["report", str(run), "--pdf", "--no-imo", "--out", str(out)]) == 2
    assert "mmg-ident[pdf]" in capsys.readouterr().err
    assert not out.exists() and not out.with_suffix(".pdf").exists()


# Pilot card, poster and booklet: figures as elsewhere, with intervals, and empty lines for what is unknown
FREE = ("N_v", "N_r", "X_0F")
"""Coefficients of the 3 m ship that are drawn."""


def test_figures_are_those_of_the_criteria_and_speeds_those_of_the_surge_balance() -> None:
    ship = load_ship("kvlcc2_full")
    card, figures = mi.card(ship, scatter=0), imo_figures(ship)
    runs = {run.name: run.figures for run in figures.runs}
    for name in ("turning:35", "turning:-35"):
        for figure in ("advance", "transfer", "tactical_diameter", "time_90", "time_180"):
            assert card.tables["turning"][name][figure].value == pytest.approx(runs[name][figure], rel=1e-12)
    full, coasted = (card.tables["stopping"][text]["track_reach"].value for text in ("crash-stop", "coasting"))
    assert coasted > full == pytest.approx(runs["crash-stop"]["track_reach"], rel=1e-12)
    for share, n, speed in card.engine:
        assert speed.value == pytest.approx(speed_for(ship, n), rel=1e-6) and speed.interval is None
        assert speed.value == pytest.approx(share * card.speed, rel=0.02)  # resistance goes with the square
    assert [share for share, *_ in card.engine] == list(SHARES) and has_code(card.notices, "no_covariance")


def test_draws_give_every_figure_an_interval_that_holds_it() -> None:
    ship = load_ship("esso_osaka_3m")
    wide = {s: ship.coefficients[s].with_(std=0.1 * abs(ship.coefficients[s].value)) for s in FREE}
    others = {s: c.with_(std=0.0) for s, c in ship.coefficients.items() if s not in FREE}
    drawn = mi.card(ship.with_coefficients({**others, **wide}), scatter=60)
    figures = [f for columns in drawn.tables.values() for one in columns.values() for f in one.values()]
    for figure in [*figures, *(speed for *_, speed in drawn.engine)]:
        assert figure.interval is not None and figure.interval[0] <= figure.value <= figure.interval[1]
    # of the speed alone X_0F matters: R ~ X_0F u^2 against a thrust that falls with u
    low, high = drawn.engine[0][2].interval or (0.0, 0.0)
    assert 0.02 < (high - low) / drawn.speed < 0.2
    assert Simulator(drawn.ship).ship.symbols == ship.symbols


def test_a_ship_without_shaft_or_rudder_shows_what_she_can_do() -> None:
    card = mi.card(load_ship("mariner"))
    assert card.engine == () and has_code(card.notices, "event_not_reached")  # no propeller in her model: no stop
    assert card.tables.keys() == {"turning", "course"} and card.page()
    assert "--scatter 3" in refusal("card", "mariner", "--scatter", "3")


@pytest.mark.parametrize(
    ("figure", "kind", "length", "words"),
    [
        (Figure(1021.4, (980.2, math.inf)), "way", 320.0, "1,021 m [980, never]; 3.19 L"),
        (Figure(-1e-9), "way", 3.0, "0.00 m; 0.00 L"),
        (Figure(math.radians(7.25)), "deg", 3.0, "7.3°"),
        (Figure(10 * KNOT, (9 * KNOT, 11 * KNOT)), "speed", 320.0, "10.0 kn [9.0, 11.0]"),
        (Figure(0.5), "speed", 3.0, "0.500 m/s"),
    ],
)
def test_figures_are_shown_in_the_units_of_a_bridge(figure: Figure, kind: str, length: float, words: str) -> None:
    assert figure.words(kind, length) == words


def test_the_command_writes_a_page_that_needs_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    content = shown("card", "mariner")
    assert content["files"] == ["card.html"] and content["tables"].keys() == {"turning", "course"}
    page = Path("card.html").read_text(encoding="utf-8")
    assert not re.search(r"(?:src|href)=\"(?!data:|#)", page) and "Draught increase" in page
    for lines in ABOARD.values():
        assert all(line in page for line in lines)
    assert "card.html" in refusal("card", "mariner")  # somebody's file stays
    assert main(["card", "mariner", "--force"]) == 0
    slow, fast = (mi.card("esso_osaka_3m", speed=0.3, scatter=0, rudder_rate=rate) for rate in (None, 10.0))
    assert slow.speed == 0.3 and slow.helm != fast.helm and "7 s" in fast.helm[1][1]
