"""Generated polynomials: words, counts of the paper, rules, conditions, derivatives, any list of actuators."""

from __future__ import annotations

import itertools

import casadi as ca
import numpy as np
import pytest

from mmg.components.coefficients import names
from mmg.components.expansion import hard_submodels, smooth_submodels
from mmg.components.expansion.actuators import devices_of, parse_devices, variables, without_partner
from mmg.components.expansion.series import DAMPING, STALL, speed_scale, variable
from mmg.components.expansion.structure import Powers, Structure, monomials, regimes, term_list, terms
from mmg.components.expansion.words import parse_monomial
from mmg.errors import BadValue, Conflict, Missing, OutOfRange, UnknownName, Unsupported
from mmg.motion.flow import INPUTS, Flow
from mmg.motion.smooth import Smooth
from tests.support.force_numbers import xyn

VECTWIN = parse_devices("n, delta_port, delta_starboard")
PODS = parse_devices("azimuth+azimuth_2, azimuth_3+azimuth_4")
PAPER = {"L": 3.0, "d": 0.17, "rho": 998.0}
SMOOTH = Smooth.for_length(3.0)
LISTS = ("n, delta", "n, delta_port, delta_starboard", "n+n_2, delta_starboard+delta_port", "n+n_2", "n_bow, n_stern",
         "azimuth+azimuth_2, azimuth_3+azimuth_4")  # fmt: skip


def motion(rng: np.random.Generator) -> dict[str, float]:
    """A motion and positions of all actuators at random."""
    speeds = dict(zip("uvr", rng.normal(size=3) * (0.3, 0.1, 0.1), strict=True))
    return speeds | {name: rng.normal() * (8.0 if unit == "rps" else 1.0) for name, (_, unit) in INPUTS.items()}


def mirrored(at: dict[str, float], pairs: bool) -> dict[str, float]:
    """The same seen in the mirror: port becomes starboard, and actuators of ``pairs`` change places."""
    swap = {"n": "n_2", "delta_starboard": "delta_port", "azimuth": "azimuth_2", "azimuth_3": "azimuth_4",
            "n_azimuth": "n_azimuth_2", "n_azimuth_3": "n_azimuth_4"}  # fmt: skip
    swap |= {other: name for name, other in swap.items()}
    swap = swap if pairs else {}
    odd = [n for n in at if n in ("v", "r", "n_bow", "n_stern") or n.startswith(("delta", "azimuth"))]
    turned = {name: -x if name in odd else x for name, x in at.items()}
    return {name: turned[swap.get(name, name)] for name in at}


def values(structure: Structure, at: dict[str, float], hard: bool = False, seed: int = 3) -> np.ndarray:
    """X, Y, N of a structure with random coefficients."""
    rows = terms(structure)
    rng = np.random.default_rng(seed)
    c = names(dict(zip((row.symbol for row in rows), rng.normal(size=len(rows)), strict=True)))
    model = hard_submodels if hard else smooth_submodels
    return xyn(model.force(Flow(**at), names(PAPER), c, SMOOTH, {row.symbol: row.monomial for row in rows}))


@pytest.mark.parametrize(
    ("order", "submodels", "count"),
    [(2, "SM-2", 120), (2, "SM-3", 180), (2, "SM-4", 240), (3, "SM-2", 400), (3, "SM-3", 600)],
)
def test_the_counts_are_those_of_the_paper(order: int, submodels: str, count: int) -> None:
    """133, 193, 253, 413 and 613 with three added masses and ten wind coefficients (Miyauchi et al. 2023, Table 3)."""
    rows = terms(Structure(VECTWIN, order, submodels))
    assert len(rows) == count == len({row.symbol for row in rows}) == len({(r.symbol[0], r.monomial) for r in rows})


def test_the_second_order_list_is_the_one_that_can_be_written_by_hand() -> None:
    even, odd = (
        ("u", "n", "cos(delta_port)", "cos(delta_starboard)"),
        ("v", "r", "sin(delta_port)", "sin(delta_starboard)"),
    )
    product = {frozenset(pair) for pair in itertools.product(even, odd)}
    sets = {f: {frozenset(map(str, (x.word for x, _ in m))) for m in monomials(Structure(VECTWIN), f)} for f in "XYN"}
    assert sets["Y"] == sets["N"] == product | {frozenset({x}) for x in odd}
    squares = {frozenset({x}) for x in ("u", "n", "v", "r")}
    couples = {frozenset(pair) for group in (even, odd) for pair in itertools.combinations(group, 2)}
    assert sets["X"] == {frozenset({x}) for x in even} | squares | couples
    assert len(monomials(Structure(VECTWIN), "X")) == 20


@pytest.mark.parametrize("devices", ["n, delta", "n, delta_port, delta_starboard", "n+n_2, delta_starboard+delta_port"])
@pytest.mark.parametrize("order", [2, 3])
def test_what_the_identity_leaves_is_independent_and_complete(devices: str, order: int) -> None:
    """The terms that stay have full rank at random points, and the terms left out lie in their span and a constant."""
    kept, whole = (Structure(parse_devices(devices), order, duplicates=rule) for rule in ("identity", "none"))
    rng = np.random.default_rng(0)
    points = [motion(rng) for _ in range(400)]
    several = variables(kept.devices)
    x = ca.SX.sym("x", len(points[0]))
    flow = Flow(**{name: x[i] for i, name in enumerate(points[0])})
    f = ca.Function("f", [x], [ca.vertcat(*[variable(each.word, flow, 3.0) for each in several])])
    known = dict(zip(several, np.array(f(np.transpose([[*at.values()] for at in points]))), strict=True))

    def matrix(powers: tuple[Powers, ...]) -> np.ndarray:
        return np.column_stack([np.prod([known[each] ** k for each, k in m], axis=0) for m in powers])

    for force in "XY":
        stay, all_of_them = matrix(monomials(kept, force)), matrix(monomials(whole, force))
        stay = np.column_stack([stay, np.ones(len(points))])
        scaled = stay / np.linalg.norm(stay, axis=0)
        assert np.linalg.matrix_rank(scaled, tol=1e-9) == stay.shape[1]
        residual = all_of_them - stay @ np.linalg.lstsq(stay, all_of_them, rcond=None)[0]
        assert np.abs(residual).max() < 1e-8 * np.abs(all_of_them).max()
        assert stay.shape[1] - 1 < all_of_them.shape[1] or (force == "Y" and order == 2)


@pytest.mark.parametrize("devices", [text for text in LISTS if text != "n, delta_port, delta_starboard"])
@pytest.mark.parametrize("submodels", ["SM-1", "SM-2"])
def test_mirrored_motion_gives_the_mirrored_force(devices: str, submodels: str) -> None:
    """But for two rudders one by one."""
    several, rng = parse_devices(devices), np.random.default_rng(5)
    for order in (2, 3):
        structure, at = Structure(several, order, submodels, duplicates="identity"), motion(rng)
        at |= {} if "n_2" in devices else {"n_2": at["n"]}  # one propeller changes places with itself
        there = values(structure, mirrored(at, "+" in devices))
        np.testing.assert_allclose(there, values(structure, at) * (1, -1, -1), rtol=1e-9, atol=1e-9)


def test_moduli_change_squares_and_products_but_not_pure_cubes() -> None:
    rows = terms(Structure(parse_devices("n, delta"), 3, "SM-1"))
    texts = {row.symbol[0] + " " + row.monomial for row in rows}
    assert {"X u |u|", "X n |n|", "X v v", "Y v v v", "Y |v| r", "Y u |u| v", "X u u u"} <= texts
    assert "X u u" not in texts
    plain = {row.monomial for row in terms(Structure(parse_devices("n, delta"), 3, "SM-1", moduli="none"))}
    assert not any("|" in text for text in plain) and "v v r" in plain
    assert "v |v|" in {row.monomial for row in terms(Structure(parse_devices("n, delta"), 3, "SM-1", moduli="full"))}
    second = terms(Structure(parse_devices("n, delta"), 2, "SM-1", moduli="full"))
    drag = {"v |v|", "|v| r", "v |r|", "r |r|"}
    for force in "YN":
        assert drag <= {row.monomial for row in second if row.symbol[0] == force}
    assert not drag & {row.monomial for row in second if row.symbol[0] == "X"}


@pytest.mark.parametrize("submodels", ["SM-1", "SM-2", "SM-3", "SM-4", "quadrants"])
def test_conditions_add_up_to_one_and_hard_ones_are_nought_or_one(submodels: str) -> None:
    structure = Structure(VECTWIN, 1, submodels)
    rng = np.random.default_rng(1)
    for _ in range(40):
        at = motion(rng)
        for hard in (False, True):
            total = []
            for conditions in regimes(structure):
                text = " ".join([*map(str, conditions), "u"])
                model = hard_submodels if hard else smooth_submodels
                force = model.force(Flow(**at), names(PAPER), names({"X_a": 1.0}), SMOOTH, {"X_a": text})
                unit = 0.5 * 998.0 * 3.0 * 0.17 * speed_scale(3.0) * at["u"]
                total.append(float(ca.DM(force.X)) / unit)
            assert sum(total) == pytest.approx(1.0, abs=1e-12)
            if hard:
                assert sorted(np.round(total, 12))[-1] == 1.0 and np.count_nonzero(np.round(total, 12)) == 1


@pytest.mark.parametrize(
    ("u", "port", "submodel"), [(0.3, 0.1, 0), (0.3, -STALL - 0.2, 1), (-0.3, 0.1, 2), (-0.3, STALL + 0.2, 3)]
)
def test_sm4_switches_by_the_sign_of_u_and_the_stall_angle_of_either_rudder(
    u: float, port: float, submodel: int
) -> None:
    at = {"u": u, "v": 0.1, "r": 0.0, "delta_port": port, "delta_starboard": 0.0, "n": 5.0}
    active = []
    for conditions in regimes(Structure(VECTWIN, 1, "SM-4")):
        text = " ".join([*map(str, conditions), "v"])
        both = [
            float(ca.DM(m.force(Flow(**at), names(PAPER), names({"Y_a": 1.0}), SMOOTH, {"Y_a": text}).Y))
            for m in (smooth_submodels, hard_submodels)
        ]
        np.testing.assert_allclose(both[0], both[1], rtol=0.01, atol=5e-3)
        active.append(both[1] != 0)
    assert active == [i == submodel for i in range(4)]


@pytest.mark.parametrize("devices", LISTS)
def test_derivatives_are_finite_everywhere(devices: str) -> None:
    several = parse_devices(devices)
    rudders = any("delta" in str(device) for device in several)
    rows = terms(Structure(several, 3, "SM-4" if rudders else "SM-2", duplicates="identity"))
    keys = ["u", "v", "r", *INPUTS]
    x = ca.SX.sym("x", len(keys))
    rng = np.random.default_rng(2)
    c = names({row.symbol: rng.normal() for row in rows})
    flow = Flow(**{key: x[i] for i, key in enumerate(keys)})
    force = smooth_submodels.force(flow, names(PAPER), c, SMOOTH, {row.symbol: row.monomial for row in rows})
    y = ca.vertcat(force.X, force.Y, force.N)
    f, J = ca.Function("f", [x], [y]), ca.Function("J", [x], [ca.jacobian(y, x)])
    H = ca.Function("H", [x], [ca.jacobian(ca.densify(ca.vec(ca.jacobian(y, x))), x)])
    scale = np.array([0.4, 0.2, 0.1, *(8.0 if unit == "rps" else 0.8 for _, unit in INPUTS.values())])
    for share in (0.0, 1e-6, 1.0, 1.0):
        point = share * rng.uniform(-1, 1, len(keys)) * scale
        assert all(np.isfinite(np.array(function(point))).all() for function in (f, J, H))


def test_a_monomial_is_read_as_it_is_written() -> None:
    text = "ahead attached(delta_port,delta_starboard) u |v| mean(n,n_2) half(sin(delta_starboard),sin(delta_port))"
    assert str(parse_monomial(text)) == text
    spaced = parse_monomial(" ahead  attached( delta_port , delta_starboard ) u |v| ")
    assert str(spaced) == "ahead attached(delta_port,delta_starboard) u |v|"
    assert parse_monomial("stalled(delta) push(n_azimuth,azimuth)").inputs == {"delta", "n_azimuth", "azimuth"}
    assert parse_monomial("ahead |v| sin(delta_port)").short == "absv_sdp"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"), ("ahead", "no factor"), ("u q", "'q'"), ("sin(u)", "angle"),
        ("cos(n)", "angle"), ("push(delta,azimuth)", "not revolutions"), ("ahead(n) u", "no condition"),
        ("stalled u", "write stalled(delta)"), ("|ahead| u", "no condition"), ("sin(delta", "no variable"),
        ("sin(delta))", "brackets"), ("mean(u,v)", "actuators"), ("u^2", "no variable"),
        ("tan(delta)", "no variable"), ("mean(n,mean(n,n_2))", "actuators"),
    ],
)  # fmt: skip
def test_a_wrong_monomial_is_refused_with_its_word(text: str, words: str) -> None:
    with pytest.raises(ValueError, match="(?s)" + words.replace("(", r"\(").replace(")", r"\)")):
        parse_monomial(text)


def test_lists_of_actuators_are_checked() -> None:
    for text, kind in (
        ("n, rudder", UnknownName), ("n, n", Conflict), ("", Missing), ("n+delta", Conflict), ("n_azimuth", BadValue),
        ("n+n_bow", Conflict),
    ):  # fmt: skip
        with pytest.raises(kind):
            parse_devices(text)
    assert [str(d) for d in parse_devices("n+n_2, delta")] == ["n+n_2", "delta"]


def test_pairs_are_found_by_place_and_missing_partners_named() -> None:
    places = {"x_az": -1.2, "y_az": 0.2, "x_az_2": -1.2, "y_az_2": -0.2, "x_az_3": 1.2, "y_az_3": 0.0}
    inputs = ("n_azimuth", "azimuth", "n_azimuth_2", "azimuth_2", "n_azimuth_3", "azimuth_3")
    found = devices_of(inputs, places)
    assert [str(device) for device in found] == ["azimuth+azimuth_2", "azimuth_3"]
    assert without_partner(found, places) == []
    assert without_partner(parse_devices("azimuth, azimuth_3"), places) == ["azimuth"]
    assert without_partner(parse_devices("n, delta_port"), {}) == ["delta_port"]
    assert without_partner(parse_devices("n, n_2"), {}) == ["n_2"]
    assert without_partner(VECTWIN, {}) == []


def test_structures_that_cannot_be_are_refused_with_the_count() -> None:
    for structure, kind, number in (
        (lambda: Structure(PODS, 2, "SM-3"), Unsupported, "4"), (lambda: Structure(VECTWIN, 0), OutOfRange, "0"),
        (lambda: Structure(VECTWIN, 2, "SM-9"), UnknownName, "SM-9"),
        (lambda: Structure(PODS, 2, "quadrants"), Unsupported, "4"),
        (lambda: terms(Structure(PODS, 12)), OutOfRange, "1352077"),
    ):  # fmt: skip
        with pytest.raises(kind, match=number):
            structure()


def test_signs_that_are_plain_are_bounds() -> None:
    rows = {row.symbol: row for row in terms(Structure(VECTWIN))}
    assert rows["X_u_1"].upper == rows["Y_v_1"].upper == rows["N_r_2"].upper == 0.0
    assert rows["X_n_1"].lower == 0.0 and rows["X_u_n_1"].lower < 0 < rows["X_u_n_1"].upper


def test_the_printed_list_has_every_term_and_the_counts() -> None:
    rows = terms(Structure(VECTWIN))
    text = term_list(rows)
    assert "X: 40 terms" in text and "Y: 40 terms" in text and "N: 40 terms" in text
    assert all(f"  {row.symbol} " in text and row.monomial in text for row in rows)


def test_beyond_its_range_a_polynomial_stays_at_the_edge_and_the_rest_is_damped() -> None:
    limits = {"u_ahead": 0.5, "u_astern": 0.2, "v_most": 0.2, "r_most": 0.2}
    rows = {"X_1": "u u u", "Y_1": "v v v", "N_1": "r r r"}
    c = names(dict.fromkeys(rows, 1.0))

    def force(u: float, v: float, r: float, **particulars: float) -> np.ndarray:
        flow = Flow(u=u, v=v, r=r, psi=0.0)
        return xyn(smooth_submodels.force(flow, names(PAPER | particulars), c, SMOOTH, rows))

    V, unit = speed_scale(3.0), 0.5 * 998.0 * 3.0 * 0.17 * speed_scale(3.0) ** 2 * np.array([1.0, 1.0, 3.0])
    np.testing.assert_allclose(force(0.2, 0.1, 0.1, **limits), force(0.2, 0.1, 0.1), rtol=0.03)
    for far in (1.0, 2.0):
        edge = np.array([0.5 / V, 0.2 / V, 0.2 * 3.0 / V]) ** 3
        beyond = np.array([far - 0.5, far - 0.2, (far - 0.2) * 3.0]) / V
        expected = unit * (edge - np.array([DAMPING[name] for name in "uvr"]) * beyond)
        np.testing.assert_allclose(force(far, far, far, **limits), expected, rtol=0.02)
    astern = force(-1.0, 0.0, 0.0, **limits)[0]
    assert astern == pytest.approx(unit[0] * (-((0.2 / V) ** 3) + DAMPING["u"] * 0.8 / V), rel=0.02)
