"""Forms of an unnamed force: products of velocities, inputs and wind, and what the rudder sets swinging."""

from __future__ import annotations

from collections.abc import Mapping
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


@dataclass(frozen=True)
class Forms:
    """Functions of the motion: names (m,), values (m, K, R), and their gradients (m, K, R, 6) by the logged states."""

    names: tuple[str, ...]
    values: np.ndarray
    gradients: np.ndarray

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


# Periods [s of a 3 m model] of what swings after the rudder, as roll does.
SWINGS = tuple(round(2.2 * 1.18**i, 1) for i in range(10))
DAMPING = 0.07  # Its share of the critical damping. Set by hand.


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
    """The products, their units taken from trials.

    steps: the transition model; data: the trials; middle: (K, R, S) states in the middle of each step. own: the forms
    on these trials.
    """

    def __init__(self, steps: TransitionModel, data: GriddedTrials, middle: np.ndarray) -> None:
        self.steps = steps
        self.own, self._middle, self._factor = of_unit_size(self._products(data, middle), data.inside)

    def on(self, data: GriddedTrials, middle: np.ndarray) -> Forms:
        """The forms on trials ``data`` with states ``middle`` (K, R, S), in the same units."""
        return _scaled(self._products(data, middle), self._middle, self._factor)

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

    def _products(self, data: GriddedTrials, middle: np.ndarray) -> Forms:
        """The products, not scaled yet. n and delta are means over the propellers and over the rudders."""
        names = self.steps.model.controls
        six, held, time = ca.SX.sym("six", 6), ca.SX.sym("held", len(names)), ca.SX.sym("time")
        every = dict(zip(names, ca.vertsplit(held), strict=True))
        inputs = {name: one for name, one in every.items() if name in INPUTS}
        x, y, psi, u, v, r = ca.vertsplit(six)
        a_x, a_y = relative_air(every["wind_north"], every["wind_east"], psi, u, v)
        r = r * float(self.steps.ship.particulars["L"])
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


def _mean(inputs: list[ca.SX]) -> ca.SX:
    """Mean of some inputs, 0 without any."""
    return sum(inputs, ca.SX(0)) / max(len(inputs), 1)
