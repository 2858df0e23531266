"""The report on a diagnosis says what the diagnosis says, for each verdict, and stands alone."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.findings import (
    TESTS,
    Budget,
    BudgetShare,
    DiagnosisInputs,
    EstimatedParameter,
    HeldOut,
    InstrumentFault,
    NamedEffect,
    RandomSizes,
    RankedCandidate,
    UnexplainedChannel,
    UnexplainedForce,
    UnexplainedTime,
)
from diagnosis.location.where import where
from diagnosis.report.page import build_report, figures_for, held_rows, write_report
from diagnosis.report.words import (
    BADGE,
    first_channel,
    force,
    held_words,
    next_words,
    percent,
    probability,
    quantity,
    ranking,
    readable,
    sentence_of,
    visible,
    where_words,
)
from diagnosis.result import Diagnosis
from tests.diagnosis.location.test_where import INPUTS, SHIP, coloured, fitted, weaving
from tests.support.colours import told_by_colour_alone
from tests.support.quick import first_quick

CURRENT = {"x": EstimatedParameter(0.03, 0.002, "m/s"), "y": EstimatedParameter(-0.04, 0.002, "m/s")}
DRIFT = {"x": EstimatedParameter(0.7, 0.1, "N"), "y": EstimatedParameter(-0.9, 0.1, "N")}


def case(verdict: str) -> Diagnosis:
    """A diagnosis made by hand: a sway force that follows the heading, half explained."""
    data, z = weaving()
    force = coloured(7, 0.2)
    force[..., 1] += 2.0 * np.sin(z[..., 2])
    null, final = fitted(z, force), fitted(z, 0.1 * force)
    named = verdict == "named"
    candidates = (
        RankedCandidate("current", 300.0, 1e-12, 280.0, True, 0.3, CURRENT),
        RankedCandidate("wave_drift", 290.0, 2e-11, 277.0, True, 0.2, DRIFT, {"x": 0.31, "y": 0.42}),
        RankedCandidate("rudder_offset", 5.0, 0.4, None, True, 0.95, {}, {"delta": 0.01}),
        RankedCandidate("propeller_side_force", 0.0, 1.0, None, False, 0.0),
    )
    runs = {"test <1>": (0.5, 0.2), "test 2": (0.3, 0.35)}
    after = 0.2 if named else 0.4
    held = HeldOut(0.4, after, 1 - after / 0.4, (0.3, 0.6) if named else (0.0, 0.0), 12, runs)
    return Diagnosis(
        verdict=verdict,
        sentence=f"In one sentence: {verdict}, wave_drift or not, by -90%.",
        instruments=(),
        effects=(NamedEffect("current", CURRENT, 1e-12, 280.0, 0.3),) if named else (),
        equivalence_class=("wave_drift",) if named else (),
        remainder=named,
        candidates=candidates,
        where=where(INPUTS, data, null, SHIP, final if named else None),
        held_out=replace(held, horizons={"30 s": (0.4, after), "whole run": (9.0, 4.0)}),
        next_test="Stop and drift." if named else "",
        warnings=("beware of the <tide>.",),
        not_screened={"bank": "no bank line is known (site.toml)"},
        ship=SHIP,
        before=SHIP,
        null=null,
        final=final if named else null,
        data=replace(data, trials=("run <0>", *data.trials[1:])),
        noise=RandomSizes.of(null),
        inputs=DiagnosisInputs(tuple({"name": name} for name in ("run <0>", *data.trials[1:]))),
        unnamed={"all": 20.0 if verdict != "none" else -1.0, "sway force": 15.0, "delay of delta": -2.0},
        kinematics=("u and v are late by 0.7 s",),
        timings={"fit": 1.5},
        unexplained_force=unexplained(force) if verdict != "none" else None,
    )


def unexplained(force: np.ndarray) -> UnexplainedForce:
    """An unexplained sway force that follows the heading."""
    quiet, loud = (
        UnexplainedChannel(size, (0.8 * size, 1.2 * size), 0.0, "N", share) for size, share in ((0.0, 0.0), (1.4, 1.0))
    )
    follows = {"variable": "heading", "unit": "rad", "channel": "sway", "force_unit": "N", "explained": 0.6}
    follows |= {"at": [0.1, 1.5], "mean": [-1.0, 2.0]}
    times = (UnexplainedTime("run <0>", 10.0, 30.0, "sway", 1.4, 1.1, "N"),)
    advice = "To know more of it: turning:35, in which it would show most."
    channels = {"surge": quiet, "sway": loud, "yaw": quiet}
    return UnexplainedForce(channels, (follows,), times, advice, 9.0, force[:-1], 0.1 + 0.0 * force[:-1])


def text_of(html: str) -> str:
    """The page without tags and images."""
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", re.sub(r"<style>.*?</style>", "", html, flags=re.S)))


@pytest.mark.slow
@pytest.mark.parametrize("verdict", first_quick(["named", "none", "unknown"]))
def test_page_stands_alone(tmp_path: Path, verdict: str) -> None:
    listed = write_report(case(verdict), tmp_path).rows
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert all((tmp_path / row["file"]).read_bytes().startswith(b"\x89PNG") for row in listed)
    assert html.count("data:image/png;base64,") == len(listed) == {"named": 3, "unknown": 3, "none": 2}[verdict]
    assert not re.search(r'(src|href)="(?!data:|#)', html)
    text = text_of(html)
    assert "run <0>" not in html and "&lt;tide&gt;" in html and "run &lt;0&gt;" in html
    assert not re.search(r"\bnan\b|\bNone\b(?! of)|\binf\b|wave_drift", text)
    head = text.index(f"In one sentence: {verdict}, wave drift or not, by −90%.")
    assert head < text.index("How far it shrinks") < text.index("Which effect ")
    assert "u and v are late by 0.7 s" in text and "no bank line is known" in text


def test_where_is_told_as_it_is() -> None:
    d = case("named")
    assert first_channel(d) == "sway"
    words = " ".join(where_words(d))
    strongest = re.search(r"heading (\d+)°: (\S+) N (to \w+)", words)
    assert strongest is not None
    east = np.sin(np.radians(float(strongest.group(1))))
    assert abs(east) > 0.6 and float(strongest.group(2)) == pytest.approx(2 * abs(east), rel=0.25)
    assert strongest.group(3) == ("to starboard" if east > 0 else "to port")
    random = replace(d, where=where(INPUTS, d.data, fitted(d.null.path.z, coloured(9)), SHIP))
    assert "heading" not in " ".join(where_words(random))


def test_a_worse_test_trial_is_marked_and_no_test_trials_are_said() -> None:
    d = case("named")
    assert [row["worse"] for row in held_rows(d)] == [False, True, False]
    assert held_rows(d)[0]["change"] == "−60 %"
    assert "--test" in text_of(build_report(replace(d, held_out=None), Path("nowhere"), []))


@pytest.mark.parametrize(
    ("share", "words"), [(0.994, "99 %"), (0.9958, "99.6 %"), (0.99961, "99.96 %"), (1.0, "100 %")]
)
def test_an_error_that_is_nearly_gone_is_not_all_gone(share: float, words: str) -> None:
    assert percent(share).replace("\u00a0", " ") == words


def part(name: str, share: float, low: float, high: float) -> BudgetShare:
    return BudgetShare(name, share, (low, high))


@pytest.mark.parametrize(
    ("own", "rest", "remainder", "first", "said"),
    [
        (part("current", 0.98, 0.96, 0.99), part("unexplained", 0.02, 0.01, 0.04), False, "current", "matters"),
        (part("current", 0.17, 0.1, 0.3), part("unexplained", 0.83, 0.7, 0.9), True, "Most", "83"),
        (part("current", 1.0, 0.6, 1.0), part("unexplained", -0.0, 0.0, 0.38), True, "current", "38"),
    ],
)
def test_the_sentence_follows_from_the_budget(
    own: BudgetShare, rest: BudgetShare, remainder: bool, first: str, said: str
) -> None:
    """A name that surely causes less than half heads no sentence."""
    units = {"position_m": (3.2, 0.1, 0.1), "heading_deg": (9.0, 1.0, 1.0)}
    budget = Budget("30 s", TESTS, 1.0, 0.1, 0.1, (own,), rest, units)
    effect = NamedEffect("current", CURRENT, 1e-12, 280.0, 0.3)
    words = sentence_of("named", [effect], [], (), remainder, budget)
    assert words.split()[0] == first and said in words and "−" not in words
    unplaced = replace(budget, units=units | {"position_m": (0.0, 0.0, 0.0)})
    assert "3.2" in words and " m." not in sentence_of("named", [effect], [], (), remainder, unplaced)
    turned = replace(budget, units={"position_m": (0.35, 0.37, 0.37), "heading_deg": (7.2, 6.3, 6.3)})
    words = sentence_of("named", [effect], [], (), remainder, turned)  # what does not fall is no proof of the cause
    assert "7.2" in words and "0.35" not in words


def test_what_does_not_matter_stands_behind_what_does() -> None:
    """An effect below 5 % is listed alone; something unknown that cannot be half of the error heads no sentence."""
    units = {"position_m": (3.2, 0.1, 0.1), "heading_deg": (9.0, 1.0, 1.0)}
    parts = (part("current", 0.98, 0.96, 0.99), part("draft", 0.0, 0.0, 0.01))
    budget = Budget("30 s", TESTS, 1.0, 0.1, 0.1, parts, part("unexplained", 0.0, 0.0, 0.08), units)
    effects = [NamedEffect(name, CURRENT, 1e-12, 280.0, 0.3) for name in ("current", "draft")]
    words = sentence_of("named", effects, [], (), False, budget)
    assert words.count("causes") == 1 and words.index("98 %") < words.index("draft")
    unknown = sentence_of("unknown", effects[:1], [], (), True, budget)
    assert unknown.split()[0] == "current" and "8 %" in unknown
    large = replace(budget, unexplained=part("unexplained", 0.6, 0.3, 0.8))
    assert sentence_of("unknown", effects[:1], [], (), True, large).split()[0] != "current"


def test_named_effect_and_its_class_are_told() -> None:
    d = case("named")
    text = text_of(build_report(d, Path("nowhere"), []))
    assert BADGE["named"] in text
    assert "0.0300 ± 0.0020 m/s" in text
    assert d.next_test in text and "−50 % error" in text and "30 % to 60 %" in text
    rows = ranking(d)
    assert [row["role"] for row in rows] == ["named", "class", "", ""]
    assert "current" in rows[1]["note"] and rows[3]["p"] == rows[3]["absorbed"] == "–" and rows[0]["bic"] == "+280"
    assert [row["visible"] for row in rows] == ["–", "x 0.31 N, y 0.42 N", "delta 0.57 deg", "–"]
    assert visible(replace(d.candidates[2], visible_from={"delta": 3.0}), d) == "–"  # hopeless


@pytest.mark.parametrize("verdict", ["none", "unknown"])
def test_verdicts_without_a_name_name_nothing(verdict: str) -> None:
    d = case(verdict)
    text = text_of(build_report(d, Path("nowhere"), []))
    assert BADGE[verdict] in text and held_words(d.held_out, verdict) in text and "% error" not in text
    assert "named" not in [row["role"] for row in ranking(d)]
    assert ("10 to 30 s" in text) == ("turning:35" in next_words(d)) == (verdict == "unknown")
    bare = replace(d, where={}, kinematics=(), not_screened={}, warnings=(), unexplained_force=None)
    assert 'id="sensors"' in build_report(bare, Path("nowhere"), [])


def test_numbers_are_rounded_by_what_is_known_of_them_and_forces_have_words() -> None:
    assert [probability(p) for p in (0.034, 2.34e-7, np.nan)] == ["0.034", "2.3e-07", "–"]
    assert [force(x, "N m") for x in (0.0, 1.44e-5, 0.52, 247.0, 15230.0)] == [
        "0 N m", "14 µN m", "0.52 N m", "250 N m", "15 kN m",
    ]  # fmt: skip
    assert quantity(EstimatedParameter(np.radians(2.0), np.radians(0.1), "rad")) == "2.00 ± 0.10 deg"
    assert readable("by -3 (mmg simulate SHIP --n -7.7)") == "by −3 (mmg simulate SHIP --n -7.7)"


def test_an_instrument_heads_the_sentence_as_none_of_the_ship() -> None:
    fault = InstrumentFault("log_scale", {"share": EstimatedParameter(0.05, 0.001, "")}, 1e-9)
    words = sentence_of("none", [], [fault], (), False, None)
    assert words.startswith(fault.name) and "instrument" in words


@pytest.mark.slow
@pytest.mark.parametrize("verdict", ["named", "unknown", "none"])
def test_nothing_in_a_figure_is_told_by_its_colour_alone(verdict: str) -> None:
    found = case(verdict)
    looks = {name: told_by_colour_alone(draw(found)) for name, draw, *_ in figures_for(found)}
    assert looks == {name: [] for name in looks} and {"where_on_track", "where_in_state"} <= set(looks)
