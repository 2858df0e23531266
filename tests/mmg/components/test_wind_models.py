"""Blendermann, Isherwood and wave drift: tables, symmetry."""

from __future__ import annotations

from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from mmg.components.coefficients import names
from mmg.components.waves import drift
from mmg.components.wind import blendermann, isherwood
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


# Wind: Blendermann (1994), the table that the Marine Systems Simulator prints; mean values where it gives a range

LOADING = """
car carrier                          | 0.95 0.55  0.60  0.80 1.2
cargo vessel loaded                  | 0.85 0.65  0.55  0.40 1.7
cargo vessel with containers on deck | 0.85 0.55  0.50  0.40 1.4
container ship loaded                | 0.90 0.55  0.55  0.40 1.4
destroyer                            | 0.85 0.60  0.65  0.65 1.1
diving support vessel                | 0.90 0.60  0.80  0.55 1.7
drilling vessel                      | 1.00 0.85  0.925 0.10 1.7
ferry                                | 0.90 0.45  0.50  0.80 1.1
fishing vessel                       | 0.95 0.70  0.70  0.40 1.1
gas carrier                          | 0.70 0.60  0.65  0.50 1.1
offshore supply vessel               | 0.90 0.55  0.80  0.55 1.2
passenger liner                      | 0.90 0.40  0.40  0.80 1.2
research vessel                      | 0.85 0.55  0.65  0.60 1.4
speed boat                           | 0.90 0.55  0.60  0.60 1.1
tanker loaded                        | 0.70 0.90  0.55  0.40 3.1
tanker in ballast                    | 0.70 0.75  0.55  0.40 2.2
tender                               | 0.85 0.55  0.55  0.65 1.1
""".strip().splitlines()
WORKS = SimpleNamespace(A_T=300.0, A_L=1000.0, L_OA=120.0, C=3.0, rho_a=1.2)


@pytest.mark.parametrize("line", LOADING, ids=lambda line: line.split("|")[0].strip())
def test_the_wind_force_of_each_type_of_ship_has_its_printed_coefficients(line: str) -> None:
    """Ahead and astern the drag on A_T, abeam that on A_L, at 45 degrees the cross-force parameter; heeling lever."""
    name, numbers = line.split("|")
    side, bow, stern, cross, heel = map(float, numbers.split())
    c = names({row.symbol: row.value for row in blendermann.coefficients_of(name.strip())})

    def at(degrees: float) -> np.ndarray:
        a = np.radians(degrees)
        air = Flow(u=0.0, v=0.0, r=0.0, a_x=-10 * np.cos(a), a_y=10 * np.sin(a))
        return xyn(blendermann.force(air, WORKS, c, Exact())) / 60.0

    assert at(0)[0] == pytest.approx(-bow * 300) and at(180)[0] == pytest.approx(stern * 300)
    assert at(90)[1] == pytest.approx(side * 1000)
    weaker = 1 - cross / 2 * (1 - bow * 0.3 / side)
    assert at(45)[1] == pytest.approx(side * 1000 * np.sqrt(0.5) / weaker)
    assert c.kappa_A == heel
    assert set(blendermann.TYPES) == {row.split("|")[0].strip() for row in LOADING}
