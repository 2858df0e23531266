"""Which campaign a trial belongs to: sidecar, day, clock, folder; contradictions in one clear line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases.io import published_splits as splits
from cases.io.campaigns import MEAN, TAKEN, UNKNOWN, campaign_among, campaigns_of, campaigns_taken, group_trials
from cases.io.read import read_trials
from cases.io.sidecar import read_sidecar
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from mmg.errors import UserError
from tests.support.trial_files import make_trial, write_csv


def trial(path: str, t0: float = 0.0, **meta: str) -> Trial:
    where = Path("/data") / path
    return Trial(where.stem, {"t": t0 + np.arange(3.0)}, path=where, meta=meta)


def names(*trials: Trial) -> list[str]:
    found = campaigns_of(trials)
    return [found.names[k] for k in found.number]


def test_the_sidecar_comes_before_the_day_and_the_day_before_the_folder() -> None:
    runs = (trial("a/x_12-Nov-2020.csv", campaign="autumn"), trial("b/x_12-Nov-2020_2.csv"), trial("b/y.csv"))
    assert names(*runs) == ["autumn", "2020-11-12", "b"]
    assert names(trial("a/y.csv", day="2021-01-02"), trial("a/z.csv")) == ["2021-01-02", UNKNOWN]
    assert names(trial("a/y.csv", t0=1.6e9), trial("a/z.csv", t0=5e3)) == ["2020-09-13", UNKNOWN]


def test_folders_tell_campaigns_only_where_there_are_several() -> None:
    """And two runs make one comparable."""
    assert names(trial("a/x.csv"), trial("a/y.csv")) == [UNKNOWN, UNKNOWN]
    found = campaigns_of([trial("a/x.csv"), trial("b/y.csv"), trial("b/z.csv")])
    assert found.names == ("a", "b") and found.number == (0, 1, 1)
    assert found.comparable == ("b",) and found.runs("a") == 1


def test_a_sidecar_that_contradicts_the_day_or_the_folder_is_refused() -> None:
    with pytest.raises(UserError, match=r"2020-11-13.*2020-11-12"):
        names(trial("a/x_12-Nov-2020.csv", campaign="2020-11-13"))
    with pytest.raises(UserError, match="campaign b"):
        names(trial("a/x.csv", campaign="b"), trial("b/y.csv"))
    assert names(trial("a/x_12-Nov-2020.csv", campaign="2020-11-12")) == ["2020-11-12"]


def test_a_date_that_is_none_is_passed_over_in_a_name_and_refused_in_a_sidecar(tmp_path: Path) -> None:
    assert names(trial("a/run_2026-02-30.csv"), trial("a/run_2026-02-27.csv")) == [UNKNOWN, "2026-02-27"]
    sidecar = tmp_path / "trials.toml"
    sidecar.write_text('[default]\ncampaign = "2026-02-30"\n', encoding="utf-8")
    with pytest.raises(UserError, match="2026-02-30"):
        read_sidecar(sidecar)


def test_a_trial_finds_its_campaign_among_those_that_are_known() -> None:
    known = ("autumn", "2020-11-12", "day two", "north/a")
    assert campaign_among(trial("a/x.csv", campaign="autumn"), known) == "autumn"
    assert campaign_among(trial("a/x_12-Nov-2020.csv"), known) == "2020-11-12"
    assert campaign_among(trial("a/x_12-Nov-2020.csv", campaign="spring"), known) is None
    assert campaign_among(trial("day two/x.csv"), known) == "day two"
    assert campaign_among(trial("north/a/x.csv"), known) == "north/a"
    assert campaign_among(replace(trial("b/x.csv"), path=None), known) is None


def test_predictions_say_which_campaign_they_take_and_which_trials_are_of_none() -> None:
    ship = load_ship("esso_osaka_3m").with_effect("gyro")
    trials = [trial("x_12-Nov-2020.csv"), trial("y_12-Nov-2020.csv"), trial("z_01-Jan-2021.csv")]
    assert campaigns_taken(ship, trials) == []
    knowing = replace(ship, campaigns={"2020-11-12": {"gyro.T": 1.0}, "2020-08-06": {"gyro.T": 0.0}})
    taken, mean = campaigns_taken(knowing, trials)
    assert taken.code == TAKEN and taken == "x_12-Nov-2020, y_12-Nov-2020: gyro.T as in campaign 2020-11-12"
    assert mean.code == MEAN and "z_01-Jan-2021" in mean
    many = campaigns_taken(knowing, [trial(f"{k}_12-Nov-2020.csv") for k in range(9)])
    assert len(many) == 1 and "6 more" in many[0]


@pytest.mark.parametrize(
    ("name", "day"),
    [
        ("zigzag_31-Jul-2020_14_10_05", "2020-07-31"),
        ("berthing_12-Nov-2020_11_14_47", "2020-11-12"),
        ("random_06-Aug-2020_16_24_25_5", "2020-08-06"),
        ("turn_2026-11-22_run3", "2026-11-22"),
        ("run_20261122T101500", "2026-11-22"),
        ("4 September 2019 b", "2019-09-04"),
        ("99991399_then_2021_02_03", "2021-02-03"),
    ],
)
def test_the_day_is_the_first_date_in_the_name(name: str, day: str) -> None:
    trials = [make_trial(name), make_trial("x_2001-01-01")]
    groups = group_trials(trials, "DAY")
    assert groups.by == "day" and groups.names == ("2001-01-01", day) and groups.number == (1, 0)
    assert group_trials(trials, "year").names == ("2001", day[:4])
    members = {k: [t.name for t in v] for k, v in groups.members(trials).items()}
    assert members == {"2001-01-01": ["x_2001-01-01"], day: [name]}


def test_the_sidecar_gives_day_and_group_and_wins_over_the_name(tmp_path: Path) -> None:
    for name in ("a_2020-01-01", "b", "c"):
        write_csv(tmp_path / f"{name}.csv")
    text = '[all]\nday = 2021-05-06\ngroup = "before"\n[files.c]\nday = "2021-05-07"\ngroup = "after"\n'
    (tmp_path / "trials.toml").write_text(text)
    trials = read_trials(tmp_path)
    assert group_trials(trials, "day").names == ("2021-05-06", "2021-05-07")
    groups = group_trials(trials, "Group")
    assert (groups.names, groups.number) == (("after", "before"), (1, 1, 0))
    (tmp_path / "trials.toml").write_text('[all]\nday = "yesterday"\n')
    with pytest.raises(UserError, match="'yesterday'"):
        read_trials(tmp_path)


def test_folders_are_told_by_what_differs_in_their_paths(tmp_path: Path) -> None:
    for year in ("2020", "2021"):
        (tmp_path / year / "trials").mkdir(parents=True)
        write_csv(tmp_path / year / "trials" / "run.csv")
    trials = read_trials([tmp_path / "2020" / "trials", tmp_path / "2021" / "trials"])
    assert group_trials(trials, "folder").names == (str(Path("2020/trials")), str(Path("2021/trials")))


@pytest.mark.parametrize(
    ("by", "words"),
    [("weather", "--between"), ("day", "no date in the name of second"), ("folder", "first_2020-01-01"),
     ("group", "first_2020-01-01"), ("kind", "all trials are of one group")],
)  # fmt: skip
def test_what_cannot_be_grouped_is_refused_in_one_line(by: str, words: str) -> None:
    trials = [replace(make_trial(name), kind="turning") for name in ("first_2020-01-01", "second")]
    with pytest.raises(UserError) as refused:
        group_trials(trials, by)
    assert words in str(refused.value) and "\n" not in str(refused.value)


# Published splits of the records of FRT-DS-ESSO
def test_the_splits_have_the_published_sizes_and_no_test_set_is_trained_on():
    sizes = {name: len(set(names)) for name, names in splits.SPLITS.items()}
    assert sizes == {
        "train-tzb": 11, "train-tzrb": 8, "train-tzrb+": 35, "test": 6, "development-holdout": 5,
        "miyauchi-train-r": 4, "miyauchi-train-tr": 5, "miyauchi-train-trz": 6, "miyauchi-test": 5,
    }  # fmt: skip
    for name, names in splits.SPLITS.items():
        assert len(set(names)) == len(names)
        if "train" in name:
            assert not set(names) & set(splits.MIYAUCHI_TEST if "miyauchi" in name else splits.TEST), name


def test_absent_records_are_named(tmp_path, monkeypatch):
    (tmp_path / "frt-ds-esso" / "zigzag").mkdir(parents=True)
    (tmp_path / "frt-ds-esso" / "zigzag" / "a.csv").write_text("")
    monkeypatch.setenv("MMG_DATA", str(tmp_path))
    assert [p.name for p in splits.find(["a"])] == ["a.csv"]
    with pytest.raises(UserError, match="b, c"):
        splits.find(["a", "b", "c"])


def test_a_wrong_data_folder_is_said(tmp_path, monkeypatch):
    monkeypatch.setenv("MMG_DATA", str(tmp_path / "nowhere"))
    with pytest.raises(UserError, match="MMG_DATA="):
        splits.data_folder()


def test_the_data_lie_beside_the_repository_from_wherever_one_asks(tmp_path, monkeypatch):
    module = tmp_path / "repository" / "cases" / "io" / "published_splits.py"
    (tmp_path / "shared" / "data").mkdir(parents=True)
    module.parent.mkdir(parents=True)
    monkeypatch.delenv("MMG_DATA", raising=False)
    monkeypatch.chdir(module.parent)
    monkeypatch.setattr(splits, "__file__", str(module))
    assert splits.data_folder() == (tmp_path / "shared" / "data").resolve()


@pytest.mark.data
def test_the_published_table_names_the_same_files(frt):
    text = (frt / "SOURCE_README.md").read_text(encoding="utf-8")
    wakita, miyauchi = text.split("[Wakita (2022)]")[-1].split("- [Miyauchi (2022)]")[:2]

    def column(part: str, index: int) -> set[str]:
        rows = [line.split("|") for line in part.splitlines() if line.startswith("| `data/")]
        return {row[1].strip(" `").split("/")[-1][:-4] for row in rows if "⭕" in row[index]}

    published = [column(wakita, i) for i in range(2, 6)] + [column(miyauchi, i) for i in range(2, 6)]
    ours = [
        splits.TRAIN_TZB, splits.TRAIN_TZRB, splits.TRAIN_TZRB_PLUS, splits.TEST,
        splits.MIYAUCHI_TRAIN_R, splits.MIYAUCHI_TRAIN_TR, splits.MIYAUCHI_TRAIN_TRZ, splits.MIYAUCHI_TEST,
    ]  # fmt: skip
    assert published == [set(names) for names in ours]
