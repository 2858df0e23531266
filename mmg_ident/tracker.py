"""A ship followed sample by sample: a Kalman filter of her states, of what disturbs her and of chosen coefficients.

It is the filter of a diagnosis (``diagnosis.estimation``), one sample at a time. The model is linearised where the
estimate stands (extended Kalman filter; Jazwinski 1970, Stochastic Processes and Filtering Theory, section 8.3) instead
of along a path that all samples have told. Forces X, Y, N and a uniform current are random states of first order that
fade in a forecast; chosen coefficients are constants that are not known exactly. The sizes of the forces are those that
the calibration estimated from its trials.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

import casadi as ca
import numpy as np

from cases.io.campaigns import ship_of_campaign
from diagnosis.estimation.linearisation import FIRST, SETTLED
from diagnosis.estimation.random_states import DIFFERENCE, LONGEST, Noise, RandomStates, deviations, disturbed
from diagnosis.estimation.transition_model import FORCE, step_faults
from fitting.nlp.shooting import PortableIntervals
from fitting.prediction.bands import NORMAL
from mmg.compile.batch import batch_functions
from mmg.compile.intervals import IntervalKernel, Lanes, derivatives
from mmg.errors import (
    BadValue,
    Missing,
    NoSolution,
    OutOfRange,
    UnknownName,
    Unsupported,
    as_array,
    by_name,
    finite,
    in_order,
    refusing,
    unknown,
)
from mmg.model import Model as SymbolicModel
from mmg.model import assemble, states_behind
from mmg.motion.flow import STATES
from mmg.motion.frames import wind_vector
from mmg.motion.froude import state_scale, time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship
from mmg_ident.api import content_of, predictor

if TYPE_CHECKING:
    import pandas as pd

    from mmg_ident.api import Model

MOST_STEPS = 100_000  # Between two samples, or of a forecast: two seconds of work. Set by hand.
WIND = ("wind_speed", "wind_direction")  # Inputs that may be left out: the air is calm then

Row: TypeAlias = "Mapping[str, float] | pd.Series[float] | Sequence[float] | np.ndarray"  # The first two by name


@dataclass(frozen=True)
class State:
    """What is known at time ``t`` [s].

    names: x, y, psi (continuous), u, v, r as they are logged, then the random states: "tow.X", "tow.Y", "tow.N" [N, N,
    N m], "current.x", "current.y" [m/s to the north and east] and the chosen coefficients; mean: (n,) of them, SI;
    covariance: (n, n). nis: squared distance of the last sample from what was expected of it, which follows chi-square
    with as many degrees of freedom as numbers were ``compared`` where the model holds (0 of the first sample).
    """

    t: float
    names: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray
    nis: float
    compared: int

    @property
    def std(self) -> np.ndarray:
        """Standard deviations (n,) of ``mean``."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def disturbance(self) -> np.ndarray:
        """Force X, Y [N] and moment N [N m] in body axes (3,) that the model does not explain."""
        return self.mean[[self.names.index(s) for s in FORCE]]

    def __getitem__(self, name: str) -> float:
        """The mean of the state of this ``name``."""
        if name not in self.names:
            raise UnknownName(unknown("state", name, self.names))
        return float(self.mean[self.names.index(name)])

    def __repr__(self) -> str:
        shown = ", ".join(f"{n} {m:.4g} ± {s:.2g}" for n, m, s in zip(self.names, self.mean, self.std, strict=True))
        return f"<State at {self.t:.6g} s: {shown}>"


@dataclass(frozen=True)
class Forecast:
    """What is to be expected: times ``t`` (N + 1,) [s], the first now; ``states`` (N + 1, 6) x, y, psi (continuous), u,
    v, r as they would be logged, SI; ``std`` (N + 1, 6) of logged less forecast."""

    t: np.ndarray
    states: np.ndarray
    std: np.ndarray

    @property
    def band(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper ends (N + 1, 6) of the 90 % band, of a normal distribution."""
        return self.states - NORMAL * self.std, self.states + NORMAL * self.std

    def to_pandas(self) -> pd.DataFrame:
        """A DataFrame with a row per time: t, the states, and their standard deviations as ``x_std`` and so on."""
        import pandas as pd

        names = ("t", *STATES, *(f"{s}_std" for s in STATES))
        return pd.DataFrame(np.column_stack([self.t, self.states, self.std]), columns=list(names))

    def __repr__(self) -> str:
        ends = ", ".join(
            f"{n} {m:.4g} ± {s:.2g}" for n, m, s in zip(STATES, self.states[-1], self.std[-1], strict=True)
        )
        return f"<Forecast of {self.t[-1] - self.t[0]:g} s, {len(self.t)} times; at its end {ends}>"


@refusing
class Tracker:
    """A filter of one run, fed sample by sample; ``forecast`` tells from the last sample on.

    model: a ship, her name or file, a run folder or the result of a calibration or training; coefficients: symbols that
    are estimated along, with the standard errors of the calibration, or symbol -> standard deviation; campaign: that of
    which the ship has the values; noise: sizes (``Noise``; default: those of the calibration); compiled: use C code.
    inputs: names of the controls. A copy (copy.deepcopy) or a pickle goes on by itself from where the tracker stands.
    Raises UserError for an unknown symbol or campaign, a coefficient without a standard deviation and a black box.
    """

    def __init__(
        self,
        model: Model,
        coefficients: Iterable[str] | Mapping[str, float] | pd.Series[float] = (),
        campaign: str | None = None,
        noise: Noise | None = None,
        compiled: bool = True,
    ) -> None:
        simulator = predictor(model)
        if not isinstance(simulator, Simulator):
            raise Unsupported(f"model: {model} is a black box, which has no states to track; give a ship or a run")
        stds = deviations(coefficients, simulator.ship)
        ship = disturbed(ship_of_campaign(simulator.ship, campaign))
        self.noise: Noise = noise or Noise.of(content_of(model).get("random_force"), ship)
        self.ship: Ship = ship
        self.inputs: tuple[str, ...] = (*ship.actuators, *WIND)
        self._longest = LONGEST * time_scale(ship.particulars["L"])
        random = RandomStates.of(ship, self.noise, stds)
        order = np.argsort([ship.symbols.index(s) for s in random.names])  # the equations have them as the ship does
        self._names, self._sizes, self._memories = random.names, random.sizes[order], random.memories[order]
        self._random = tuple(random.names[i] for i in order)
        self.equations: Equations = Equations(ship, self._random, compiled)
        places = np.argsort(order)  # back: State shows them in the order of their names
        self._means = self.equations.values[places]
        self._shown = np.eye(len(places) + self.equations.S)[self.equations.S + places]
        self._t: float | None = None
        self._began, self._z, self._P, self._held = 0.0, np.zeros(0), np.zeros((0, 0)), np.zeros(0)

    def update(self, t: float, measured: Row, controls: Row) -> State:
        """Take in a sample at time ``t`` [s]; the first one starts the states. Returns what is known then.

        measured: logged x, y [m], psi [rad, wrapped or not], u, v [m/s], r [rad/s] by name (a mapping or Series) or
        (6,), in the reference point of the trials; what is missing or nan is skipped. controls: by name or in the order
        of ``inputs``, units and signs as in trials, held until the next sample (the wind may be left out). Raises
        UserError for a time that does not grow, wrong names and lengths, controls that are no finite numbers, a first
        sample without heading, and where the model runs away.
        """
        logged = _row("measured", measured, STATES, STATES, math.nan)
        if np.isinf(logged).any():
            raise BadValue("measured: has an infinite number; leave out what is not known, or give nan")
        held = self._controls(controls)
        t = finite("t", t)
        if self._t is None:
            self._start(t, logged, held)
            return self._state(*self.equations.logged(self._z), 0.0, 0)
        if not t > self._t:
            raise OutOfRange(f"t: {t:g} s is not after the last sample at {self._t:g} s; samples must come in order")
        z, P = self._ahead(self._z, self._P, self._held, self._t, t)
        good = np.flatnonzero(np.isfinite(logged))  # columns that this sample has
        expected, H = self.equations.logged(z)
        error = logged - expected  # innovation (6,)
        error[2] = math.remainder(error[2], math.tau)  # of psi in (-pi, pi]: logged headings may be wrapped
        error, Z = error[good], H[good]
        # samples that come faster than their errors change tell no more together than one in ``interval`` does
        inflation = max(1.0, self.noise.interval / (t - self._t))
        PZ = P @ Z.T
        F = Z @ PZ  # covariance of the innovation, Z P Z' + R, where R is diagonal
        F.flat[:: len(good) + 1] += inflation * self.noise.sensors[good] ** 2
        solved = np.linalg.solve(F, np.column_stack([PZ.T, error]))  # one factorisation for gain and innovation
        change, P = PZ @ solved[:, -1], P - PZ @ solved[:, :-1]
        if not np.isfinite(change).all():  # before anything is stored: a refused sample leaves the state as it was
            raise NoSolution(f"measured: the model runs away before {t:g} s; begin anew with another Tracker")
        # symmetric again, as rounding would add up over many samples
        self._t, self._z, self._P, self._held = t, z + change, 0.5 * (P + P.T), held
        return self._state(*self.equations.logged(self._z), float(error @ solved[:, -1]), len(good))

    def forecast(self, seconds: float, controls: Row | pd.DataFrame | Sequence[Row] | None = None) -> Forecast:
        """What follows over the next ``seconds``, from the last sample.

        controls: held as they are (None), or as by name or (C,) in the order of ``inputs``; in N rows (N, C), or (N,)
        by name, evenly spread over the ``seconds`` and each held over its part. The forecast has a row at each end of
        these parts, else steps of a second of a 3 m model. The disturbance fades.
        Raises UserError before the first sample, for seconds that are not positive and for controls as ``update`` does.
        """
        if self._t is None:
            raise Missing("forecast: no sample has come yet; update the tracker first")
        if not (seconds := finite("seconds", seconds)) > 0:
            raise OutOfRange(f"seconds: {seconds:g} must be positive")
        held = self._ahead_controls(controls, seconds)
        times = self._t + seconds * np.arange(len(held) + 1) / len(held)
        z, P, rows = self._z, self._P, [self._logged(self._z, self._P)]
        for now, then, row in zip(times[:-1], times[1:], held, strict=True):
            z, P = self._ahead(z, P, row, now, then)
            rows.append(self._logged(z, P))
        states, variances = (np.array(part) for part in zip(*rows, strict=True))
        return Forecast(times, states, np.sqrt(variances + self.noise.sensors**2))  # of what would be logged

    def _start(self, t: float, logged: np.ndarray, held: np.ndarray) -> None:
        """The state at the first sample: what is not measured is 0 and as good as unknown."""
        measured, model = np.isfinite(logged), self.equations.model
        if not measured[2]:
            raise Missing("measured: the first sample needs psi [rad], about which all else turns")
        # columns (6, 7): as logged, and each moved by a step, for the derivatives of the states by what is logged
        columns = np.where(measured, logged, 0.0)[:, None] + np.column_stack([np.zeros(6), DIFFERENCE * np.eye(6)])
        z = states_behind(model, columns, np.repeat(np.append(held, 0.0)[:, None], 7, axis=1), self.ship.values)
        std = np.where(measured, self.noise.sensors, FIRST * state_scale(self.ship.particulars["L"]))
        slope = (z[:, 1:] - z[:, :1]) / DIFFERENCE * std
        S, n = len(z), len(z) + len(self._random)
        P, random = np.zeros((n, n)), np.arange(S, n)
        P[:S, :S], P[random, random] = slope @ slope.T, self._sizes**2
        P[np.arange(6, S), np.arange(6, S)] += (SETTLED * model.sizes) ** 2  # lags need not have settled
        self._began, self._t, self._held = t, t, held
        self._z, self._P = np.concatenate([z[:, 0], np.zeros(n - S)]), P

    def _ahead(
        self, z: np.ndarray, P: np.ndarray, held: np.ndarray, now: float, then: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """States and covariance at the time ``then`` under the inputs ``held`` from the time ``now`` on."""
        count = self._parts("t", then - now)
        h = (then - now) / count
        decay = np.exp(-h / self._memories)  # of a random state of first order over a step; 1 of a constant
        S = len(z) - len(decay)
        random = np.arange(S, len(z))
        A = np.zeros_like(P)  # transition (n, n): that of the states by all, that of the random ones by themselves
        A[random, random] = decay
        for k in range(count):
            end, A[:S] = self.equations.step(z, np.append(held, now + k * h - self._began), h)
            z = np.concatenate([end, decay * z[S:]])
            P = A @ P @ A.T
            P[random, random] += self._sizes**2 * (1 - decay**2)  # so that their variance at rest stays sizes**2
        return z, P

    def _parts(self, argument: str, seconds: float) -> int:
        """Number of steps over ``seconds``. Raises UserError, with the name of the ``argument``, for too many."""
        count = max(1, math.ceil(seconds / self._longest - 1e-9))  # 1e-9: rounding of an exact multiple
        if count > MOST_STEPS:
            most = f"{MOST_STEPS * self._longest:.3g}"
            raise OutOfRange(f"{argument}: {seconds:g} s ahead is more than {most}; begin anew with another Tracker")
        return count

    def _logged(self, z: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Logged columns (6,) and their variances."""
        y, H = self.equations.logged(z)
        return y, ((H @ P) * H).sum(axis=1)  # the diagonal of H P H' alone

    def _state(self, logged: np.ndarray, H: np.ndarray, nis: float, compared: int) -> State:
        """The state now: ``logged`` columns (6,) with their derivatives H (6, n), and the random states."""
        show = np.concatenate([H, self._shown])
        mean = np.concatenate([logged, self._means + self._shown @ self._z])
        return State(self._t, (*STATES, *self._names), mean, show @ self._P @ show.T, nis, compared)  # type: ignore[arg-type]

    def _controls(self, given: Row) -> np.ndarray:
        """Inputs of the model but the time, from controls by name or in their order."""
        row = _row("controls", given, self.inputs, WIND)
        if not np.isfinite(row).all():
            names = ", ".join(n for n, value in zip(self.inputs, row, strict=True) if not math.isfinite(value))
            raise BadValue(f"controls: {names} is no finite number; give the last known value")
        row[-2:] = wind_vector(*row[-2:])  # of the air, to the north and east
        return row

    def _ahead_controls(self, given: Any, seconds: float) -> list[np.ndarray]:
        """Inputs over each part of the next ``seconds``."""
        count = self._parts("seconds", seconds)
        if given is None:
            return [self._held] * count
        given = by_name(given)
        if isinstance(given, dict):
            try:
                columns = np.broadcast_arrays(*given.values())
            except ValueError:
                raise BadValue("controls: columns of different lengths; give as many rows of each") from None
            if columns and columns[0].ndim == 1:
                return [self._controls(dict(zip(given, row, strict=True))) for row in np.column_stack(columns)]
            return [self._controls(given)] * count
        if as_array("controls", given, None).ndim == 2 and len(given):
            return [self._controls(row) for row in given]
        return [self._controls(given)] * count


class Equations:
    """Steps of a ``ship`` and her logged columns, with derivatives by her S states and the coefficients ``random``, in
    the order of the ship.

    A point z holds the states and how far the coefficients are from the ship's ``values``. The length of a step is an
    input of the equations, so that one code does all of them.
    """

    def __init__(self, ship: Ship, random: Sequence[str], compiled: bool) -> None:
        self.model: SymbolicModel = assemble(ship)
        self.S: int = len(self.model.states)
        self._made_of = ship, tuple(random), compiled
        self._theta = ship.values.copy()
        self._at = np.array([ship.symbols.index(s) for s in random])
        self.values: np.ndarray = self._theta[self._at]
        sizes = {"q": self.S, "c": len(self.model.controls), "h": 1, "theta": len(ship.symbols)}
        q, c, h, theta = (ca.SX.sym(name, size) for name, size in sizes.items())
        # increments h * rates with h as a further input: the kernel below steps by 1
        increments = derivatives(ca.cse(h * self.model.rates(q, c, theta)), q, ca.vertcat(c, h), theta, self._at, False)
        y = self.model.columns(q, theta)
        slope = ca.densify(ca.jacobian(y, ca.vertcat(q, *[theta[int(i)] for i in self._at])))
        logged = ca.Function("logged", [q, theta], [ca.densify(y), slope], {"cse": True})
        what, one = f"the filter of {ship.name}", np.zeros(1, dtype=int)
        self._lanes = Lanes.of(one + 1, np.zeros((1, increments.numel_in(1), 1)), 1.0, one, one)  # one run, one step
        wanted = np.arange(self.S), np.arange(self.S + len(random))
        kernel = IntervalKernel.of(increments, partial(step_faults, increments), what)[0] if compiled else None
        self.is_compiled: bool = kernel is not None
        if kernel is not None:
            self._step = kernel.repeated(self._lanes, self._theta[None], wanted)
        else:
            portable, pull = PortableIntervals(increments), np.zeros((0, self.S, 1))
            self._step = lambda z, theta: portable.linearise(self._lanes, z, theta, pull, wanted)[:2]
        self._columns = batch_functions([logged], self.is_compiled, what)[0][0]
        # without instruments the logged columns are the first six states: no code is called for them
        self._plain = None if self.model.measured else np.eye(6, self.S + len(random))

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles are made anew: a step calls C code on arrays of this object, which nobody shares."""
        return Equations, self._made_of

    def _coefficients(self, z: np.ndarray) -> np.ndarray:
        theta = self._theta  # in place: a copy a sample is not needed, as nobody keeps it
        theta[self._at] = self.values + z[self.S :]
        return theta

    def step(self, z: np.ndarray, inputs: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        """States (S,) a step of ``h`` [s] after the point z (n,) under ``inputs`` (C,), with derivatives (S, n)."""
        self._lanes.controls[0, :-1], self._lanes.controls[0, -1] = inputs[:, None], h
        end, slope = self._step(z[: self.S, None], self._coefficients(z)[None])
        return end[:, 0], slope[0]

    def logged(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Logged columns (6,) at the point z (n,), and their derivatives (6, n)."""
        if self._plain is not None:
            return z[:6], self._plain
        y, slope = self._columns.at(z[: self.S, None], self._coefficients(z))
        return y[:, 0], slope[:, 0].reshape(len(z), 6).T


def _row(argument: str, given: Row, names: Sequence[str], optional: Sequence[str], left_out: float = 0.0) -> np.ndarray:
    """Numbers (n,) in the order of ``names`` from an argument by name or in that order; ``optional``, the last ones:
    those that may lack, and are ``left_out`` then. Raises UserError, with the name of the argument."""
    given = in_order(argument, given, names, optional, left_out)
    row = np.array(as_array(argument, given))  # a copy, which the caller may change
    if row.shape == (len(names) - len(optional),):
        row = np.append(row, np.full(len(optional), left_out))
    if row.shape != (len(names),):
        raise BadValue(f"{argument}: has shape {row.shape}, not ({len(names)},): {', '.join(names)}")
    return row
