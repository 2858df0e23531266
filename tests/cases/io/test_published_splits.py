from __future__ import annotations

import pytest

from cases.io import published_splits as splits
from mmg.errors import UserError


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
