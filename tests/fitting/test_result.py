"""The result of a calibration: one writer, one reader, what is wrong with a file is said by its key."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

from fitting.report.plot_style import png_of
from fitting.report.run_folder import RESULT, reserved, write_json, write_whole
from fitting.result import read_fit, write_report
from mmg.errors import BadValue, Conflict, NotWritable, TargetExists
from mmg.messages import has_code
from mmg.ship import Ship
from tests.support.calibrated import FREE, small_result

pytestmark = pytest.mark.usefixtures("blank_figures")
KEYS = {
    "kind", "schema_version", "created", "command", "ship", "converged", "status", "advice", "objective",
    "constraint_violation", "condition_number", "iterations", "passes", "starts", "settings", "seed", "versions",
    "compiled", "timings_s", "data", "validation_data", "windows", "intervals", "seconds_used", "sigma", "noise",
    "coefficients", "fixed", "correlation", "scores", "identifiability", "warnings", "notices", "messages", "figures",
    "uncertainty", "bands", "adaptation", "calibration", "envelope",
}  # fmt: skip
"""Keys of result.json of a fit with held-out trials; "per_run", "campaigns", "bootstrap" and "profiles" come where
there are any."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("result") / "run"
    small_result().save(path)
    return path


def named(ship: Ship, name: str) -> Ship:
    """The ship of a result that was saved in a folder of this name."""
    assert ship.mark is not None and ship.mark.name == ""
    return replace(ship, mark=replace(ship.mark, name=name))


def content_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / RESULT).read_text())


def test_the_keys_of_the_file_are_these(folder: Path) -> None:
    content = content_of(folder)
    assert set(content) == KEYS and content["schema_version"] == 1
    assert set(content["coefficients"]) == set(FREE)
    assert {m["level"] for m in content["messages"]} <= {"warning", "notice"}
    said = [m["text"] for m in content["messages"]]
    assert said == [*content["warnings"], *content["notices"]]


def test_what_is_read_is_what_was_written(folder: Path) -> None:
    result, content = read_fit(folder), content_of(folder)
    assert result.to_dict() == content
    assert result.ship == named(small_result().ship, "run") and result.start == small_result().start
    assert result.iterate is not None and small_result().iterate is not None
    for name, values in small_result().iterate.items():  # type: ignore[union-attr]
        np.testing.assert_array_equal(result.iterate[name], values)
    assert result.warnings == small_result().warnings and result.calibration is None
    assert has_code(small_result().notices, "interpreted") == has_code(result.notices, "interpreted")
    assert result.scores["validation"].after.window == small_result().scores["validation"].after.window


def test_a_result_saved_again_leaves_the_same_folder(folder: Path, tmp_path: Path) -> None:
    again = read_fit(folder).save(tmp_path / "again")
    assert content_of(tmp_path / "again") == content_of(folder) == again.to_dict()
    assert {p.name for p in (tmp_path / "again").rglob("*")} == {p.name for p in folder.rglob("*")}
    with pytest.raises(TargetExists):
        again.save(tmp_path / "again")


def spoilt(content: dict, *path: str) -> dict:
    part = content
    for key in path[:-1]:
        part = part[key]
    del part[path[-1]]
    return content


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: [], "JSON"),
        (lambda c: {}, " kind"),
        (lambda c: {"converged": True, "kind": "calibration", "schema_version": 1}, "created: "),
        (lambda c: {**c, "kind": "diagnosis"}, "kind = 'diagnosis'"),
        (lambda c: {**c, "schema_version": 2}, "schema_version = 2"),
        (lambda c: spoilt(c, "ship"), "ship: "),
        (lambda c: spoilt(c, "coefficients", "Y_v", "value"), "coefficients.Y_v.value"),
        (lambda c: {**c, "windows": "many"}, "windows: "),
        (lambda c: spoilt(c, "scores", "validation", "after", "sigma"), "scores.validation.after"),
        (lambda c: {**spoilt(c, "status"), "iterations": None}, "status.*iterations|iterations.*status"),  # all at once
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_said_by_its_key(folder: Path, tmp_path: Path, change, words: str) -> None:  # type: ignore[no-untyped-def]
    shutil.copytree(folder, tmp_path / "bad")
    write_json(tmp_path / "bad" / RESULT, change(content_of(folder)))
    with pytest.raises(BadValue, match=words) as error:
        read_fit(tmp_path / "bad")
    assert str(tmp_path / "bad" / RESULT) in str(error.value)


def test_results_are_tables(folder: Path) -> None:
    result = read_fit(folder)
    table = result.coefficients
    assert set(table.index) == set(FREE) and table.index.name == "coefficient" and table.equals(result.to_pandas())
    assert {"value", "std", "lower", "upper", "unit", "verdict"} <= set(table.columns)
    assert {s: (row.value, row.std) for s, row in result.estimates.items()} == {
        s: (table.value[s], table["std"][s]) for s in FREE
    }
    scores = result.scores["validation"].after.to_pandas()
    assert list(scores.index) == [row.name for row in result.validation_data]
    evil = replace(result, ship_name="<script>")
    assert "<script>" not in evil._repr_html_() and "Y_v" in evil._repr_html_()
    assert "30 s windows" in result.scores["validation"].after._repr_html_()


def test_its_folder_holds_the_loss_of_its_trials(folder: Path) -> None:
    made, read = small_result(), read_fit(folder)
    assert made.objects and made.loss is not None and read.loss is not None
    assert read.loss.of_trials(made.objects.trials) is not None and read.loss.of_trials(made.objects.validation) is None
    np.testing.assert_array_equal(read.loss.starts, made.loss.starts)
    assert {path.stat().st_mode & 0o777 for path in folder.glob("*.safetensors")} == {0o644}  # others read them


@pytest.mark.slow
def test_what_was_saved_without_report_gets_the_same_figures_later(tmp_path: Path) -> None:
    result, seen = small_result(), []
    saved = result.save(tmp_path / "run", report=False, numbers=seen.append)
    assert seen[0].ship == saved.ship and not saved.figures
    assert not {"figures", "report.html"} & {p.name for p in (tmp_path / "run").iterdir()}
    read = read_fit(tmp_path / "run")
    assert read.estimates == saved.estimates and not has_code(read.warnings, "parts_left_out")
    objects = result.objects
    assert objects
    late = read.with_late_figures((*objects.trials, *objects.validation))
    assert late.figures == read_fit(tmp_path / "run").figures == result.save(tmp_path / "drawn").figures
    assert all((tmp_path / "run" / "figures" / row.file).is_file() for row in late.figures)
    names = [f"track_{k + 1}.png" for k in range(len(late.figures))]
    assert names and [row.file for row in late.figures] == names and all(row.caption for row in late.figures)
    assert objects.validation[0].name in late.figures[0].title
    assert 'id="run1-scores"' in write_report([tmp_path / "run"], tmp_path / "page.html", imo=False)


def test_a_figure_or_page_that_fails_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The numbers are in the folder before anything is drawn; what could not be made is a warning of the result."""

    def broken(*_: Any) -> None:
        content = json.loads((tmp_path / "run" / RESULT).read_text())
        assert content["figures"] == [] and content["messages"][0]["code"] == "parts_left_out"  # not yet all there
        raise ValueError("no such glyph")

    before = dict(mpl.rcParams)
    monkeypatch.setattr("fitting.report.plot_style.png_of", png_of)  # figures are drawn here
    monkeypatch.setattr("fitting.report.plots.profile_plot", broken)
    monkeypatch.setattr("fitting.report.page.build_page", broken)
    profile = {"symbol": FREE[0], "values": [], "increase": [], "dispersion": 1.0}
    saved = replace(small_result(), profiles=(profile,)).save(tmp_path / "run")
    read = read_fit(tmp_path / "run")
    assert read.estimates == small_result().estimates and read.ship == named(small_result().ship, "run")
    failed = [str(m) for m in read.warnings if m.code == "figure_failed"]
    assert not has_code(read.warnings, "parts_left_out")
    assert len(failed) == 2
    assert [row.file for row in read.figures] == ["track_1.png"] and saved.figures == read.figures
    assert (tmp_path / "run" / "figures" / "track_1.png").stat().st_size > 3000 and dict(mpl.rcParams) == before


# Run folders: whole or absent, one process at a time, nothing left beside them
KILLED = """
import os, sys
from pathlib import Path
from fitting.report.run_folder import reserved, write_whole

def fill(folder):
    (folder / "half").write_text("written")
    os.kill(os.getpid(), 9)

folder = Path(sys.argv[1])
with reserved(folder):
    write_whole(folder, fill, replace=True)
"""


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def write(folder: Path) -> None:
    (folder / "whole").write_text("written")


@pytest.mark.skipif(os.name == "nt", reason="kills by SIGKILL")
def test_what_a_killed_process_left_is_removed_by_the_next(tmp_path: Path) -> None:
    """SIGKILL while a run is written: no folder of that name, and the next run clears what is hidden beside it."""
    done = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "run")], cwd=Path(__file__).parents[2])
    assert done.returncode == -9 and not (tmp_path / "run").exists() and len(names(tmp_path)) == 3
    (tmp_path / ".run.mine").mkdir()
    with reserved(tmp_path / "run"):
        write_whole(tmp_path / "run", write)
    assert names(tmp_path) == [".run.mine", "run"] and names(tmp_path / "run") == ["whole"]


def test_two_processes_do_not_work_on_one_folder(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "run"
    with reserved(folder):
        with pytest.raises(Conflict), reserved(folder):
            pass
        with reserved(tmp_path / "deep" / "other"):
            pass
    assert names(tmp_path) == []
    with reserved(folder):
        write_whole(folder, write)
    assert names(tmp_path / "deep") == ["run"]


def test_a_run_survives_a_full_disk_and_a_process_killed_between_the_renames_that_replace_it(
    tmp_path: Path,
) -> None:
    def full(folder: Path) -> None:
        write(folder)
        raise OSError(28, "No space left on device")

    write_whole(tmp_path / "run", write)
    (tmp_path / ".run.0123abcd.old").mkdir()
    (tmp_path / "run").rename(tmp_path / ".run.0123abcd.old" / "run")  # as the killed process leaves it
    with pytest.raises(NotWritable):
        write_whole(tmp_path / "run", full, replace=True)
    assert names(tmp_path) == ["run"] and names(tmp_path / "run") == ["whole"]
