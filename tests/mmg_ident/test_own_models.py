"""A function of a user is a force model or an effect as one of the library is: fitted, diagnosed, exported, saved."""

from __future__ import annotations

import copy
import json
import math
import pickle
import re
import sys
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import mmg_ident as mi
from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.ship_file import dump_ship, dump_ship_json, parse_ship
from delivery.c.source import c_files
from delivery.fmi.write import write_fmu
from diagnosis.estimation.candidates import find, ship_with_all_effects
from diagnosis.inputs import DiagnosisOptions
from fitting.calibrate import FitOptions
from fitting.parallel import run_all
from mmg.components import own
from mmg.components.catalogue import MODELS, actuators, module, summary
from mmg.components.hull import unified
from mmg.components.rudder import single
from mmg.effects import EFFECTS
from mmg.errors import BadValue, Conflict, Unsupported
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.c_products import product
from tests.support.calibrated import FREE

SHIP = mi.load_ship("esso_osaka_3m")
STATE = np.array([0.0, 0.0, 0.3, 0.4, 0.05, 0.04])
DRAG = mi.Coefficient("X_uu", 0.02, 0.01, 0.0, 0.1, prime="mmg", description="resistance")


def controls(ship: Ship) -> dict[str, float]:
    return {name: 9.0 if name.startswith("n") else 0.2 for name in ship.actuators}


@pytest.fixture(autouse=True)
def as_before(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What a test registers is forgotten after it."""
    kept = {role: dict(models) for role, models in MODELS.items()}
    effects = dict(EFFECTS.data)  # type: ignore[attr-defined]
    yield
    for role, models in kept.items():
        MODELS[role].clear()
        MODELS[role].update(models)
    for name in set(EFFECTS) - set(effects):
        del EFFECTS[name]


def notebook_hull(flow: Any, p: Any, c: Any, s: Any) -> tuple[Any, Any, Any]:
    """Notebook hull: the unified low-speed hull under another name."""
    force = unified.force(flow, p, c, s)
    return force.X, force.Y, force.N


def drag(flow: Any, p: Any, c: Any, s: Any) -> tuple[Any, float, float]:
    """Drag: X = -1/2 rho L d X_uu u |u|."""
    return -0.5 * p.rho * p.L * p.d * c.X_uu * flow.u * s.absolute(flow.u, s.speed), 0.0, 0.0


def lift(parts: Any, flow: Any, e: Any, at: Any) -> tuple[float, Any, float]:
    """Skeg lift: a side force that grows with the drift."""
    return 0.0, -e.size * flow.u * flow.v, 0.0


LIFT = ("size", 0.0, 20.0, -500.0, 500.0, "kg/m", "side force by u v")


def with_notebook_hull() -> Ship:
    mi.force(role="hull", coefficients=unified.COEFFICIENTS)(notebook_hull)
    return SHIP.with_models(hull="notebook_hull")


def few(ship: Ship) -> Ship:
    return ship.fixing([s for s in ship.symbols if s not in (*FREE, "lift.size")])


@cache
def trial() -> mi.Trial:
    return mi.simulate(SHIP.with_values(N_r=-0.06), "zigzag:20/20", duration=90.0, dt=0.5, noise=True)


TOKEN = re.compile(r'(?m)^#define FMU_TOKEN .*$|"\{[0-9a-f-]{36}\}"')
"""What an FMU is told from others by: a hash of its ship, the name of the force model included."""
QUICK = FitOptions(next_trial=False, instruments=())


@pytest.mark.slow
def test_fitted_and_exported_it_equals_the_model_of_the_library_that_it_repeats(tmp_path: Path) -> None:
    """Coefficients and standard errors to 1e-12; source of C and FMU to the last character."""
    one, other = (mi.calibrate(few(ship), [trial()], options=QUICK) for ship in (SHIP, with_notebook_hull()))
    assert other.ship.components["hull"] == "notebook_hull" and other.converged
    for name in FREE:
        a, b = one.ship.coefficients[name], other.ship.coefficients[name]
        assert a.value != SHIP.coefficients[name].value or name == "Y_A1"  # there is no wind
        assert (b.value, b.std) == (pytest.approx(a.value, rel=1e-12), pytest.approx(a.std, rel=1e-12))
    # the last digits of a fit are those of its solver, so that sources are compared at equal values
    same = other.ship.with_values(dict(zip(one.ship.symbols, one.ship.values.tolist(), strict=True)))
    sources = []
    for ship in (one.ship, same):
        files = c_files(product(ship))
        write_fmu(product(ship), tmp_path / "ship.fmu", 3, ["none"], replace=True)
        with zipfile.ZipFile(tmp_path / "ship.fmu") as archive:
            codes = [name for name in archive.namelist() if name.endswith((".c", ".h"))]
            files |= {name: TOKEN.sub("", archive.read(name).decode()) for name in codes}
        sources.append({name: text.replace("notebook_hull", "unified") for name, text in files.items()})
    assert sources[0] == sources[1] and any("sources" in name for name in sources[0])


@pytest.mark.slow
def test_diagnosed_it_equals_the_model_of_the_library_that_it_repeats() -> None:
    run = mi.simulate(SHIP, "zigzag:20/20", effects=["current:x=0.05"], duration=90.0, dt=0.5, noise=True)
    found = [mi.diagnose(few(ship), [run], options=DiagnosisOptions(step=1.0)) for ship in (SHIP, with_notebook_hull())]
    assert found[1].verdict == found[0].verdict
    for a, b in zip(found[0].candidates, found[1].candidates, strict=True):
        assert (a.name, a.score, a.delta_bic) == (b.name, *(approximately(x) for x in (b.score, b.delta_bic)))


def approximately(x: float | None) -> Any:
    return x if x is None else pytest.approx(x, rel=1e-12, nan_ok=True)


def test_it_answers_as_a_module_of_the_library() -> None:
    """Particulars and actuators are those that it reads; the docstring is what reports say."""
    mi.force(role="hull", coefficients=unified.COEFFICIENTS)(notebook_hull)
    mi.force(role="rudder", coefficients=single.COEFFICIENTS, name="my_rudder")(single.force)
    hull, rudder = module("hull", "notebook_hull"), module("rudder", "my_rudder")
    assert set(hull.PARTICULARS) == set(unified.PARTICULARS) and hull.INPUTS == ()
    assert set(rudder.PARTICULARS) <= set(single.PARTICULARS)
    chosen = {"hull": "notebook_hull", "propeller": "standard", "rudder": "my_rudder"}
    assert actuators(chosen, {}) == ("n", "delta")
    assert summary("hull", "notebook_hull").startswith("Notebook hull")
    ship = SHIP.with_models(
        hull="notebook_hull", rudder="my_rudder" if SHIP.components["rudder"] == "single" else "vectwin"
    )
    np.testing.assert_allclose(ship.rhs(STATE, controls(ship)), SHIP.rhs(STATE, controls(SHIP)), rtol=1e-12)


def test_a_two_screw_ship_and_further_roles_take_own_models() -> None:
    """A wind force and a propeller with its slipstream, mirrored to both sides."""

    @mi.force(role="wind", coefficients=[("C_wind", 0.7, 0.2, 0.1, 1.5, "", "resistance")])
    def plate(flow: Any, p: Any, c: Any, s: Any) -> mi.Force:
        return mi.Force(0.5 * p.rho_a * p.A_T * c.C_wind * flow.a_x * s.root(flow.a_x**2 + flow.a_y**2, s.speed))

    @mi.force(role="propeller", coefficients=[("k_T", 0.3, 0.1, 0.0, 1.0, "", "thrust")])
    def jet(flow: Any, p: Any, c: Any, s: Any) -> mi.Force:
        load = c.k_T * flow.n * s.absolute(flow.n, 0.1) * p.D_P**2
        return mi.Force(p.rho * p.D_P**2 * load, slipstream=mi.Slipstream(1.0, flow.u, load, s.step(flow.n, 0.1)))

    twin = mi.new_ship("twin", {"L": 3.0, "B": 0.5, "d": 0.17, "C_b": 0.6, "y_P": 0.12, "D_P": 0.07, "U_0": 1.0})
    ship = replace(twin, particulars={**twin.particulars, "A_T": 0.1, "rho_a": 1.2}).with_models(
        wind="plate", propeller="jet"
    )
    assert ship.actuators == twin.actuators and ship.feels_wind
    both, starboard = ({"n": 9.0, "n_2": n, "delta_port": 0.0, "delta_starboard": 0.0} for n in (9.0, 0.0))
    ahead = np.array([0.0, 0.0, 0.0, 0.4, 0.0, 0.0])
    assert abs(ship.rhs(ahead, both)[5]) < 1e-12 and ship.rhs(ahead, starboard)[5] < -1e-4


def test_an_own_effect_is_simulated_and_put_on_a_ship() -> None:
    mi.effect(enters="force", parameters=[LIFT])(lift)
    bare, lifted = (mi.simulate(SHIP, "turning:35", effects=e, duration=60.0, dt=1.0) for e in ([], ["lift:size=60"]))
    assert abs(lifted["v"][-1]) < abs(bare["v"][-1])
    free = freeing_effects(SHIP, ["lift"]).coefficients["lift.size"]
    assert (free.value, free.fixed, free.unit) == (0.0, False, "kg/m")
    assert EFFECTS["lift"].summary.startswith("Skeg lift") and list(EFFECTS)[-1] == "lift"
    assert find(ship_with_all_effects(SHIP).candidates, "lift").symbols == ("lift.size",)


@pytest.mark.slow
def test_an_own_effect_is_freed_by_a_fit_and_named_by_a_diagnosis() -> None:
    mi.effect(enters="force", parameters=[LIFT])(lift)
    runs = [("zigzag:20/20", 0), ("turning:30", 1)]
    trials = [
        mi.simulate(SHIP, m, effects=["lift:size=90"], duration=120.0, dt=0.5, noise=True, seed=k) for m, k in runs
    ]
    known = SHIP.fixing([s for s in SHIP.symbols if s not in ("X_0F", "k_0")])
    found = mi.diagnose(known, trials, options=DiagnosisOptions(step=1.0))
    assert [e.name for e in found.effects] == ["lift"]
    fit = mi.calibrate(freeing_effects(known, ["lift"]), trials, options=QUICK)
    size = fit.ship.coefficients["lift.size"]
    assert abs(size.value - 90.0) < 4 * size.std < 45.0


def test_a_measurement_is_one_hook_as_well() -> None:
    @mi.effect(enters="measurement", parameters=[("share", 0.0, 0.05, -0.5, 0.5, "", "v too large by this share")])
    def sway_scale(y: Any, flow: Any, memory: Any, e: Any, p: Any) -> list[Any]:
        return [*y[:4], y[4] * (1 + e.share), y[5]]

    logged = [
        Simulator(s, compiled=False).columns(STATE[:, None])[4, 0]
        for s in (SHIP, SHIP.with_effect("sway_scale", share=0.1))
    ]
    assert logged[1] == pytest.approx(1.1 * logged[0]) and EFFECTS["sway_scale"].measures


@pytest.mark.slow
def test_a_function_that_is_defined_again_is_the_one_that_counts() -> None:
    """Also for what was compiled or assembled of the one before: caches go by its body."""

    def cell(factor: float) -> Callable[..., Any]:
        @mi.force(role="hull", coefficients=[DRAG])
        def mine(flow: Any, p: Any, c: Any, s: Any) -> tuple[Any, float, float]:
            return -factor * c.X_uu * flow.u, 0.0, 0.0

        return mine

    surge = []
    cell(100.0)
    ship = SHIP.with_models(hull="mine")
    for factor in (100.0, 300.0):
        cell(factor)
        turn = mi.simulate(ship, "turning:35", duration=20.0, dt=1.0)
        surge.append((ship.rhs(STATE, controls(ship))[3], turn["u"][-1]))
    m = SHIP.particulars["m"]
    assert surge[1][0] < surge[0][0] - 0.5 * 200 * DRAG.value * STATE[3] / m
    assert surge[1][1] < surge[0][1]


def test_a_saved_ship_names_it_and_says_where_it_is_from_when_it_is_missing() -> None:
    ship = with_notebook_hull()
    mi.effect(enters="force", parameters=[LIFT])(lift)
    ship = ship.with_effect("lift", size=3.0)
    text, content = dump_ship(ship), dump_ship_json(ship)
    assert parse_ship(text).with_values() == replace(ship, notices=parse_ship(text).notices)
    del MODELS["hull"]["notebook_hull"], EFFECTS["lift"]
    with pytest.raises(mi.UserError) as caught:
        parse_ship(text, "here.toml")
    line = str(caught.value)
    assert "\n" not in line
    for word in ("here.toml", "notebook_hull", "@mi.force", "lift", "@mi.effect", "test_own_models.py"):
        assert word in line
    assert json.loads(content)["model"]["registered"].keys() == {"notebook_hull", "lift"}
    plug_in = text.replace("test_own_models.py", "the plug-in sails 1.2")
    with pytest.raises(BadValue, match=r"sails 1\.2"):
        parse_ship(plug_in)


SAILS = """
import mmg_ident as mi

@mi.force(role="hull", coefficients=[("X_u", 1.0, 0.1, 0.0, 9.0, "kg/s", "drag")])
def sails_hull(flow, p, c, s):
    return -c.X_u * flow.u, 0.0, 0.0
"""


def test_a_plug_in_is_loaded_when_its_name_is_looked_up(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    (tmp_path / "sails.py").write_text(SAILS, encoding="utf-8")
    entries = [EntryPoint("sails", "sails", own.GROUP), EntryPoint("broken", "no_such_module_at_all", own.GROUP)]
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(own, "loading", [])
    monkeypatch.setattr(own, "entry_points", lambda group: entries if group == own.GROUP else [])
    ship = SHIP.with_models(hull="sails_hull")
    assert ship.coefficients["X_u"].unit == "kg/s" and module("hull", "sails_hull").origin.split()[-1] == "sails"
    with pytest.raises(mi.UserError, match="sails_hull"):
        SHIP.with_models(hull="sail_hull")
    assert "no_such_module_at_all" in caplog.text


def surge_rate(ship: Ship) -> float:
    return float(ship.rhs(STATE, controls(ship))[3])


@pytest.mark.slow
def test_copies_and_other_processes_have_the_same_model() -> None:
    """By its name where it can be imported, by its code where it is of a notebook."""
    drag_factor = 3.0

    @mi.force(role="hull", coefficients=[DRAG])
    def local(flow: Any, p: Any, c: Any, s: Any) -> tuple[Any, Any, Any]:
        return tuple(drag_factor * each for each in drag(flow, p, c, s))  # type: ignore[return-value]

    ships = [with_notebook_hull(), SHIP.with_models(hull="local").with_values(X_uu=0.03)]
    for ship in ships:
        assert copy.deepcopy(ship) == ship and pickle.loads(pickle.dumps(ship)) == ship
    assert run_all(surge_rate, ships, workers=2) == [surge_rate(ship) for ship in ships]


def test_without_cloudpickle_a_model_of_a_notebook_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    @mi.force(role="hull", coefficients=[DRAG])
    def local(flow: Any, p: Any, c: Any, s: Any) -> tuple[Any, Any, Any]:
        return drag(flow, p, c, s)

    monkeypatch.setitem(sys.modules, "cloudpickle", None)
    ships = [SHIP.with_models(hull="local")] * 2
    with pytest.raises(Unsupported, match=r"local.*cloudpickle"):
        run_all(surge_rate, ships, workers=2)


GOOD: dict[str, Any] = {"role": "hull", "coefficients": [DRAG]}
EFFECT: dict[str, Any] = {"enters": "force", "parameters": [LIFT]}


def fails(*_: Any) -> Any:
    raise ZeroDivisionError("by zero")


WRONG_COEFFICIENTS: list[Any] = [
    [], [DRAG, DRAG], [DRAG.with_(value=0.2)], [DRAG.with_(std=math.nan)], [DRAG.with_(symbol="X uu")],
    [DRAG.with_(symbol="m_x"), DRAG], [DRAG, DRAG.with_(symbol="k_0")], [("X_uu", 0.02, 0.01)],
    [DRAG.with_(prime="bis")], 3,
]  # fmt: skip
WRONG_PARAMETERS: list[Any] = [
    [], [LIFT, LIFT], [("size", 0.0, 0.0, -1.0, 1.0, "", "")], [("size", 3.0, 1.0, -1.0, 1.0, "", "")]
]  # fmt: skip
WRONG_FORCES: list[tuple[dict[str, Any], Any, str]] = [
    ({"role": "hul"}, drag, "role"),
    ({"role": "expansion"}, drag, "role"),
    *(({"coefficients": rows}, drag, "coefficients") for rows in WRONG_COEFFICIENTS),
    *(({"name": name}, drag, "name") for name in ("unified", "../x", "a.b")),
    ({}, 3, "function"),
    ({}, lambda flow, p, c: (0.0, 0.0, 0.0), "function"),
    ({}, lambda flow, p, c, s: (flow.u, flow.v), "2 values"),
    ({}, lambda flow, p, c, s: flow.u, "1 values"),
    ({}, lambda flow, p, c, s: None, "NoneType"),
    ({}, lambda flow, p, c, s: (flow.u, "v", 0.0), "str"),
    ({}, lambda flow, p, c, s: (ca.vertcat(flow.u, flow.v), 0.0, 0.0), "X"),
    ({}, lambda flow, p, c, s: (math.sin(flow.u), 0.0, 0.0), "function"),
    ({}, lambda flow, p, c, s: (p.Lpp * flow.u, 0.0, 0.0), "p.Lpp"),
    ({}, lambda flow, p, c, s: (flow.speed, 0.0, 0.0), "speed"),
    ({}, lambda flow, p, c, s: (ca.sqrt(flow.u**2 + flow.v**2), 0.0, 0.0), "at rest"),
    ({}, lambda flow, p, c, s: (flow.v / flow.u, 0.0, 0.0), "at rest"),
    ({}, fails, "ZeroDivisionError"),
    ({"role": "propeller"}, drag, "Slipstream"),
]
WRONG_EFFECTS: list[tuple[dict[str, Any], Any, str]] = [
    ({"enters": "forces"}, lift, "enters"),
    *(({"parameters": rows}, lift, "parameters") for rows in WRONG_PARAMETERS),
    ({"needs": ["sail"]}, lift, "needs"),
    ({"name": "current"}, lift, "name"),
    ({}, lambda parts, flow, e, at: (flow.u, 0.0), "2 values"),
    ({}, lambda parts, flow, e, at: (flow.u, 0.0, 0.0), "neutral"),
    ({}, lambda parts, flow, e, at: (e.length * flow.u, 0.0, 0.0), "function"),
    ({}, lambda parts, flow, e, at: (e.size * ca.sqrt(flow.u), 0.0, 0.0), "at rest"),
    ({"enters": "inflow"}, lambda flow, e: (e.size, 0.0), "function"),
]


@pytest.mark.parametrize(
    ("decorator", "given", "changed", "function", "word"),
    [*((mi.force, GOOD, *row) for row in WRONG_FORCES), *((mi.effect, EFFECT, *row) for row in WRONG_EFFECTS)],
)
def test_a_force_model_or_effect_that_cannot_be_is_refused(
    decorator: Any, given: dict[str, Any], changed: dict[str, Any], function: Any, word: str
) -> None:
    before = {role: set(models) for role, models in MODELS.items()}, set(EFFECTS)
    with pytest.raises(mi.UserError) as caught:
        decorator(**{**given, "name": "mine", **changed})(function)
    assert word in str(caught.value) and "\n" not in str(caught.value)
    assert ({role: set(models) for role, models in MODELS.items()}, set(EFFECTS)) == before


def test_the_name_of_another_function_is_taken() -> None:
    mi.force(**GOOD, name="mine")(drag)
    mi.force(**GOOD, name="mine")(drag)
    with pytest.raises(Conflict, match="mine"):
        mi.force(**GOOD, name="mine")(lambda flow, p, c, s: (0.0, 0.0, 0.0))


def test_a_particular_that_lacks_and_a_role_that_is_none_are_said() -> None:
    mi.force(role="hull", coefficients=[DRAG], name="mine")(lambda flow, p, c, s: (-c.X_uu * p.S_A * flow.u, 0.0, 0.0))
    for chosen, word in (({"hull": "mine"}, "S_A"), ({"hul": "mine"}, "role")):
        with pytest.raises(mi.UserError, match=word):
            SHIP.with_models(**chosen)
