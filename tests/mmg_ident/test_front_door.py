"""The package mmg_ident: its names, what importing it costs, and that it does what the commands do."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mmg_ident
from cases.simulation.simulate import write_trial
from fitting.calibrate import FitOptions
from mmg_ident import shadowing_mmg
from mmg_ident.commands.main import main
from tests.support.calibrated import FREE
from tests.support.quick import first_quick
from tests.support.synthetic_runs import coarse_runs
from tests.support.trial_files import write_trials

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
def test_scores_are_those_of_the_command_and_tables_as_predictions_are(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    held_out = mmg_ident.read_trials([folder / "held_out.csv"])
    ours = mmg_ident.score(mmg_ident.load_run(folder / "run"), held_out)
    assert ours.window < mmg_ident.score("esso_osaka_3m", held_out).window
    capsys.readouterr()
    assert main(["score", str(folder / "run"), str(folder / "held_out.csv"), "--json"]) == 0
    theirs = json.loads(capsys.readouterr().out)["models"][str(folder / "run")]
    assert (theirs["window"], theirs["paper"]) == (ours.window, ours.paper)
    assert theirs["units"]["pooled"]["v_m_s"] == ours.units.pooled.v_m_s
    table = ours.to_pandas()
    assert list(table["window"]) == [trial.window for trial in ours.trials]
    assert list(table["v_m_s"]) == [run.v_m_s for run in ours.units.runs] and "v_m_s" in ours._repr_html_()
    assert "baseline" in mmg_ident.score(folder / "run", held_out, baseline=folder / "held_out.csv").units.ratio
    (found,) = mmg_ident.predict(folder / "run", folder / "held_out.csv")
    assert found.to_pandas()["window"].nunique() == len(found.windows) and found.trial.name in found._repr_html_()


@pytest.mark.slow
def test_a_calibrated_ship_leaves_as_a_file_and_a_library_ship_only_by_force(folder: Path, tmp_path: Path) -> None:
    assert mmg_ident.export_ship(folder / "run", "toml", tmp_path / "ship.toml") == []
    again = mmg_ident.load_ship(tmp_path / "ship.toml")
    assert again.symbols == mmg_ident.load_ship(folder / "run").symbols
    assert np.array_equal(again.values, mmg_ident.load_ship(folder / "run").values)
    with pytest.raises(mmg_ident.UserError):
        mmg_ident.export_ship("kvlcc2_l7", "toml", tmp_path / "other.toml")
    said = mmg_ident.export_ship("kvlcc2_l7", "toml", tmp_path / "other.toml", force=True)
    assert "uncalibrated" in [note.code for note in said]


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


# What takes long from Python has one thread of linear algebra in every process, as the commands have
CODE = """
import numpy  # before the package, as in a notebook
from threadpoolctl import threadpool_info, threadpool_limits
import {module} as module
threadpool_limits(2)
seen = []
def count(*args, **kwargs):
    seen.append({{row["num_threads"] for row in threadpool_info()}})
    raise RuntimeError("far enough")
setattr(module, {inner!r}, count)
try:
    module.{entry}(*{arguments})
except RuntimeError:
    pass
assert seen == [{{1}}], seen
assert {{row["num_threads"] for row in threadpool_info()}} == {{2}}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "entry", "inner", "arguments"),
    first_quick(
        [
            ("fitting.calibration", "estimate_coefficients", "prepared", "(None, [])"),
            ("diagnosis.diagnose", "diagnose", "parted", "(None, [])"),
            ("residual.pipeline", "train", "_start", "(None, [])"),
        ]
    ),
)
def test_one_thread_from_python(
    module: str, entry: str, inner: str, arguments: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if module.startswith("residual"):
        pytest.importorskip("torch")
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    done = in_python("-c", CODE.format(module=module, entry=entry, inner=inner, arguments=arguments))
    assert done.returncode == 0, done.stderr[-600:]
