"""Dictionary of unnamed forms: what could be wrong with a model in ways that the library of effects does not hold.

Forces in the three channels as products of velocities, inputs and wind; the action of each input scaled with the
state, or late by several times; errors of each sensor: bias, gain, lag, cross-talk, drift.
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
from diagnosis.hypotheses.force_forms import ForceForms, Forms, evaluated, of_unit_size, unit
from mmg.motion.flow import INPUTS
from mmg.motion.froude import time_scale

DELAYS = (0.5, 1.0, 2.0, 4.0)  # Times [s of a 3 m model] by which inputs may act late. Set by hand: factors of two.
SHAPES = ("1", "u", "v", "r", "|r|", "delta", "n")  # Forms by which the action of an input is scaled
AXES = ("surge", "sway", "yaw")
FORCES = tuple(f"{axis} force" for axis in AXES)  # Kinds of the forces that are products
AFTER_RUDDER = "force that swings after the rudder"  # Kind of the forces of what the rudder sets swinging
# Velocity of the water by its coefficient in the model.
WATER = {"stream to the north": "current.x", "stream to the east": "current.y"}
# Change of the water [m/s] by which its action is differentiated. Set by hand.
SMALL = 1e-3
Points = tuple[np.ndarray, np.ndarray, np.ndarray]  # States (S, M), inputs (C, M) and coefficients (all, M) of steps


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
        self.swings = self.force_forms.after_the_rudder(data)
        self.streams = differences.of_streams()
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
            *((AFTER_RUDDER, f"{form} {axis}") for form in self.swings.names for axis in AXES[1:]),
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
        parts.append(ProductColumns(push[..., 1:], self.swings.values))
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
        result.append(np.zeros(2 * len(self.swings.names)))  # they depend on inputs alone
        by_Z = np.where(self.data.good[..., None], at.adjoint.by_Z[..., : len(self.active) + 3], 0.0)
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

    def action(self, of: int, row: int, small: float) -> Action:
        """What a ``row`` of the inputs (``of`` 1) or coefficients (2) does, by central differences: moved by ``small``
        to either side."""

        def moved(at: Points, sign: int) -> Points:
            changed = at[of].copy()
            changed[row] += sign * small
            return (at[0], changed, at[2]) if of == 1 else (at[0], at[1], changed)

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
        action = self.action(1, i, DIFFERENCE[INPUTS[name][1]])
        return replace(action, delayed=np.stack(delayed), per_second=np.array(per_second))

    def of_streams(self) -> dict[str, Action]:
        """The action of the water's velocity."""
        symbols = self.steps.ship.symbols
        actions = {name: self.action(2, symbols.index(s), SMALL) for name, s in WATER.items() if s in symbols}
        return {name: a for name, a in actions.items() if a.step.any()}
