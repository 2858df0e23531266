"""The demo: an effect that matters is named, a residual kept and one declined, and nothing false is said."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cases.simulation.demo_trials import CURRENT, SHIP, hidden_ship, share_of_truth
from diagnosis.diagnose import DiagnosisOptions, diagnose
from mmg_ident import calibrate
from mmg_ident.commands.demo import STEP, campaign
from mmg_ident.commands.main import main
from tests.support.quick import first_quick

pytestmark = pytest.mark.usefixtures("blank_figures")


def test_the_truth_lies_in_its_own_intervals() -> None:
    table = hidden_ship().coefficients
    own = {s: c.with_(prior_value=c.value, prior_std=c.std) for s, c in table.items()}
    assert share_of_truth(hidden_ship().with_coefficients(own)) == 1.0
    away = own["N_r"].with_(value=own["N_r"].value + 3 * own["N_r"].std)
    found = share_of_truth(hidden_ship().with_coefficients({**own, "N_r": away}))
    assert found == pytest.approx(1 - 1 / len(own))


@pytest.mark.slow
@pytest.mark.parametrize("seed", first_quick(range(1, 5), pytest.mark.longest))
def test_the_demo_says_nothing_false_of_a_hidden_current(seed: int, tmp_path: Path) -> None:
    """With hardly any random force every rounding is significant."""
    trials = campaign(tmp_path / "trials", seed, every=2)
    fit = calibrate(SHIP, *trials, seed=seed)
    later, tests = campaign(tmp_path / "second", seed + 1000, CURRENT, every=4)
    options = DiagnosisOptions(step=STEP, seed=seed)
    found = diagnose(fit.ship, later, tests, options=options, calibrated_on=trials[0])
    assert [e.name for e in found.effects] == ["current"] and found.verdict == "named"
    (current,) = found.effects
    assert not found.remainder and found.equivalence_class == () and found.instruments == ()
    for symbol, truth in (("x", 0.08), ("y", -0.05)):
        assert current.parameters[symbol].value == pytest.approx(truth, abs=1e-3)
    assert found.held_out is not None and found.held_out.reduction > 0.95
    codes = {row["code"] for row in found.to_dict()["messages"]}
    false = {"far_from_prior", "ordered_forces", "oscillating_residuals", "coarse_samples"}
    assert not codes & false


@pytest.mark.slow
def test_the_demo_names_what_matters_and_keeps_one_residual_of_two(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "demo"
    assert main(["demo", "--out", str(folder), "--json"]) == 0
    printed = capsys.readouterr()
    found = json.loads(printed.out)
    assert found["diagnosis"]["verdict"] == "named"
    assert [e["name"] for e in found["diagnosis"]["effects"]] == ["current"]
    assert found["diagnosis"]["held_out"]["reduction"] > 0.5
    assert not found["residual"]["kept"] and found["third_residual"]["kept"]
    pair = found["third_residual"]["scores"]["validation"]
    assert pair["after"]["window"] < 0.9 * pair["before"]["window"]
    assert [int(line.split()[0]) for line in printed.err.splitlines()] == list(range(1, 13))
    assert [p.parent.name for p in folder.rglob("report.html")] == ["run"]
