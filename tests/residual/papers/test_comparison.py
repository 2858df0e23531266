"""``mmg compare`` and black boxes on the command line: subsets, tables, growth, limits, one line for bad input."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases.io.published_splits import SPLITS
from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from fitting.nlp.windows import Stretch
from fitting.prediction.score import Score, TrialScore, pooled_sigma
from fitting.report.run_folder import read_result
from mmg.errors import Missing, TooFewData
from mmg_ident.commands.main import main
from residual.papers.black_box import load_box
from residual.papers.comparison import (
    GROWTH,
    HORIZONS,
    SHORTER,
    TABLE_9,
    TABLE_9_TEST,
    TYPES,
    Comparison,
    Entry,
    Study,
    Subset,
    accuracy,
    blocks_of,
    compare,
    comparison_dict,
    efficiency,
    growth,
    horizon,
    mean_and_std,
    paper_models,
    published,
    subset_of,
    table_9_errors,
    tables_text,
)
from residual.settings import BlackBoxSettings
from tests.support import hybrids
from tests.support.commands import refusal, shown

QUICK = ["--seeds", "2", "--epochs", "2", "--step", "1"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Synthetic trials to train on, one to test on, the run folder of a black box."""
    folder = tmp_path_factory.mktemp("compare")
    (folder / "train").mkdir()
    for k, trial in enumerate(hybrids.trials(hybrids.ship(), 5, 200)):
        name = f"{'random' if k < 2 else 'turn'}_{k}"
        write_trial(replace(trial, name=name), folder / "train" / f"{name}.csv")
    write_trial(hybrids.trials(hybrids.ship(), 1, 220, seed=7)[0], folder / "test.csv")
    options = ["--model", "rnn-window", "--memory", "3", *QUICK, "--augment", "sli2", "--loss", "state"]
    assert main(["train", "esso_osaka_3m", str(folder / "train"), *options, "--out", str(folder / "box")]) == 0
    return folder


@pytest.mark.slow
def test_a_black_box_run_is_scored_and_predicts_like_a_ship(folder: Path, tmp_path: Path) -> None:
    content = read_result(folder / "box")
    assert content["kind"] == "training" and content["model"] == "rnn-window" and content["seeds"] == [0, 1]
    assert content["settings"]["memory"] == 3 and content["settings"]["augment"] == "sli2"
    assert [system.past for system in load_box(folder / "box").systems] == [2, 2]
    names = {p.name for p in (folder / "box").iterdir()}
    assert {"network.safetensors", "start.toml", "result.json", "figures"} <= names and "ship.toml" not in names
    models = shown("score", "esso_osaka_3m", folder / "box", folder / "test.csv")["models"]
    ship, box = models["esso_osaka_3m"], models[str(folder / "box")]
    assert box["window"] > ship["window"] and box["trials"][0]["windows"] == ship["trials"][0]["windows"]
    out = tmp_path / "out.csv"
    assert main(["predict", str(folder / "box"), str(folder / "test.csv"), "--window", "30", "--out", str(out)]) == 0
    rows = np.loadtxt(out, delimiter=",", skiprows=1)
    assert len(np.unique(rows[:, 0])) == 8 and np.isfinite(rows).all()


@pytest.mark.slow
def test_a_black_box_is_no_ship_and_belongs_to_its_inputs(folder: Path, tmp_path: Path) -> None:
    box, test = folder / "box", folder / "test.csv"
    refusal("simulate", box, "--maneuver", "turning:35")
    refusal("fit", box, test, "--out", tmp_path / "run")
    assert "--adapt" in refusal("predict", box, test, "--adapt", "20", "--out", tmp_path / "p.csv")
    other = tmp_path / "other"
    other.mkdir()
    for name in ("network.safetensors", "result.json"):
        (other / name).write_bytes((box / name).read_bytes())
    (other / "start.toml").write_text(dump_ship(load_ship("vectwin_3m"), "another"))
    refusal("score", other, test)


@pytest.mark.slow
def test_the_comparison_is_written_whole(folder: Path, tmp_path: Path) -> None:
    test, out = folder / "test.csv", ["--out", tmp_path / "cmp"]
    arguments = ["compare", "--train", folder / "train", test, "--test", test, *out]
    arguments += [*QUICK, "--models", "captive,fnn,rnn-window", "--fractions", "0.5,1", "--no-random", "--workers", "1"]
    content = shown(*arguments)
    assert content["past_s"] == 0.0, "no model uses the past of a window"
    assert [row["name"] for row in content["test"]] == ["test"] and len(content["train"]) == 5, "tests are taken out"
    entries = content["entries"]
    assert {(e["model"], e["fraction"], e["random"], e["seed"]) for e in entries} == {
        ("captive", 1.0, True, None),
        *((m, f, r, s) for m in ("fnn", "rnn-window") for f in (1.0, 0.5) for r in (True, False) for s in (0, 1)),
    }
    tables = (tmp_path / "cmp" / "tables.md").read_text()
    assert "0.236 ± 0.003" in tables
    assert {p.name for p in (tmp_path / "cmp").iterdir()} == {"tables.md", "result.json", "entries"}
    (tmp_path / "cmp" / "entries" / "fnn_1_seed_1.json").unlink()
    again = shown(*arguments, "--resume")["entries"]
    assert [e["score"] for e in again] == [e["score"] for e in entries]
    refusal(*arguments, "--epochs", "3", "--resume")
    seconds = {(e["fraction"], e["random"]): e["training_s"] for e in entries if e["model"] == "fnn"}
    assert seconds[1.0, True] == 1000 and seconds[1.0, False] == 600 and 400 < seconds[0.5, True] < 600


@pytest.mark.slow
def test_calibrated_and_hybrid_are_trained_on_the_same_trials_as_the_networks() -> None:
    trials = tuple(hybrids.trials(hybrids.lacking(), 5, 150))
    tests = tuple(hybrids.trials(hybrids.lacking(), 1, 120, seed=5))
    study = Study(hybrids.ship(), trials, tests, ("captive", "calibrated", "hybrid"), seeds=1, epochs=1, step=1.0)
    found = compare(study)
    assert [(e.model, e.seed, e.status) for e in found.entries] == [
        ("captive", None, "finished"), ("calibrated", None, "finished"), ("hybrid", 0, "finished"),
    ]  # fmt: skip
    captive, calibrated, hybrid = (e.score.window for e in found.entries if e.score)
    assert calibrated < captive and hybrid < 1.2 * calibrated


def test_ctrl_c_keeps_what_is_done() -> None:
    trials = tuple(hybrids.trials(hybrids.ship(), 5, 150))
    study = Study(hybrids.ship(), trials, trials[:1], ("captive", "fnn"), seeds=1, step=1.0)
    found = compare(study, progress=lambda made: signal.raise_signal(signal.SIGINT) if made.step == 1 else None)
    entries = [("captive", "finished"), ("fnn", "not begun")]
    assert [(e.model, e.status) for e in found.entries] == entries and found.interrupted


def test_a_network_that_has_no_time_for_an_epoch_is_not_begun() -> None:
    trials = tuple(hybrids.trials(hybrids.ship(), 5, 150))
    found = compare(Study(hybrids.ship(), trials, trials[:1], ("fnn",), seeds=1, step=1.0, time_limit=1e-3))
    assert [e.status for e in found.entries] == ["not begun"] and found.interrupted


class Drifting:
    """Predicts what was measured, and a position and heading that are off by a known rate."""

    inputs = ("n", "delta", "wind_north", "wind_east")

    def forecast(self, stretches: Sequence[Stretch]) -> np.ndarray:
        rows = max(s.last - s.first for s in stretches) + 1
        out = np.full((rows, 6, len(stretches)), np.nan)
        for i, s in enumerate(stretches):
            t = s.record.t[s.first : s.last + 1] - s.record.t[s.first]
            out[: len(t), :, i] = s.logged + np.outer(t, [0.03, -0.04, 0.01, 0, 0, 0])
        return out


def test_growth_is_read_at_the_horizons_from_windows_that_are_long_enough() -> None:
    found = growth(Drifting(), hybrids.trials(hybrids.ship(), 2, 140))
    np.testing.assert_allclose(found["position_m"], 0.05 * np.array(HORIZONS), rtol=1e-9)
    np.testing.assert_allclose(found["heading_rad"], 0.01 * np.array(HORIZONS), rtol=1e-9)
    short = growth(Drifting(), hybrids.trials(hybrids.ship(), 1, 40))
    assert np.isfinite(short["position_m"][:4]).all() and np.isnan(short["position_m"][4:]).all()


def trial(name: str, seconds: int, kind: str = "") -> Trial:
    t = np.arange(seconds + 1.0)
    return Trial(name, {"t": t, "u": t}, kind=kind)


def test_shares_of_the_data_are_blocks_spread_evenly() -> None:
    trials = [trial("turn", 650), trial("random_1", 660), trial("zigzag", 70)]
    assert subset_of(trials, Subset()) == tuple(trials)
    assert [t.name for t in subset_of(trials, Subset(1.0, False))] == ["turn", "zigzag"]
    assert [t.name for t in subset_of([trial("a", 70, "random"), *trials[:1]], Subset(1.0, False))] == ["turn"]
    third = subset_of(trials, Subset(0.3))
    assert sum(t.duration for t in third) == pytest.approx(0.3 * 1380, rel=0.1)
    assert {t.name.split()[0] for t in third} == {"turn", "random_1"} or len(third) == 6
    rows = np.concatenate([b["u"] for b in blocks_of(trials[0])])
    np.testing.assert_array_equal(rows, trials[0]["u"])
    assert all(b.duration >= 60 for b in blocks_of(trials[0]))
    with pytest.raises(TooFewData):
        subset_of(trials[1:2], Subset(1.0, False))


def entry(model: str, seed: int | None, value: float, subset: Subset = Subset()) -> Entry:
    row = TrialScore("one", 2 * value, {}, value, {}, 3)
    found = Score((row,), 20 * value, 10 * value, np.ones(6), "")
    growth = dict.fromkeys(GROWTH, (value,) * len(HORIZONS))
    return Entry(model, subset.fraction, subset.random, seed, "finished", 100.0, found, growth)


def test_tables_give_mean_and_standard_deviation_over_seeds() -> None:
    half = Subset(0.5)
    study = Study(hybrids.ship(), (trial("a", 10),), (trial("one", 10),), ("captive", "fnn"), (Subset(), half), seeds=2)
    entries = (entry("captive", None, 3.0), entry("fnn", 0, 1.0), entry("fnn", 1, 2.0), entry("fnn", 0, 5.0, half))
    found = Comparison(study, entries, False)
    assert [c.strip() for c in accuracy(found, "window")[2].split("|")[1:-1]] == ["one", "3.000", "1.500 ± 0.707"]
    pooled = [c.strip() for c in accuracy(found, "paper")[3].split("|")[1:-1]]
    assert pooled[1:] == ["60.000", "30.000 ± 14.142"]
    assert [line.split("|")[3].strip() for line in efficiency(found)[2:]] == ["15.000 ± 7.071", "50.000"]
    assert horizon(found, "heading_rad")[2].split("|")[2].strip() == f"{np.degrees(3.0):.1f}"
    assert mean_and_std([]) == "-" and mean_and_std([1.0, float("nan")]) == "-"


def test_table_9_is_complete() -> None:
    assert len(TABLE_9_TEST) == 6 and all(len(cells) == 6 for cells in TABLE_9.values())
    assert len(published()) == 2 + 6 and "4834 ± 4041" in "\n".join(published())
    assert "train-tzrb" in SPLITS and "development-holdout" in SPLITS and {*TABLE_9} == {"captive", *TYPES}


def named(records: Sequence[str], seconds: int = 60) -> list[Trial]:
    """Synthetic trials with the names of published records."""
    runs = hybrids.trials(hybrids.ship(), len(records), seconds)
    return [replace(run, name=name) for run, name in zip(runs, records, strict=True)]


def test_the_networks_of_the_paper_have_its_settings_and_records() -> None:
    records = [*SPLITS["train-tzb"][:2], *SPLITS["train-tzrb"][:1], "another"]
    trials = named(records)
    found = paper_models(trials, list(TYPES), 7, seeds=3, seed=2)
    for name, (settings, own) in found.items():
        kind, loss, split = TYPES[name]
        assert [t.name for t in own] == [r for r in records if r in SPLITS[split]]
        assert (settings.kind, settings.loss, settings.width, settings.memory) == (kind, loss, 200, 10)
        assert (settings.step, settings.method, settings.curriculum) == (0.1, "euler", ((6.0, 1.0),))
        assert (settings.epochs, settings.batch, settings.seeds, settings.seed) == (7, 512, 3, 2)
        assert settings.rate == settings.last_rate == (1e-4 if loss == "acceleration" else 2e-5)
        assert settings.sigma == pytest.approx(np.vstack([t.states for t in own]).std(axis=0))
    shorter = paper_models(trials, ["type5"], None)["type5"][0]
    assert (shorter.batch, shorter.stride, shorter.rate) == (128, 3.0, 1e-3) and shorter.epochs > 200
    with pytest.raises(Missing):
        paper_models(named(["another"]), ["type1"], None)


def test_table_9_restarts_random_and_turning_runs_alone() -> None:
    trials = named(["random_1", "zigzag_1"], 250)
    random, zigzag = table_9_errors(Drifting(), trials)
    sigma = pooled_sigma(trials)
    rate = (np.array([0.03, -0.04, 0.01, 0, 0, 0]) / sigma) ** 2
    restarted = np.concatenate([np.arange(101.0), np.arange(101.0), np.arange(51.0)])
    assert random == pytest.approx(rate.sum() * (restarted**2).mean(), rel=1e-6)
    assert zigzag == pytest.approx(rate.sum() * (np.arange(251.0) ** 2).mean(), rel=1e-6)


def test_a_study_of_the_paper_trains_on_trials_of_its_own_and_says_its_schedule() -> None:
    trials, tests = hybrids.trials(hybrids.ship(), 5, 60), tuple(named(["turn_1"], 120))
    values = {"width": 6, "memory": 3, "epochs": 1, "step": 1.0, "curriculum": ((6.0, 1.0),)}
    settings = BlackBoxSettings(kind="rnn-window", seeds=1, sigma=(1.0, 1.0, 0.1, 1.0, 1.0, 1.0), **values)
    paper = {"type5": (settings, tuple(trials))}
    study = Study(hybrids.ship(), tests, tests, ("captive", "type5"), seeds=1, paper=paper)
    found = compare(study)
    assert [(e.model, e.status, e.training_s, len(e.table_9)) for e in found.entries] == [
        ("captive", "finished", 120.0, 1), ("type5", "finished", 300.0, 1),
    ]  # fmt: skip
    content = comparison_dict(found, "mmg compare")
    assert content["schedule"] == SHORTER and content["paper"]["type5"]["settings"]["sigma"][2] == 0.1
    assert SHORTER in tables_text(found)
    longer = comparison_dict(replace(found, study=replace(study, epochs=9)), "mmg compare")
    assert longer["schedule"] is None


def test_the_paper_has_trials_and_models_of_its_own(tmp_path: Path) -> None:
    for words in (["--train", tmp_path], ["--fractions", "0.5"], ["--step", "1"], ["--models", "fnn"]):
        refusal("compare", "--paper", "wakita2022", *words)
    refusal("compare", "--paper", "wakita2030")
