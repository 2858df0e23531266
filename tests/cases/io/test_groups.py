"""Groups of trials: by the day in the sidecar or the file name, by folder, by a key of the sidecar."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cases.io.groups import group_trials
from cases.io.read import read_trials
from mmg.errors import UserError
from tests.support.trial_files import make_trial, write_csv


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
    assert {k: [t.name for t in v] for k, v in groups.members(trials).items()} == {
        "2001-01-01": ["x_2001-01-01"],
        day: [name],
    }


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
    [
        ("weather", "--between"),
        ("day", "no date in the name of second"),
        ("folder", "first_2020-01-01"),
        ("group", "first_2020-01-01"),
        ("kind", "all trials are of one group"),
    ],
)
def test_what_cannot_be_grouped_is_refused_in_one_line(by: str, words: str) -> None:
    trials = [replace(make_trial(name), kind="turning") for name in ("first_2020-01-01", "second")]
    with pytest.raises(UserError) as refused:
        group_trials(trials, by)
    assert words in str(refused.value) and "\n" not in str(refused.value)
