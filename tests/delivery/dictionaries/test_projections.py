"""The ship in the parameter sets of other simulators: as good as printed, or refused with the reason."""

from __future__ import annotations

import ast
import importlib.util
import json
import math
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest

from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from delivery.dictionaries import gazebo, shipmmg, vehicle_simulator
from delivery.dictionaries.projection import ChannelError, Motions, motions
from delivery.export import FORMATS, export
from fitting.selection.candidates import candidate
from mmg.components.rigid_body import accelerations
from mmg.effects import EFFECTS
from mmg.errors import Unsupported, UserError
from mmg.motion.flow import Force
from mmg.runge_kutta import rk4_step
from mmg.ship import Ship
from tests.support.c_products import product

SHIPS = ("esso_osaka_3m", "kvlcc2_l7")


@cache
def moved(name: str) -> Motions:
    return motions(product(load_ship(name), {}), "a simulator")


def at(m: Motions, *values: float) -> Motions:
    """One motion in place of those of ``m``: u, v, r, n, delta."""
    names = ("u", "v", "r", "n", "delta")
    return replace(m, **{name: np.array([x]) for name, x in zip(names, values, strict=True)})


@cache
def exported(name: str, form: str) -> Path:
    """The ship of the library ``name`` in a ``form``, written once."""
    path = Path(mkdtemp(prefix="projection")) / f"ship{FORMATS[form].suffix}"
    export(product(load_ship(name), {}), form, path)
    return path


@cache
def parameters(name: str) -> tuple[dict[str, float], tuple[ChannelError, ...]]:
    return shipmmg.project(moved(name))


def of_shipmmg() -> Ship:
    """A ship of the very form of shipmmg: wake of Kijima, centre of gravity at midship."""
    text = dump_ship(load_ship("kvlcc2_l7")).replace('propeller = "standard"', 'propeller = "standard_kijima"')
    kept = [block for block in text.split("\n\n") if not block.startswith("[coefficients.C_")]
    return parse_ship("\n\n".join(kept).replace("x_G = 0.245", "x_G = 0.0"))


def test_a_ship_of_the_form_of_shipmmg_is_recovered() -> None:
    ship = of_shipmmg()
    assert ship.components["propeller"] == "standard_kijima" and ship.particulars["x_G"] == 0.0
    p, errors = shipmmg.project(motions(product(ship, {}), "shipmmg"))
    assert max(e.share for e in errors) < 0.01
    for symbol in ("N_r", "Y_v"):
        assert p[symbol] == pytest.approx(ship.coefficients[symbol].value, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPS)
def test_projections_are_as_good_as_they_say(name: str) -> None:
    """The errors in the file are those of forces evaluated afresh on other motions of the same range."""
    content = json.loads(exported(name, "shipmmg").read_text(encoding="utf-8"))
    assert all(row["share"] < 0.08 for row in content["projection"])
    other = motions(product(load_ship(name), {}), "shipmmg", seed=5)
    p, errors = parameters(name)
    off = shipmmg.force(other, p) - other.needed_force()
    for e, row in zip(errors, off, strict=True):
        assert np.sqrt(np.mean(row**2)) < 1.5 * e.error, e.channel


def test_shipmmg_itself_moves_as_the_projection_says() -> None:
    package = pytest.importorskip("shipmmg.mmg_3dof", reason="needs shipmmg (pip install shipmmg, Python 3.11)")
    content = json.loads(exported("kvlcc2_l7", "shipmmg").read_text(encoding="utf-8"))
    p, _ = parameters("kvlcc2_l7")
    n, u, delta = 10.0, 1.0, math.radians(35)
    t, z, dt = np.linspace(0, 60.0, 601), np.array([0.0, 0.0, 0.0, u, 0.0, 0.0]), 0.1

    def derivative(state: np.ndarray, _: float) -> np.ndarray:
        c, s = math.cos(state[2]), math.sin(state[2])
        moving = [state[3] * c - state[4] * s, state[3] * s + state[4] * c, state[5]]
        one = at(moved("kvlcc2_l7"), *state[3:], n, delta)
        return np.concatenate([moving, accelerations(*state[3:], Force(*shipmmg.force(one, p)[:, 0]), one.mass)])

    for _ in t[1:]:
        z = rk4_step(derivative, z, dt)
    found = package.simulate_mmg_3dof(
        package.Mmg3DofBasicParams(**content["basic_params"]),
        package.Mmg3DofManeuveringParams(**content["maneuvering_params"]),
        t, np.full(601, delta), np.full(601, n), u0=u, ρ=content["rho"], rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    assert np.allclose(found.y[[3, 4, 5, 0, 1, 2], -1], z, rtol=1e-5, atol=1e-6)


@pytest.mark.slow
def test_no_name_of_a_ship_ends_the_words_about_it(tmp_path: Path) -> None:
    name = 'A""" + print(1) + """ -- of "B"'
    named = replace(product(replace(load_ship("esso_osaka_3m"), name=name), {}), identifier="a")
    export(named, "pvs", tmp_path / "vehicle.py")
    tree = ast.parse((tmp_path / "vehicle.py").read_text(encoding="utf-8"))
    assert ast.get_docstring(tree).startswith("A''' + print(1)")
    assert any(isinstance(x, ast.Constant) and str(x.value).startswith(name) for x in ast.walk(tree))
    export(named, "gazebo", tmp_path / "hull.sdf")
    text = (tmp_path / "hull.sdf").read_text(encoding="utf-8")
    assert ET.fromstring(text).tag == "sdf" and "- - of" in text.splitlines()[1]


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPS)
def test_the_vehicle_class_has_the_rates_of_the_projection(name: str) -> None:
    spec = importlib.util.spec_from_file_location("vehicle", exported(name, "pvs"))
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    vehicle = getattr(module, name)("headingAutopilot", 20.0)
    p, errors = vehicle_simulator.project(moved(name))
    inertia = moved(name).ship.particulars["L"] * np.array([p["m11"], p["m22"], p["m33"]])
    inertia[2] *= moved(name).ship.particulars["L"]
    for u, v, r, n, delta in ((1.0, 0.0, 0.0, 8.0, 0.1), (0.8, -0.1, 0.02, 10.0, 0.5), (0.5, 0.05, -0.03, 6.0, -0.6)):
        expected = vehicle_simulator.form(at(moved(name), u, v, r, n, delta), p)[:, 0] / inertia
        assert np.allclose(vehicle.accelerations(u, v, r, delta, n), expected, rtol=1e-9)
    assert max(e.share for e in errors) < 0.3
    eta, nu, actual, h = np.zeros(6), vehicle.nu, vehicle.u_actual, 0.2
    for _ in range(3000):
        control = vehicle.headingAutopilot(eta, nu, h)
        nu, actual = vehicle.dynamics(eta, nu, actual, control, h)
        eta = eta + h * np.array([0, 0, 0, 0, 0, nu[5]])
    assert abs(math.degrees(eta[5]) - 20) < 1.5 and vehicle.dimU == len(actual) == len(vehicle.controls)


def in_simulator(path: Path, m: Motions) -> np.ndarray:
    """Accelerations u', v', r' (3, M) that a rigid body in axes forward, port, up has with the plugin of a file, as the
    sources of the plugins say, driven by the propeller and rudder of the ship."""
    link = ET.parse(path).getroot().find("model/link/inertial")
    plugin = ET.parse(path).getroot().find("model/plugin")
    assert link is not None and plugin is not None
    mass, izz, x_G = (float(link.findtext(key, "").split()[0]) for key in ("mass", "inertia/izz", "pose"))
    value = {row.tag: float(row.text or 0) for row in plugin if row.tag[0] in "xyn" and row.tag != "disable_coriolis"}
    nu = {"U": m.u, "V": -m.v, "R": -m.r}
    drive = (m.forces["propeller"] + m.forces["rudder"]) * np.array([1, -1, -1])[:, None]
    force, rows = [*drive], "xyn"
    for name, factor in value.items():
        row, rest = rows.index(name[0]), name[1:]
        if rest.startswith("Dot"):
            continue
        other = nu[rest[-1]] if rest[1:] else 1.0
        force[row] = force[row] + factor * nu[rest[0]] * (np.abs(other) if "abs" in rest else other)
    u, v, r = nu["U"], nu["V"], nu["R"]
    added = [-value[key] for key in ("xDotU", "yDotV", "nDotR")]
    du = (force[0] + mass * v * r + mass * x_G * r**2) / (mass + added[0])
    a = np.array([[mass + added[1], mass * x_G], [mass * x_G, izz + mass * x_G**2 + added[2]]])
    b = np.array([force[1] - mass * u * r, force[2] - mass * x_G * u * r])
    dv, dr = np.linalg.solve(a, b)
    return np.array([du, -dv, -dr])


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPS)
def test_a_plugin_moves_the_hull_as_well_as_it_says(name: str) -> None:
    m = moved(name)
    mass = m.mass
    off = in_simulator(exported(name, "gazebo"), m) - m.rates
    _, errors = gazebo.project(m)
    X = (mass.m + mass.m_x) * off[0]
    Y = (mass.m + mass.m_y) * off[1] + mass.moment * off[2]
    N = mass.I_z * off[2] + mass.moment * off[1]
    for row, e in zip((X, Y, N), errors, strict=True):
        assert np.isclose(np.sqrt(np.mean(row**2)), e.error, rtol=1e-6), e.channel
    assert max(e.share for e in errors) < 0.12


def given_ship(name: str) -> Ship:
    """A ship of the library, one of generated terms, or one with the effect of this name."""
    esso = load_ship("esso_osaka_3m")
    if name == "generated":
        return candidate(esso, "sm2-order2").ship
    return esso.with_effect(name) if name in EFFECTS else load_ship(name)


@pytest.mark.parametrize(
    ("ship", "form", "words"),
    [
        *(("mariner", form, "propeller") for form in ("shipmmg", "pvs", "gazebo")),
        ("vectwin_3m", "shipmmg", "delta_port, delta_starboard"),
        *(("generated", form, form) for form in ("shipmmg", "pvs", "gazebo")),
        *((name, "shipmmg", f"{name}.*surroundings.*--without {name}") for name in ("current", "bank")),
        ("rudder_lag", "shipmmg", "rudder_lag.*remembers.*--without rudder_lag"),
    ],
)
def test_what_a_target_cannot_hold_is_refused_with_the_reason(ship: str, form: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=words if ship != "generated" else None) as error:
        export(product(given_ship(ship), {}), form, tmp_path / f"x{FORMATS[form].suffix}")
    assert error.value.code in ("unsupported", "missing") and list(tmp_path.iterdir()) == []


def test_effects_of_the_forces_and_of_the_instruments_are_held_or_left_out() -> None:
    ship = load_ship("esso_osaka_3m").with_effect("fouling", {"share": 0.3}).with_effect("log_scale", {"share": 0.1})
    found = motions(product(ship, {}), "a simulator")
    assert "log_scale" in found.left_out[0] and "fouling" in found.left_out[1]
    assert found.forces["hull"][0].mean() < 1.1 * moved("esso_osaka_3m").forces["hull"][0].mean() < 0


def test_motions_stay_in_the_range_of_the_trials() -> None:
    held = {"n": (6.0, 9.0), "delta": (-0.35, 0.35), "u": (0.2, 0.4), "r": (-0.03, 0.03)}
    found = motions(product(load_ship("esso_osaka_3m"), held), "a simulator")
    for name, (low, high) in held.items():
        margin = 0.03 * (high - low)
        assert low - margin <= found.limits[name][0] <= found.limits[name][1] <= high + margin, name
    nowhere = {"u": (-0.3, -0.1), "n": (-9.0, -5.0)}
    with pytest.raises(Unsupported):
        motions(product(load_ship("esso_osaka_3m"), nowhere), "a simulator")
