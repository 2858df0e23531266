"""What README and docs say to type works, and prints the figures that the page shows."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from mmg.components import catalogue
from mmg.effects import EFFECTS
from mmg.rollout import Simulator
from mmg_ident.commands.main import VERBS, main
from tests.docs.pages import PAGES, ROOT, arguments, blocks, commands, make_workspace, missing
from tests.support.commands import printed
from tests.support.figures import unrendered

LONGEST = (
    "generated.md", "actuators.md", "gallery.md", "model_to_ship.md", "getting_started.md", "diagnosis.md", "mpc.md",
    "tracker.md",
)  # fmt: skip
"""Pages of half a minute to two of processor time whose verbs other pages or tests call as well."""


def by_length(pages: Iterable[Path]) -> list[Any]:
    """The ``pages`` as cases of a test; those that take longest are marked."""
    return [
        pytest.param(page, id=page.name, marks=[pytest.mark.longest] if page.name in LONGEST else []) for page in pages
    ]


PUBLIC_DATA = ("compare",)
"""Verbs that need the public records, which are tested where these are."""
OWN_TRIALS = ("effects.md",)
"""Pages that make the trials that they use."""


def run_page(path: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Run the commands of a page in the working ``folder``; each must work and print what it says."""
    make_workspace(folder, path.name not in OWN_TRIALS)
    for command in commands(path):
        words = arguments(command)
        if words[0] in PUBLIC_DATA:
            continue
        refused = any(line.startswith("mmg: ") for line in command.shown)
        capsys.readouterr()
        code = main(words)
        out, err = capsys.readouterr()
        assert code == (2 if refused else 0) or (words[0] == "fit" and code == 1), (words, err)
        assert not missing(command.shown, err + out), (words, err + out)


@pytest.mark.slow
@pytest.mark.parametrize("path", by_length(p for p in PAGES if commands(p)))
def test_the_commands_of_a_page_work_and_print_what_it_shows(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    run_page(path, tmp_path, capsys)


@pytest.mark.parametrize("path", PAGES, ids=lambda p: p.name)
def test_every_option_that_a_page_names_exists(path: Path) -> None:
    inline = re.findall(r"`(mmg [^`]+)`", re.sub(r"(?ms)^```.*?^```", "", path.read_text()))
    for text in inline:
        words = text.split()[1:]
        if not words[0].islower() or words[0] == "select":
            continue
        verb = words[0].rstrip(",.")
        assert verb in VERBS or verb.startswith("--"), text
        page = printed(*[verb] * (verb in VERBS), "--help")
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*", text):
            assert option in page or option == "--help", text


@pytest.mark.slow
def test_python_of_the_readme_uses_one_import_and_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make_workspace(tmp_path)
    monkeypatch.chdir(tmp_path)
    (code,) = blocks(ROOT / "README.md", "python")
    assert re.findall(r"^(?:import|from) .*", code, re.MULTILINE) == ["import mmg_ident as mi"]
    with unrendered():
        exec(compile(code, "README.md", "exec"), {})
    assert (tmp_path / "runs" / "notebook" / "report.html").exists()
    ratios = re.findall(r"'(position|heading)': (?:np.float64\()?([\d.]+)", capsys.readouterr().out.splitlines()[1])
    assert len(ratios) >= 2 and all(float(ratio) < 1 for _, ratio in ratios[:2])  # to kept velocities


# Links of README, CONTRIBUTING, CHANGELOG and docs lead to files that exist and to headings that they have
def without_code(text: str) -> str:
    return re.sub(r"(?ms)^```.*?^```|`[^`\n]*`", "", text)


def anchors(path: Path) -> set[str]:
    """Anchors of a page: of its headings, as GitHub and MyST make them, and those that are written."""
    text = re.sub(r"(?ms)^```.*?^```", "", path.read_text(encoding="utf-8"))
    made = {re.sub(r"[^\w\- ]", "", h.lower()).strip().replace(" ", "-") for h in re.findall(r"(?m)^#+ (.*)$", text)}
    return made | set(re.findall(r'<a id="([^"]+)">', text))


@pytest.mark.parametrize("path", [*PAGES, *ROOT.glob("C*.md")], ids=lambda p: p.name)
def test_links_of_a_page_lead_somewhere(path: Path) -> None:
    broken = []
    for target, heading in re.findall(r"\]\(([^)#\s]*)#?([^)\s]*)\)", without_code(path.read_text(encoding="utf-8"))):
        page = (path.parent / target) if target else path
        if "://" in target or target.startswith("mailto:"):
            continue
        if not page.exists() or (heading and heading not in anchors(page)):
            broken.append(f"{target}#{heading}")
    assert not broken


def test_every_page_is_led_to_by_the_index() -> None:
    index = ROOT / "docs" / "index.md"
    led_to = {(index.parent / target).resolve() for target in re.findall(r"\]\(([^)#\s]+)", index.read_text())}
    kinds = ("tutorials", "how-to", "reference", "explanation")
    assert [p for p in PAGES if p.parent.name in kinds and p.resolve() not in led_to] == []


@pytest.mark.parametrize("path", [p for p in PAGES if p.parent.parent.name == "docs"], ids=lambda p: p.name)
def test_a_page_begins_with_what_it_answers(path: Path) -> None:
    text = re.sub(r"(?s)\A---\n.*?\n---\n", "", path.read_text(encoding="utf-8")).strip()
    title, answer = text.split("\n")[:3:2]
    assert title.startswith("# ") and answer[:1] not in ("", "#", "|", "*", ":")
    assert not answer.startswith("```") and len(answer) < 200


# Pages that are notebooks run from top to bottom: their cells, without Jupyter
def cells(path: Path) -> list[str]:
    """Code of the cells of a page, without their tags."""
    found = re.findall(r"(?ms)^```\{code-cell\} ipython3\n(.*?)^```", path.read_text(encoding="utf-8"))
    return [re.sub(r"(?m)^:.*\n", "", code) for code in found]


NOTEBOOKS = [path for path in PAGES if cells(path)]


def test_the_notebooks_are_known() -> None:
    assert {path.stem for path in NOTEBOOKS} == {
        "tutorial", "own_ship", "own_force", "mpc", "actuators", "dataframe", "controller", "tracker", "own_network",
        "gallery",
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("path", by_length(NOTEBOOKS))
def test_a_notebook_runs_to_its_end(path: Path, tmp_path: Path) -> None:
    code = "\n\n".join(cells(path))
    if "fmpy" in code and find_spec("fmpy") is None:
        pytest.skip("needs fmpy, which the extras dev and docs bring")
    script = tmp_path / f"{path.stem}.py"
    script.write_text(code, encoding="utf-8")
    environment = {**os.environ, "MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", f"exec(compile(open({str(script)!r}).read(), 'page', 'exec'), globals())"]
    run = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr[-3000:]


# The blocks of the page on refits, optimisers and samplers run, those on what is not installed are skipped
BLOCKS = blocks(ROOT / "docs" / "how-to" / "optimisers.md", "python")


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Names that the first block, and the first on SciPy, leave for all others."""
    folder = tmp_path_factory.mktemp("page")
    make_workspace(folder)
    names: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(Path(folder))
        for code in BLOCKS[:4]:
            exec(compile(code, "optimisers.md", "exec"), names)
    return names


@pytest.mark.slow
@pytest.mark.parametrize("code", BLOCKS[4:], ids=lambda code: code.split("\n")[0].split()[1].rstrip(","))
def test_other_optimisers_and_samplers_work_on_the_objective(code: str, session: dict[str, Any]) -> None:
    for package in re.findall(r"(?m)^(?:from|import) (\w+)", code):
        pytest.importorskip(package, reason=f"needs {package}, which is not required")
    exec(compile(code, "optimisers.md", "exec"), session)


# The walk-through "one file each" works as it is written: an effect, a force model, a ship
EFFECT, FORCE, SHIP = blocks(ROOT / "docs" / "how-to" / "extending.md", "python")
STATE = np.array([[0.0, 0.0, 0.0, 0.3, 0.05, 0.02]]).T


def module_of(code: str, name: str) -> ModuleType:
    module = ModuleType(name)
    exec(compile(code, name, "exec"), module.__dict__)
    return module


def test_an_effect_in_one_file_enters_the_model(monkeypatch: pytest.MonkeyPatch) -> None:
    module = module_of(EFFECT, "sway_scale")
    monkeypatch.setitem(sys.modules, "sway_scale", module)
    effect = module.SwayScale()
    assert effect.summary
    monkeypatch.setitem(EFFECTS, effect.name, effect)
    bare = load_ship("esso_osaka_3m")
    neutral, larger = bare.with_effect(effect.name), bare.with_effect(effect.name, {"share": 0.1})
    logged = [Simulator(ship, compiled=False).columns(STATE)[4, 0] for ship in (bare, neutral, larger)]
    assert logged[0] == logged[1] and np.isclose(logged[2], 1.1 * logged[0])


def test_a_force_model_in_one_file_is_a_choice_of_a_ship(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mmg.components.wind.flat_plate", module_of(FORCE, "flat_plate"))
    monkeypatch.setitem(catalogue.MODELS["wind"], "flat_plate", "wind.flat_plate")
    bare = load_ship("kvlcc2_l7")
    particulars = {**bare.particulars, "A_T": 0.5, "A_L": 1.5, "C": 0.1, "rho_a": 1.2}
    ship = replace(bare, particulars=particulars).with_models(wind="flat_plate")
    simulator = Simulator(ship, compiled=False)
    controls = np.zeros((len(ship.inputs), 1))
    calm = simulator.rates(STATE, controls)
    controls[ship.inputs.index("wind_east")] = 5.0
    assert simulator.rates(STATE, controls)[4, 0] > calm[4, 0]  # wind to the east pushes a ship that heads north


def test_a_ship_in_one_file_turns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    module_of(SHIP, "ship_walk_through")
    assert load_ship("my_ship.toml").coefficients["m_x"].fixed
