"""Dictionary of unnamed forms: what could be wrong with a model in ways that the library of effects does not hold.

Forces in the three channels as products of velocities, inputs and wind; the action of each input scaled with the state,
or late by several times; errors of each sensor: bias, gain, lag, cross-talk, drift.
Every column is scaled so that its typical size is that of the latent force or of the sensor's noise.

A force that depends on the state changes how the ship answers to the latent force, and so the log determinant of the
likelihood. Each column therefore has, beside its response, the slope of the log determinant along it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from diagnosis.estimation.acting_inputs import acting
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import DrivenColumns, ProductColumns
from diagnosis.estimation.linearisation import DIFFERENCE, Linearisation, Point
from diagnosis.estimation.transition_model import LinearModel, TransitionModel
from mmg.compile.batch import BatchFunction
from mmg.motion.flow import INPUTS, PROPELLERS, RUDDERS
from mmg.motion.frames import relative_air
from mmg.motion.froude import time_scale

DELAYS = (0.5, 1.0, 2.0, 4.0)  # Times [s of a 3 m model] by which inputs may act late. Set by hand: factors of two.
SHAPES = ("1", "u", "v", "r", "|r|", "delta", "n")  # Forms by which the action of an input is scaled
AXES = ("surge", "sway", "yaw")
FORCES = tuple(f"{axis} force" for axis in AXES)  # Kinds of the forces that are products
Points = tuple[np.ndarray, np.ndarray, np.ndarray]  # States (S, M), inputs (C, M) and coefficients (all, M) of steps


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


@dataclass(frozen=True)
class Action:
    """How an input acts: change of the A active states over a step per unit of it (K, R, A), of their rates (K, R, A),
    and of the Jacobian of the rates by states and latent force (K, R, A, A + 3); delayed: the input some time ago less
    now, (K, R) each, in units of its own; per_second: (D,) how much of each a delay of 1 s is."""

    step: np.ndarray
    rates: np.ndarray
    jacobian: np.ndarray
    delayed: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 0)))
    per_second: np.ndarray = field(default_factory=lambda: np.zeros(0))


class Dictionary:
    """The columns of all unnamed forms at a fitted hypothesis.

    steps: the transition model; data: the trials; point: the fit; active: (A,) positions of the states that take part.
    labels: kind and form of each of C columns; kinds: the kind alone.
    """

    def __init__(self, steps: TransitionModel, data: GriddedTrials, point: Point, active: np.ndarray) -> None:
        data = acting(steps, data, point.theta)
        self.data, self.noise, self.active, self.path = data, point.noise, active, point.path
        z = point.path.z
        K, R = data.inputs.shape[:2]
        middle = 0.5 * (z[:-1] + z[1:])  # where forces are asked for: the midpoint rule
        self.force_forms = ForceForms(steps, data, middle)
        self.forces = self.force_forms.own
        every = steps.coefficients(point.theta, point.path.push[:-1].reshape(-1, 3).T)
        points = middle.reshape(K * R, -1).T, data.inputs.reshape(K * R, -1).T, every
        wanted = np.concatenate([active, steps.S + np.arange(3)])
        _, J = steps.rates(*points)
        self.by_force = J[:, active, steps.S :].reshape(K, R, -1, 3)
        begin = (z[:-1].reshape(K * R, -1).T, *points[1:])
        differences = _Differences(steps, data, points, begin, active)
        self.actions = {name: differences.of_input(name) for name in steps.model.controls if name in INPUTS}
        held = np.concatenate([data.inputs, data.inputs[-1:]]).reshape((K + 1) * R, -1).T
        all_theta = steps.coefficients(point.theta, point.path.push.reshape(-1, 3).T)
        rate, J = steps.rates(z.reshape((K + 1) * R, -1).T, held, all_theta)
        self.rate = rate[:, active].reshape(K + 1, R, -1)
        self.rate_jacobian = J[:, active][:, :, wanted].reshape(K + 1, R, len(active), -1)
        self.states = _sensor_forms(z, data)
        self.labels = (
            *((kind, form) for form in self.forces.names for kind in FORCES),
            *(
                (f"{what} of {name}", form)
                for name in self.actions
                for what, forms in (("action", SHAPES), ("delay", tuple(f"{d:g} s" for d in DELAYS)))
                for form in forms
            ),
            *((f"sensor of {SENSORS[channel]}", name) for channel, names in ERRORS.items() for name in names),
        )
        self.kinds = tuple(kind for kind, _ in self.labels)

    def columns(self, linear: LinearModel) -> list[ProductColumns | DrivenColumns]:
        """The columns for ``linearise_and_filter``, of the ``linear`` model: what acts on the ship, then the errors of
        the sensors."""
        forms, push = self.forces, linear.force * self.noise.force
        shapes = forms.values[[forms.at(name) for name in SHAPES]]
        parts: list[ProductColumns | DrivenColumns] = [ProductColumns(push, forms.values)]
        for action, size in self.scaled(linear, self.actions):
            parts.append(ProductColumns(size * action.step[..., None], np.concatenate([shapes, action.delayed])))
        errors = self._errors(linear)
        observed = np.zeros((len(linear.F) + 1, linear.F.shape[1], 6, len(errors)))
        for i, (channel, values, _) in enumerate(errors):
            observed[:, :, channel, i] = values
        return [*parts, DrivenColumns.misread(observed)]

    def logdet_gradient(self, at: Linearisation) -> np.ndarray:
        """Derivative (C,) of 1/2 log det F along each column, of the linearisation ``at`` with these columns."""
        forms, sizes = self.forces, self.noise.force
        own = at.by_rates[..., : len(self.active)]  # (K, R, A, A)
        # by the gradient of a form: forms depend on the logged states
        pull = np.einsum("kraf,krab->krfb", self.by_force, own)[..., :6]
        result = [(np.einsum("mkrb,krfb->mf", forms.gradients, pull) * sizes).ravel()]
        for action, size in self.scaled(at.linear, self.actions):
            whole, scaled = self._along(at, action, forms.only(SHAPES))
            result += [size * scaled, size * np.einsum("mkr,kr->m", action.delayed, whole)]
        by_Z = at.adjoint.by_Z[..., : len(self.active) + 3]
        result.append(np.array([(by_Z[:, :, channel] * g).sum() for channel, _, g in self._errors(at.linear)]))
        return np.concatenate(result)

    def _along(self, at: Linearisation, action: Action, forms: Forms) -> tuple[np.ndarray, np.ndarray]:
        """Derivative of 1/2 log det by the size of an ``action`` at each step (K, R), and by that of the action times
        each of the ``forms`` (m,); at: the linearisation."""
        whole = np.einsum("krab,krab->kr", at.by_rates, action.jacobian)
        pull = np.einsum("kra,krab->krb", action.rates, at.by_rates[..., : len(self.active)])[..., :6]
        along = np.einsum("mkr,kr->m", forms.values, whole) + np.einsum("mkrb,krb->m", forms.gradients, pull)
        return whole, along

    def scaled(self, linear: LinearModel, actions: Mapping[str, Action]) -> list[tuple[Action, float]]:
        """Each of the ``actions``, and the unit of it that is as strong as the latent force."""
        inside = self.data.inside
        # what a step of the latent force adds to the states
        strength = np.linalg.norm(linear.force * self.noise.force, axis=(2, 3))[inside]
        return [
            (a, float(np.sqrt((strength**2).mean() / max((a.step[inside] ** 2).sum(axis=1).mean(), 1e-300))))
            for a in actions.values()
        ]

    def _errors(self, linear: LinearModel) -> list[tuple[int, np.ndarray, np.ndarray]]:
        """Errors of sensors: channel, values (K + 1, R), gradients (K + 1, R, A + 3) by active states and force."""
        compared = np.asarray(self.data.good.any(axis=2))
        A, rows = len(self.active), []
        for channel, names in ERRORS.items():
            for name in names:
                if name == "rate":
                    H = linear.H[:, :, channel]
                    value = np.einsum("kra,kra->kr", H, self.rate)
                    gradient = np.einsum("kra,krab->krb", H, self.rate_jacobian)
                else:
                    i = self.states.at(name)
                    value, gradient = self.states.values[i], np.zeros((*compared.shape, A + 3))
                    gradient[..., :6] = self.states.gradients[i]
                size = self.noise.white[channel] * unit(value, compared)
                rows.append((channel, size * value, size * gradient))
        return rows


SENSORS = ("position", "position", "heading", "u", "v", "r")  # Name of each logged column's sensor
# Forms of the error of each logged column; rate: its change over time, as of a late sensor.
ERRORS = {
    0: ("rate", "cos", "sin"),
    1: ("rate", "cos", "sin"),
    2: ("1", "rate", "sin", "cos", "sin 2", "cos 2", "t"),
    3: ("1", "rate", "u", "v", "r", "uu", "t"),
    4: ("1", "rate", "u", "v", "r", "t"),
    5: ("1", "rate", "r", "r|r|", "t"),
}


def _sensor_forms(z: np.ndarray, data: GriddedTrials) -> Forms:
    """Functions of the states z (K + 1, R, S) in which sensors may err, each of unit root mean square."""
    six, time = ca.SX.sym("six", 6), ca.SX.sym("time")
    psi, u, v, r = ca.vertsplit(six)[2:]
    forms = {
        "1": ca.SX(1), "u": u, "v": v, "r": r, "uu": u * u, "r|r|": r * ca.fabs(r), "t": time, "cos": ca.cos(psi),
        "sin": ca.sin(psi), "cos 2": ca.cos(2 * psi), "sin 2": ca.sin(2 * psi),
    }  # fmt: skip
    compared = np.asarray(data.good.any(axis=2))
    return of_unit_size(evaluated(forms, [six, time], [z[..., :6], data.t], compared), compared)[0]


@dataclass(frozen=True)
class _Differences:
    """Differences about a path: ``middle`` and ``begin`` of its steps, and its ``active`` states (A,)."""

    steps: TransitionModel
    data: GriddedTrials
    middle: Points
    begin: Points
    active: np.ndarray

    def action(self, row: int, small: float) -> Action:
        """What a ``row`` of the inputs does, by central differences: moved by ``small`` to either side."""

        def moved(at: Points, sign: int) -> Points:
            changed = at[1].copy()
            changed[row] += sign * small
            return at[0], changed, at[2]

        (K, R), A = self.data.inputs.shape[:2], len(self.active)
        wanted = np.concatenate([self.active, self.steps.S + np.arange(3)])  # states and latent force
        ends = [self.steps.advance(*moved(self.begin, sign)) for sign in (1, -1)]
        rates, jacobians = zip(*(self.steps.rates(*moved(self.middle, sign)) for sign in (1, -1)), strict=True)
        jacobian = ((jacobians[0] - jacobians[1]) / (2 * small))[:, self.active][:, :, wanted]
        return Action(
            step=((ends[0] - ends[1]) / (2 * small))[self.active].T.reshape(K, R, -1),
            rates=((rates[0] - rates[1]) / (2 * small))[:, self.active].reshape(K, R, -1),
            jacobian=jacobian.reshape(K, R, A, -1),
        )

    def of_input(self, name: str) -> Action:
        """The action of the input ``name``, and of it some time ago."""
        i, data = self.steps.model.controls.index(name), self.data
        x, k = data.inputs[..., i], time_scale(self.steps.ship.particulars["L"])
        delayed, per_second = [], []
        for delay in DELAYS:
            late = max(1, round(delay * k / data.h))
            values = x[np.maximum(np.arange(len(x)) - late, 0)] - x  # before the window the input is held
            factor = unit(values, data.inside)
            delayed.append(factor * values)
            per_second.append(1 / (factor * late * data.h) if factor else 0.0)
        action = self.action(i, DIFFERENCE[INPUTS[name][1]])
        return replace(action, delayed=np.stack(delayed), per_second=np.array(per_second))
