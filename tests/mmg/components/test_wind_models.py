"""Blendermann, Isherwood and wave drift: tables, symmetry."""

from __future__ import annotations

from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship, parse_ship
from mmg.components.catalogue import MODELS
from mmg.components.coefficients import names
from mmg.components.waves import drift
from mmg.components.wind import blendermann, isherwood
from mmg.model import assemble
from mmg.motion.flow import Flow
from mmg.motion.smooth import Exact, Smooth, Smoothing
from tests.support.force_numbers import xyn

WIND = (blendermann, isherwood)
TANKER = SimpleNamespace(
    L=320.0, B=58.0, L_OA=325.0, A_T=1100.0, A_L=2900.0, A_SS=600.0, C=-20.0, S_A=420.0, rho_a=1.226
)
PRESSURE = 0.5 * TANKER.rho_a


def values(model: ModuleType) -> SimpleNamespace:
    return names({c.symbol: c.value for c in model.COEFFICIENTS})


def forces(model: ModuleType, speed: float, degrees: float, s: Smoothing | None = None) -> np.ndarray:
    """X, Y, N in an apparent wind of ``speed`` from ``degrees`` counter-clockwise from the bow."""
    angle = np.radians(degrees)
    flow = Flow(u=0.0, v=0.0, r=0.0, a_x=-speed * np.cos(angle), a_y=speed * np.sin(angle))
    return xyn(model.force(flow, TANKER, values(model), s or Exact()))


@pytest.mark.parametrize("model", WIND)
@pytest.mark.parametrize("degrees", [0, 17, 45, 88, 90, 133, 180])
def test_port_and_starboard_wind_mirror(model: ModuleType, degrees: float) -> None:
    for s in (Exact(), Smooth.for_length(320.0)):
        port, starboard = forces(model, 12.0, degrees, s), forces(model, 12.0, -degrees, s)
        np.testing.assert_allclose(starboard, port * [1, -1, -1], rtol=1e-12, atol=1e-6)


@pytest.mark.parametrize("model", WIND)
def test_wind_pushes_to_leeward(model: ModuleType) -> None:
    """Head wind aft, stern wind ahead, wind from port to starboard; centre of the area aft: the bow comes up."""
    assert forces(model, 12.0, 0)[0] < 0 < forces(model, 12.0, 180)[0]
    beam = forces(model, 12.0, 90)
    assert beam[1] > 0 > beam[2]


@pytest.mark.parametrize("model", WIND)
def test_force_grows_with_the_square_of_the_wind(model: ModuleType) -> None:
    np.testing.assert_allclose(forces(model, 14.0, 50), 4 * forces(model, 7.0, 50), rtol=1e-9)


def test_blendermann_oblique_wind_by_hand() -> None:
    """Tanker loaded, 30 deg: CD_l = 0.9 A_T / A_L = 0.3414, D = 1 - 0.2 (1 - 0.3414 / 0.7) 0.75 = 0.92316."""
    X, Y, N = forces(blendermann, 10.0, 30) / (100 * PRESSURE * TANKER.A_L)
    side = 0.7 * 0.5 / 0.92316
    expected = (-0.34138 * 0.866025 / 0.92316, side, side * (-20.0 + 0.18 * np.pi / 3 * 325.0))
    np.testing.assert_allclose((X, Y, N), expected, rtol=1e-4)


def test_unknown_ship_type_names_the_known_ones() -> None:
    with pytest.raises(KeyError, match="tanker loaded"):
        blendermann.coefficients_of("canoe")


def test_smooth_blendermann_agrees_with_the_branches_to_one_percent() -> None:
    for degrees in range(0, 181, 5):
        exact, smooth = (forces(blendermann, 12.0, degrees, s) for s in (Exact(), Smooth.for_length(320.0)))
        scale = PRESSURE * 144 * np.array([TANKER.A_T, TANKER.A_L, TANKER.A_L * TANKER.L_OA])
        np.testing.assert_allclose(smooth / scale, exact / scale, rtol=0, atol=0.01)


@pytest.mark.parametrize(
    ("p", "limits"),
    [
        (TANKER, (0.065, 0.045, 0.095)),
        (SimpleNamespace(L_OA=300, B=40, A_T=1400, A_L=9000, A_SS=7200, C=-6, S_A=450, rho_a=1.2), (0.065, 0.05, 0.07)),
        (SimpleNamespace(L_OA=150, B=25, A_T=600, A_L=3000, A_SS=2100, C=3, S_A=225, rho_a=1.2), (0.10, 0.045, 0.07)),
    ],
)
def test_isherwood_refit_reproduces_the_table_to_the_stated_share(
    p: SimpleNamespace, limits: tuple[float, float, float]
) -> None:
    """Largest deviation at the 19 angles by the largest value of each coefficient."""
    X_f, Y_f, N_f = isherwood.features(p, 1.0)
    table = isherwood.TABLE
    published = (-table[:, 1:8] @ X_f, table[:, 8:15] @ Y_f, table[:, 15:] @ N_f)
    found = []
    for degrees in table[:, 0]:
        a = np.radians(degrees)
        flow = Flow(u=0, v=0, r=0, a_x=-np.cos(a), a_y=np.sin(a))
        units = 0.5 * p.rho_a * np.array([p.A_T, p.A_L, p.A_L * p.L_OA])
        found.append(xyn(isherwood.force(flow, p, values(isherwood), Exact())) / units)
    for name, rows, own, limit in zip("XYN", published, np.array(found).T, limits, strict=True):
        deviation = np.abs(own - rows).max() / np.abs(rows).max()
        assert 0.3 * limit < deviation < limit, (name, deviation)


def test_isherwood_table_row_by_hand() -> None:
    """Head wind on the tanker, the sum written out; 90 deg row as transcribed."""
    row = isherwood.TABLE[0]
    X = 2.152 - 5 * 2 * 2900 / 325**2 + 0.243 * 2 * 1100 / 58**2 - 0.164 * 325 / 58
    assert row[1:8] @ isherwood.features(TANKER, 1.0)[0] == pytest.approx(X, rel=1e-12)
    beam = "90 0.355 0 0 0 -0.247 0 0.018 0.889 0 0.138 0 0 -0.66 0 0.2627 0 0 0 0 -0.508"
    np.testing.assert_array_equal(isherwood.TABLE[9], np.array(beam.split(), dtype=float))
    assert isherwood.TABLE.shape == (19, 21) and (np.diff(isherwood.TABLE[:, 0]) == 10).all()


def drift_forces(psi: float, **changed: float) -> np.ndarray:
    c = names({row.symbol: row.value for row in drift.COEFFICIENTS} | {"H_s": 2.0} | changed)
    return xyn(drift.force(Flow(u=0, v=0, r=0, psi=psi), SimpleNamespace(L=100.0, rho=1025.0), c, Exact()))


def test_waves_push_with_their_direction_and_are_stronger_on_the_side() -> None:
    """Waves coming from north: heading north pushed aft; heading west they come from starboard: pushed to port."""
    head, beam = drift_forces(0.0), drift_forces(-np.pi / 2)
    assert head[0] < 0 and head[1] == pytest.approx(0) and beam[1] < 0 and beam[0] == pytest.approx(0, abs=1e-6)
    assert abs(beam[1]) > 3 * abs(head[0])
    assert beam[1] == pytest.approx(-1025 * 9.80665 * 4 * 100 * 0.06)


def test_waves_mirror_vanish_in_calm_sea_and_turn_beam_on() -> None:
    np.testing.assert_allclose(drift_forces(0.7, C_NW=0.01), drift_forces(-0.7, C_NW=0.01) * [1, -1, -1])
    np.testing.assert_array_equal(drift_forces(0.7, H_s=0.0), 0.0)
    assert drift_forces(-np.pi / 4, C_NW=0.01)[2] < 0  # from the starboard bow: bow to port


@pytest.mark.parametrize("name", ["blendermann", "isherwood"])
def test_models_are_in_the_library_and_steer_a_ship(name: str) -> None:
    """A ship file that names them loads with defaults; a beam wind from starboard drives it to port, waves as well."""
    assert name in MODELS["wind"] and "drift" in MODELS["waves"]
    esso = load_ship("esso_osaka_3m")
    text = "[ship]\n" + "\n".join(f"{k} = {v!r}" for k, v in esso.particulars.items())
    text += '\nL_OA = 3.1\nA_SS = 0.02\nS_A = 4.2\n[model]\nhull = "unified"\nwaves = "drift"\n'
    ship = parse_ship(text + f'wind = "{name}"\n')
    model = assemble(ship, symbols=())
    calm = np.array(model.rates([0] * 6, [0.0, 0.0], [])).ravel()
    blown = np.array(model.rates([0] * 6, [0.0, -3.0], [])).ravel()
    np.testing.assert_allclose(calm[3:], 0.0, atol=1e-12)
    assert blown[4] < -1e-4
    c = ship.coefficients
    rough = ship.with_coefficients({"H_s": c["H_s"].with_(value=0.05), "chi_W": c["chi_W"].with_(value=np.pi / 2)})
    assert np.array(assemble(rough, symbols=()).rates([0] * 6, [0.0, 0.0], [])).ravel()[4] < -1e-3
