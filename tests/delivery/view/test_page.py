"""The page holds what the runs found, in the numbers of the predictions, and its policy allows nothing else."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from cases.io.read import read_trials
from delivery.view.page import (
    LENGTHS,
    Campaign,
    ViewModel,
    ViewTrial,
    gather,
    packed,
    packed_times,
    rows_per_run,
    safe_json,
    same_ship,
    shown_rows,
    view_page,
    write_view,
)
from fitting.prediction.bands import bands_of
from fitting.prediction.predict import forces_along, predict
from fitting.result import read_fit
from mmg.errors import BadValue, Conflict, Missing, NotWritable
from mmg.model import NETWORK
from mmg.rollout import Simulator
from tests.support.hybrids import lacking, ship, trials
from tests.support.view_runs import campaign, unpacked, with_diagnosis

pytestmark = pytest.mark.usefixtures("blank_figures")


class Parsed(HTMLParser):
    """elements: of a page, each with its tag, attributes and text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None], list[str]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.elements.append((tag, dict(attrs), []))

    def handle_endtag(self, tag: str) -> None:
        self.elements.append(("", {}, []))

    def handle_data(self, data: str) -> None:
        if self.elements:
            self.elements[-1][2].append(data)

    def of(self, tag: str) -> list[tuple[dict[str, str | None], str]]:
        return [(attributes, "".join(texts)) for name, attributes, texts in self.elements if name == tag]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return campaign(tmp_path_factory.mktemp("view"))


@pytest.fixture(scope="module")
def text(run: Path) -> str:
    return view_page(gather([run]))


def content(text: str) -> tuple[dict, list[dict]]:
    """The header and the runs in a page."""
    scripts = {a.get("id"): t for a, t in Parsed(text).of("script") if a.get("type") == "application/json"}
    header = json.loads(scripts["view-data"])
    return header, [json.loads(scripts[f"run-{i}"]) for i in range(len(header["runs"]))]


def test_the_page_says_which_calibration_it_is_and_not_the_ship_that_it_began_from(run: Path, text: str) -> None:
    mark = gather([run]).ship.mark
    assert mark is not None and mark.name == "run"
    assert f"<h1>{mark.words}" in text and content(text)[0]["ship"] == mark.words


def test_the_policy_names_each_script_and_style_and_allows_nothing_else(text: str) -> None:
    page = Parsed(text)
    (policy,) = [a["content"] for a, _ in page.of("meta") if a.get("http-equiv") == "Content-Security-Policy"]
    assert policy is not None
    rules = {part.split()[0]: part.split()[1:] for part in policy.split("; ")}
    assert rules["default-src"] == rules["base-uri"] == rules["form-action"] == ["'none'"]
    assert not {"img-src", "connect-src", "font-src"} & set(rules) and "unsafe" not in policy
    for tag, rule in (("script", "script-src"), ("style", "style-src")):
        own = [t for a, t in page.of(tag) if a.get("type") != "application/json"]
        hashes = ["'sha256-" + base64.b64encode(hashlib.sha256(t.encode()).digest()).decode() + "'" for t in own]
        assert rules[rule] == hashes and len(hashes) > 1


def test_nothing_is_loaded_and_no_element_carries_code_or_style(text: str) -> None:
    for tag, attributes, _ in Parsed(text).elements:
        assert not [name for name in attributes if name.startswith("on") or name in ("src", "href", "style", "srcset")]
        assert tag not in ("link", "iframe", "object", "embed", "img", "base")
    code = "".join(t for a, t in Parsed(text).of("script") if a.get("type") != "application/json")
    assert not re.search(r"\b(fetch|XMLHttpRequest|WebSocket|sendBeacon|import)\s*\(|innerHTML|\beval\b", code)
    assert "MIT License" in text and "Leon Sorokin" in text


def test_the_predictions_are_those_of_the_models(run: Path, text: str) -> None:
    header, runs = content(text)
    fit = read_fit(run)
    assert [m["kind"] for m in header["models"]] == ["start", "calibrated"]
    assert [r["role"] for r in header["runs"]] == ["calibration", "held out"]
    assert header["lengths"] == [30, 100, 0] and header["models"][0]["roles"] == ["hull", "propeller", "rudder", "wind"]
    (trial,) = read_trials([fit.data[0].path])
    t = np.frombuffer(base64.b64decode(runs[0]["t"]), "<f4")
    rows = np.searchsorted(trial.t - trial.t[0], t - 1e-4)
    bands = bands_of(fit.to_dict(), fit.ship)
    for k, (simulator, own) in enumerate(((Simulator(fit.start), None), (Simulator(fit.ship), bands))):
        windows, _ = predict(simulator, trial, LENGTHS[0], LENGTHS[0], bands=own)
        part = runs[0]["models"][k]["windows"][0]
        states = np.array([unpacked(column) for column in part["states"]]).T
        assert [int(rows[start]) for start in part["starts"]] == [w.first for w in windows]
        for w in windows[:-1]:
            inside, close = (rows >= w.first) & (rows < w.last), 2e-3 * np.ptp(states, axis=0).max()
            assert np.allclose(states[inside], w.states[rows[inside] - w.first], atol=close)
        assert ("std" in part) == (own is not None)
    assert np.abs(np.array([unpacked(c) for c in runs[0]["measured"]]).T - trial.states[rows]).max() < 1e-3


def test_the_forces_add_up_to_the_motion_and_the_network_is_one_of_them() -> None:
    hybrid, (trial, *_) = Simulator(lacking(), compiled=False), trials(lacking(), count=1, seconds=60)
    plain = forces_along(Simulator(ship(), compiled=False), trial)
    found = forces_along(hybrid, trial)
    assert set(found) == {*plain, NETWORK}
    assert all(np.array_equal(found[role], plain[role]) for role in plain)
    assert found[NETWORK].shape == (len(trial), 3) and np.abs(found[NETWORK][:, 1]).max() > 0.1
    p, c = ship().namespace, {s: row.value for s, row in ship().coefficients.items()}
    mass = p.m + c["m_x"] * 0.5 * p.rho * p.L**2 * p.d
    assert np.abs(found[NETWORK][:, 0] / mass).max() <= lacking().network.bound[0]


@pytest.mark.slow
def test_rows_keep_the_starts_of_windows_and_a_large_campaign_stays_small(run: Path) -> None:
    rows = shown_rows(5000, [33, 3333], 400)
    assert {0, 33, 3333, 4999} <= set(rows.tolist()) and len(rows) < 420 and (np.diff(rows) > 0).all()
    one = gather([run])
    many = replace(one, trials=one.trials[:1] * 40)
    assert rows_per_run(many, LENGTHS, [["hull"] * 5] * 2) >= 200
    assert len(view_page(many).encode()) < 15e6


def test_words_from_files_stay_words(run: Path) -> None:
    one = gather([run])
    models = (replace(one.models[0], label=EVIL, run=EVIL), *one.models[1:])
    shown = replace(one.trials[0].trial, kind=EVIL)
    ship = replace(one.ship, name="<b>x")
    text = view_page(replace(one, ship=ship, models=models, trials=(ViewTrial(shown, EVIL),), notes=(EVIL,)))
    assert "alert" not in "".join(t for a, t in Parsed(text).of("script") if a.get("type") != "application/json")
    assert "<b>x" not in text and content(text)[0]["notes"] == [EVIL]


def test_trials_are_those_of_the_run_where_they_are_as_they_were(run: Path, tmp_path: Path) -> None:
    own = campaign(tmp_path)
    names = [view.trial.name for view in gather([own]).trials]
    first = Path(str(read_fit(own).data[0].path))
    content = first.read_text()
    first.write_text(content + "\n")
    changed = gather([own])
    assert [view.trial.name for view in changed.trials] == names[1:]
    assert str(first) in changed.notes[0]
    first.unlink()
    assert str(first) in gather([own]).notes[0]
    for row in read_fit(own).validation_data:
        Path(str(row.path)).unlink()
    with pytest.raises(Missing, match="--trials"):
        gather([own])
    given = gather([own], [run.parent / "trials"])
    assert {view.role for view in given.trials} == {"calibration", "held out"}


@pytest.mark.slow
def test_a_diagnosis_among_the_runs_is_marked_and_there_is_one(tmp_path: Path) -> None:
    own = campaign(tmp_path)
    folder = with_diagnosis(own)
    found = gather([own, folder])
    assert gather([own]).diagnosis is None
    assert found.diagnosis and found.diagnosis.folder == "diagnosis" and len(found.diagnosis.missing) == 1
    header, runs = content(view_page(found))
    assert [r["missing"] for r in header["runs"]] == [True, False] and header["diagnosis"]["verdict"] == "unknown"
    force = np.array([unpacked(c) for c in runs[0]["missing"]["force"]])
    assert force.shape == (3, 80) and np.allclose(force[0], 0.3)
    with pytest.raises(Conflict):
        gather([own, folder, with_diagnosis(own, "second")])
    with pytest.raises(Missing):  # it names no effect
        gather([folder])


def test_equal_models_are_shown_once_and_different_ones_by_their_run(run: Path, tmp_path: Path) -> None:
    assert same_ship(lacking(), lacking()) and not same_ship(lacking(), ship())
    assert not same_ship(ship(), replace(ship(), campaigns={"spring": {"Y_v": -0.3}})), "instruments by campaign"
    twin = shutil.copytree(run, tmp_path / "twin")
    assert [m.kind for m in gather([run, twin]).models] == ["start", "calibrated"]
    text = (twin / "ship.toml").read_text()
    (twin / "ship.toml").write_text(re.sub(r"(?m)^(\[coefficients\.Y_v\]\nvalue = )-0\.", r"\g<1>-0.1", text))
    assert [m.label for m in gather([run, twin]).models][1:] == ["calibrated, run", "calibrated, twin"]


def test_bad_input_is_one_line(run: Path, tmp_path: Path) -> None:
    one = gather([run])
    for lengths in ((), (-1.0,), (float("nan"),)):
        with pytest.raises(BadValue, match="--window"):
            view_page(one, lengths)
    (tmp_path / "file").write_text("")
    with pytest.raises(NotWritable):
        write_view(one, tmp_path / "file" / "page.html")
    with pytest.raises(Missing, match=tmp_path.name):
        gather([tmp_path])


def test_a_trial_without_positions_or_with_gaps_is_shown(run: Path) -> None:
    one = gather([run])
    trial = one.trials[0].trial
    columns = {k: np.array(v) for k, v in trial.columns.items() if k not in ("x", "y")}
    columns["u"][10:20] = np.nan
    bare = replace(trial, columns=columns)
    model = ViewModel("calibrated", "calibrated", "run", one.models[1].simulator)
    header, runs = content(view_page(Campaign(one.ship, (model,), (ViewTrial(bare, "other"),), None, ())))
    assert header["runs"][0]["position"] is False
    assert np.isnan(unpacked(runs[0]["measured"][0])).all()
    assert np.isfinite(unpacked(runs[0]["models"][0]["windows"][0]["states"][3])).any()


# Columns come back as exactly as their bits allow, and no text can leave its script element
EVIL = "</script><script>alert(1)</script><!-- & \u2028"


@pytest.mark.parametrize("size", [1.0, 1e-6, 1e9])
def test_a_column_keeps_a_65534th_of_its_range_and_times_32_bits(size: float) -> None:
    values = size * np.random.default_rng(0).normal(3.0, 1.0, 500)
    found = unpacked(packed(values))
    assert np.abs(found - values).max() <= 0.5001 * np.ptp(values) / 65534
    assert np.abs(np.frombuffer(base64.b64decode(packed_times(values)), "<f4") / values - 1).max() < 1e-6


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ([1.0, np.nan, np.inf, 3.0], [1.0, np.nan, np.nan, 3.0]),
        *(([v] * 4, [v] * 4) for v in (np.nan, 7.25)),
        ([-1.7e308, 0.0, 1.7e308], [-1.7e308, 0.0, 1.7e308]),
    ],
)
def test_what_is_missing_stays_missing_and_constant_and_huge_columns_are_no_trouble(
    given: list, expected: list
) -> None:
    size = np.abs(np.nan_to_num(expected)).max()
    np.testing.assert_allclose(unpacked(packed(np.array(given))), expected, rtol=0, atol=1e-4 * size)


def test_json_in_a_page_holds_nothing_that_ends_a_script() -> None:
    text = safe_json({EVIL: [EVIL, float("nan"), np.float64(2.0)]})
    assert not set("<>&\u2028") & set(text)
    assert json.loads(text) == {EVIL: [EVIL, None, 2.0]}
