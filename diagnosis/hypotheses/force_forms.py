"""Forms of an unnamed force: products of velocities, inputs and wind, and smooth functions of one variable alone.

Smooth functions of some variables are random features (Rahimi & Recht 2007), put into the order of what they contribute
on the trials (principal components): an orthogonal basis whose size falls from component to component.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.linalg import expm

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.transition_model import TransitionModel
from mmg.compile.batch import BatchFunction
from mmg.motion.flow import INPUTS, PROPELLERS, RUDDERS
from mmg.motion.frames import relative_air
from mmg.motion.froude import time_scale

FEATURES = 200  # Random features, more than the samples of a record tell apart. Set by hand: it bounds the cost.


@dataclass(frozen=True)
class Forms:
    """Functions of the motion: names (m,), values (m, K, R), and their gradients (m, K, R, 6) by the logged states."""

    names: tuple[str, ...]
    values: np.ndarray
    gradients: np.ndarray

    @classmethod
    def together(cls, some: Sequence[Forms]) -> Forms:
        """All of ``some``, one after the other."""
        join = (np.concatenate([getattr(forms, k) for forms in some]) for k in ("values", "gradients"))
        return cls(tuple(name for forms in some for name in forms.names), *join)

    def at(self, name: str) -> int:
        """Position of a ``name``."""
        return self.names.index(name)

    def only(self, names: tuple[str, ...]) -> Forms:
        """Those of these ``names``."""
        rows = [self.at(name) for name in names]
        return Forms(names, self.values[rows], self.gradients[rows])


def evaluated(
    expressions: Mapping[str, ca.SX], arguments: list[ca.SX], values: list[np.ndarray], mask: np.ndarray
) -> Forms:
    """``expressions`` of ``arguments``, the first being the six logged states, at ``values`` (K, R, ...); mask: (K, R)
    where they exist, else 0."""
    names, shape = tuple(expressions), mask.shape
    each = ca.densify(ca.vertcat(*expressions.values()))
    function = ca.Function("forms", list(arguments), [each, ca.densify(ca.jacobian(each, arguments[0]))])
    count = int(mask.sum())
    value, gradient = np.zeros((len(names), *shape)), np.zeros((len(names), *shape, 6))
    if count:
        made = BatchFunction(function, None).at(*(v.reshape(*shape, -1)[mask].T for v in values))
        value[:, mask] = made[0]
        gradient[:, mask] = np.moveaxis(made[1].reshape(6, len(names), count), 0, 2)  # nonzeros column by column
    return Forms(names, value, gradient)


def spread_of(values: np.ndarray) -> np.ndarray:
    """Standard deviation (m,) of ``values`` (m, M), 0 of what does not change."""
    spread = values.std(axis=1)
    return np.where(spread > 1e-3 * np.abs(values).max(axis=1, initial=0.0) + 1e-12, spread, 0.0)


class SmoothBasis:
    """Smooth functions of variables, whose units and order are taken from trials.

    values: (m, M) of the variables; scale: length over which a function changes; components: functions kept.
    """

    def __init__(self, values: np.ndarray, scale: float, components: int) -> None:
        rng = np.random.default_rng(0)
        self._centre = values.mean(axis=1)
        self._weight = rng.standard_normal((FEATURES, len(values))) / scale
        self._phase = rng.uniform(0, 2 * np.pi, FEATURES)
        # random Fourier features (Rahimi & Recht 2007)
        features = np.cos(self._weight @ (values - self._centre[:, None]) + self._phase[:, None])
        self._mean = features.mean(axis=1)
        features -= self._mean[:, None]
        sizes, vectors = np.linalg.eigh(features @ features.T / features.shape[1])
        kept = np.argsort(-sizes)[:components]
        kept = kept[sizes[kept] > 1e-9]  # components of rounding alone
        # one factor for all: rougher ones stay smaller
        self._mix = vectors[:, kept].T / np.sqrt(sizes[kept].max(initial=1e-300))

    def on(self, known: Forms, name: str, mask: np.ndarray) -> Forms:
        """The functions of the variables ``known``, by ``name`` and number; mask: (K, R) where they exist, else 0."""
        angle = self._weight @ (known.values[:, mask] - self._centre[:, None]) + self._phase[:, None]
        found = self._mix @ (np.cos(angle) - self._mean[:, None])
        slope = np.zeros((*found.shape, known.gradients.shape[-1]))
        for weight, along in zip(self._weight.T, known.gradients[:, mask], strict=True):
            if along.any():  # an input has none
                slope -= ((self._mix * weight) @ np.sin(angle))[..., None] * along
        values, gradients = (np.zeros((len(found), *mask.shape, *x.shape[2:])) for x in (found, slope))
        values[:, mask], gradients[:, mask] = found, slope
        return Forms(tuple(f"{name} {i + 1}" for i in range(len(found))), values, gradients)


OF_ONE = 8  # Functions of each variable alone that are kept. Set by hand.
FINE = 0.35  # Length over which they change, in standard deviations of the variable. Set by hand.
OF_PLACE = 12  # Functions of the place that are kept. Set by hand.
PLACE = 2.0  # Length over which they change [lengths of the ship]. Set by hand.
# Periods [s of a 3 m model] of what swings after the rudder, as roll does.
SWINGS = tuple(round(2.2 * 1.18**i, 1) for i in range(10))
DAMPING = 0.07  # Its share of the critical damping. Set by hand.


HULL = (
    "u", "v", "r", "uu", "uv", "ur", "vr", "v|v|", "r|r|", "v|r|", "r|v|", "vv", "rr", "|v|", "|r|", "u|u|", "uuu",
)  # fmt: skip
PROPELLER = ("1", "u", "uu", "u|u|", "uuu", "n", "nn", "n|n|", "un", "back", "back|back|")
AIR = ("air x", "air y", "air xy", "cos", "sin", "cos 2", "sin 2")
WASH = ("n", "nn", "n|n|", "un", "rn", "vn")


def by_variables(products: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Those of the ``products`` that depend on the same few variables: what one part of a ship gives."""
    known = {*HULL, *PROPELLER, *AIR, *WASH, "t", "x", "y"}
    rudder = tuple(name for name in products if name in WASH or name not in known)
    few = {"u, v, r": HULL, "u, n": PROPELLER, "delta, n": rudder, "air": AIR}
    return {words: tuple(name for name in names if name in products) for words, names in few.items()}


def unit(values: np.ndarray, mask: np.ndarray) -> float:
    """One over the root mean square of ``values`` (K, R) where ``mask`` (K, R) counts; 0 where there is nothing."""
    size = float(np.sqrt((values[mask] ** 2).mean()))
    return 1 / size if size > 1e-12 else 0.0


def of_unit_size(forms: Forms, mask: np.ndarray) -> tuple[Forms, np.ndarray, np.ndarray]:
    """The ``forms`` with unit root mean square where ``mask`` (K, R) counts, place and time from their middle.

    Returns the forms, and the middle (m,) and factor (m,) of each.
    """
    middle = np.array(
        [v[mask].mean() if n in ("t", "x", "y") else 0.0 for n, v in zip(forms.names, forms.values, strict=True)]
    )
    factor = np.array([unit(v - m, mask) for v, m in zip(forms.values, middle, strict=True)])
    return _scaled(forms, middle, factor), middle, factor


def _scaled(forms: Forms, middle: np.ndarray, factor: np.ndarray) -> Forms:
    wide = factor[:, None, None]
    return Forms(forms.names, (forms.values - middle[:, None, None]) * wide, forms.gradients * wide[..., None])


class ForceForms:
    """The forms, their units taken from trials.

    steps: the transition model; data: the trials; middle: (K, R, S) states in the middle of each step. products: names
    of those forms that are products; the others are smooth functions of one variable; own: all of them on these trials.
    """

    def __init__(self, steps: TransitionModel, data: GriddedTrials, middle: np.ndarray) -> None:
        self.steps = steps
        raw = self._products(data, middle)
        products, self._middle, self._factor = of_unit_size(raw, data.inside)
        self.products = frozenset(raw.names)
        known = self._variables(data, middle)
        inside = known.values[:, data.inside]
        spread = spread_of(inside)
        scale = PLACE * float(steps.ship.particulars["L"])
        self._place = SmoothBasis(_places(middle).values[:, data.inside], scale, OF_PLACE)
        self._alone = {
            name: SmoothBasis(inside[[i]], FINE * spread[i], OF_ONE) for i, name in enumerate(known.names) if spread[i]
        }
        self.own = self._with_smooth(products, known, data.inside)

    def on(self, data: GriddedTrials, middle: np.ndarray) -> Forms:
        """The forms on trials ``data`` with states ``middle`` (K, R, S), in the same units."""
        products = _scaled(self._products(data, middle), self._middle, self._factor)
        return self._with_smooth(products, self._variables(data, middle), data.inside)

    def _with_smooth(self, products: Forms, known: Forms, inside: np.ndarray) -> Forms:
        """The ``products``, and the smooth functions of the ``known`` variables where a step is ``inside`` (K, R)."""
        alone = [basis.on(known.only((name,)), f"{name} alone", inside) for name, basis in self._alone.items()]
        return Forms.together([products, *alone])

    def by_place(self, data: GriddedTrials, middle: np.ndarray) -> Forms:
        """Smooth functions of the place of trials ``data`` with states ``middle`` (K, R, S)."""
        return self._place.on(_places(middle), "place", data.inside)

    def after_the_rudder(self, data: GriddedTrials) -> Forms:
        """What the rudders set swinging in trials ``data``: deflection, from where it would come to rest, and speed of
        an oscillator of each of SWINGS."""
        places = [i for i, name in enumerate(self.steps.model.controls) if name in RUDDERS]
        moved = data.inputs[..., places].sum(axis=2)
        omega = 2 * np.pi / (np.array(SWINGS) * time_scale(float(self.steps.ship.particulars["L"])))
        # of x'' + 2 d w x' + w^2 x = 0 in (x, x' / w)
        step = np.stack([expm(data.h * np.array([[0, w], [-w, -2 * DAMPING * w]])) for w in omega])
        swing = np.zeros((*moved.shape, len(omega), 2))  # about where it would come to rest
        for k in range(1, len(moved)):
            begin = swing[k - 1].copy()
            begin[..., 0] += (moved[k - 1] - moved[k])[:, None]  # its resting place moves with the rudder
            swing[k] = np.einsum("wij,rwj->rwi", step, begin)
        values = np.moveaxis(swing.reshape(*moved.shape, -1), 2, 0)
        names = tuple(f"{period:g} s {part}" for period in SWINGS for part in ("deflection", "speed"))
        return of_unit_size(Forms(names, values, np.zeros((*values.shape, 6))), data.inside)[0]

    def family(self, name: str) -> str:
        """Begin of the kinds of the form ``name``: "" for the products."""
        return "" if name in self.products else f"{name.rpartition(' ')[0]} "

    def _arguments(self) -> tuple[list[ca.SX], dict[str, ca.SX], dict[str, ca.SX]]:
        """Symbols of states, inputs and time; the velocities (r times L) and air; the inputs by name."""
        names = self.steps.model.controls
        six, held, time = ca.SX.sym("six", 6), ca.SX.sym("held", len(names)), ca.SX.sym("time")
        inputs = dict(zip(names, ca.vertsplit(held), strict=True))
        psi, u, v, r = ca.vertsplit(six)[2:]
        a_x, a_y = relative_air(inputs["wind_north"], inputs["wind_east"], psi, u, v)
        motion = {"u": u, "v": v, "r": r * float(self.steps.ship.particulars["L"]), "air x": a_x, "air y": a_y}
        return [six, held, time], motion, {name: x for name, x in inputs.items() if name in INPUTS}

    def _products(self, data: GriddedTrials, middle: np.ndarray) -> Forms:
        """The products, not scaled yet. n and delta are means over the propellers and over the rudders."""
        (six, held, time), motion, inputs = self._arguments()
        x, y, psi = ca.vertsplit(six)[:3]
        u, v, r, a_x, a_y = motion.values()
        n, delta = (_mean([inputs[name] for name in kind if name in inputs]) for kind in (PROPELLERS, RUDDERS))
        air, back = ca.sqrt(a_x**2 + a_y**2 + 1e-12), ca.fmin(n, 0)
        forms = {
            "1": ca.SX(1), "u": u, "v": v, "r": r, "uu": u * u, "uv": u * v, "ur": u * r, "vr": v * r,
            "v|v|": v * ca.fabs(v), "r|r|": r * ca.fabs(r), "v|r|": v * ca.fabs(r), "r|v|": r * ca.fabs(v), "vv": v * v,
            "rr": r * r, "|v|": ca.fabs(v), "|r|": ca.fabs(r), "u|u|": u * ca.fabs(u), "uuu": u**3, "n": n, "nn": n * n,
            "n|n|": n * ca.fabs(n), "un": u * n, "back": back, "back|back|": back * ca.fabs(back), "delta": delta,
            "delta nn": delta * n * n, "delta uu": delta * u * u, "delta|delta|": delta * ca.fabs(delta), "rn": r * n,
            "vn": v * n, "air x": a_x * air, "air y": a_y * air, "air xy": a_x * a_y, "cos": ca.cos(psi),
            "sin": ca.sin(psi), "cos 2": ca.cos(2 * psi), "sin 2": ca.sin(2 * psi), "t": time, "x": x, "y": y,
        }  # fmt: skip
        single = [name for kind in (PROPELLERS, RUDDERS) for name in kind if name in inputs]
        for name in (name for name in inputs if len(single) > 2 or name not in single):
            forms |= {name: inputs[name], f"{name}|{name}|": inputs[name] * ca.fabs(inputs[name])}
        return evaluated(forms, [six, held, time], [middle[..., :6], data.inputs, data.t[:-1]], data.inside)

    def _variables(self, data: GriddedTrials, middle: np.ndarray) -> Forms:
        """What the smooth forms are functions of: velocities and inputs."""
        arguments, motion, inputs = self._arguments()
        variables = {name: x for name, x in motion.items() if not name.startswith("air")} | inputs
        return evaluated(variables, arguments, [middle[..., :6], data.inputs, data.t[:-1]], np.asarray(data.inside))


def _mean(inputs: list[ca.SX]) -> ca.SX:
    """Mean of some inputs, 0 without any."""
    return sum(inputs, ca.SX(0)) / max(len(inputs), 1)


def _places(middle: np.ndarray) -> Forms:
    """Position north and east in states ``middle`` (K, R, S)."""
    gradients = np.zeros((2, *middle.shape[:2], 6))
    gradients[0, ..., 0] = gradients[1, ..., 1] = 1.0
    return Forms(("x", "y"), np.moveaxis(middle[..., :2], 2, 0), gradients)
