"""Draws of the coefficients from their posterior, by the no-U-turn sampler (Hoffman & Gelman 2014) of nutpie.

Drawn are the coefficients and the state at which each window begins: given these each window is one simulation, and the
adjoint of that gives the exact gradient at four times its cost. No state is eliminated and no marginal approximated.

The likelihood is that of the fit, to the power of one over the dispersion of its scores (``information_discount``):
residuals of a ship are more alike than any noise model says, and draws that took them at their word would lie closer
together than runs agree (Pace, Salvan & Sartori 2011; Holmes & Walker 2017). The prior counts whole. Sizes of noise
stay as they were estimated: they stand for as many errors as the correlation time leaves.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fitting.calibration import Calibration
from fitting.identifiability.analysis import information_discount
from fitting.nlp.fisher_information import Eliminated, Quadratics
from fitting.nlp.shooting import Shooting
from fitting.parallel import with_one_thread
from fitting.prediction.bands import NORMAL
from fitting.solvers.rollout_loss import RolloutLoss
from mmg.errors import NotCalibrated, NotInstalled, OutOfRange
from mmg.messages import LOGGER, Message, html_table

if TYPE_CHECKING:
    import pandas as pd

CHAINS = 4  # Chains whose agreement R-hat judges (Vehtari et al. 2021 ask for four).
TUNING = 200  # Draws of each chain that find the step, and are thrown away. Set by hand: the metric is known before.
AGREE = 1.01  # R-hat up to which chains count as draws of one distribution. (Vehtari et al. 2021, section 4.)
APART = "chains_apart"  # Code of the message that chains do not agree
NAMED = 3  # Coefficients named for which Laplace's interval is farthest off. Set by hand: display.
# Share of an interval by which its middle is off the median for it to be called skewed. Set by hand: a word.
SKEWED = 0.1


@dataclass(frozen=True, eq=False)
class Posterior:
    """Draws of the coefficients of a fit, and how far they can be trusted.

    trace: the draws as ``arviz.InferenceData``, a variable by coefficient [its own unit], with the statistics of the
    sampler; table: by coefficient mean, std, lower and upper end of the 90 % interval and median; wider: by what share
    that interval is wider than Laplace's, and skewness: what its middle is above the median, by its length; r_hat, and
    effective: number of independent draws that tell as much (bulk); power: of the likelihood; messages: on all of it.
    """

    trace: Any
    table: pd.DataFrame
    power: float
    messages: tuple[Message, ...]

    def to_pandas(self) -> pd.DataFrame:
        """The draws: a row by (chain, draw), a column by coefficient [its own unit]."""
        return self.trace.posterior.to_dataframe()[list(self.table.index)]

    @property
    def by_agreement(self) -> tuple[tuple[Message, ...], tuple[Message, ...]]:
        """The message that its chains do not agree, if they do not, and the others."""
        apart = tuple(m for m in self.messages if m.code == APART)
        return apart, tuple(m for m in self.messages if m.code != APART)

    def to_dict(self) -> dict[str, Any]:
        """What result.json holds under "posterior"."""
        rows = self.table.to_dict(orient="index")
        return {"power": self.power, "coefficients": rows, "messages": [str(m) for m in self.messages]}

    def save(self, folder: str | Path) -> None:
        """Write the draws to posterior.parquet in ``folder``. Raises OSError."""
        self.to_pandas().to_parquet(Path(folder) / "posterior.parquet")

    def __repr__(self) -> str:
        return f"<Posterior of {len(self.table)} coefficients: {'; '.join(self.messages)}>"

    def _repr_html_(self) -> str:
        rows = [(s, *row) for s, row in zip(self.table.index, self.table.to_numpy().tolist(), strict=True)]
        return html_table("; ".join(self.messages), ("coefficient", *self.table.columns), rows)


class JointDensity:
    """Minus the logarithm of the posterior density of the coefficients and of the first states of the windows.

    Its variables y (n,) are such that its Hessian is about the identity where multiple shooting ended, at 0; the first
    P make the coefficients. power: of the likelihood; covariance: (P, P), scaled, of the Laplace approximation.
    """

    def __init__(self, found: Calibration, power: float | None = None) -> None:
        """found: a calibration that converged; power: of the likelihood, None: as its errors ask for."""
        problem, x, info = found.problem, found.solution.x, found.information
        seg, S = problem.segments, problem.S
        self.problem, self.columns, self.rollouts = problem, problem.columns, RolloutLoss.of(problem, x)
        self.power = information_discount(info.of_data(), found.covariance) if power is None else power
        self.covariance = np.linalg.inv(self.power * info.fisher.sum(axis=0) + info.prior_information)
        # y to coefficients; standard errors
        self._root, self._width = np.linalg.cholesky(self.covariance), np.sqrt(np.diag(self.covariance))
        self.centre = np.clip(problem.split(x)[1], *problem.p_bounds())
        # given the coefficients, first states follow them, and scatter, as the quadratic of their window says
        eliminated = Eliminated.of(seg, Quadratics.of(problem, x), problem.kernels.elimination)
        self._follow = -np.linalg.solve(eliminated.rows[:, :, :S], eliminated.rows[:, :, S:])
        self._scatter = np.linalg.inv(np.swapaxes(np.linalg.cholesky(self.power * eliminated.rows[:, :, :S]), 1, 2))
        # a window is one interval here
        first, steps = np.unique(seg.node_window, return_index=True)[1], np.bincount(seg.window, seg.steps).astype(int)
        self._memory, self._remembered = problem.memory_weight[first], problem.measured_nodes[first, 6:]
        kernel, windows = problem.kernels.interval or problem.kernels.portable, np.arange(len(steps))
        self._shooting = Shooting(kernel, steps, self.rollouts.controls, seg.h, self.columns.window, windows)
        self.n = problem.P + S * len(steps)

    def __call__(self, y: np.ndarray) -> tuple[float, np.ndarray]:
        """Value and gradient (n,) at y (n,); infinite, with zeros, where a simulation diverges."""
        with np.errstate(all="ignore"):
            value, slope = self._of(y)
        good = np.isfinite(value) and np.isfinite(slope).all()
        return (value, slope) if good else (np.inf, np.zeros(self.n))

    def coefficients(self, y: np.ndarray) -> np.ndarray:
        """Coefficients (P,) in their units at y (n,), within their bounds."""
        prior = self.problem.prior
        return np.clip(prior.mean + prior.std * self.within(y)[0], prior.lower, prior.upper)

    def within(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """Scaled coefficients (P,), their slope by unbounded ones, slope and value of the sum of its logarithms.

        Unbounded ones are bent within a standard error of a bound and straight elsewhere, so that a metric fits both.
        """
        q, (lower, upper) = self.centre + self._root @ y[: self.problem.P], self.problem.p_bounds()
        below, above = (lower - q) / self._width, (q - upper) / self._width
        # two softplus: ends never pass a bound
        p = q + self._width * (np.logaddexp(0, below) - np.logaddexp(0, above))
        a, b = (0.5 + 0.5 * np.tanh(0.5 * x) for x in (below, above))  # the logistic function, without overflow
        slope = 1 - a - b
        bent = (a * (1 - a) - b * (1 - b)) / (self._width * slope)
        return p, slope, bent, float(np.log(slope).sum())

    def _of(self, y: np.ndarray) -> tuple[float, np.ndarray]:
        problem, columns, (p, slope, bent, volume) = self.problem, self.columns, self.within(y)
        P, S, W, scale = problem.P, problem.S, len(self._follow), problem.scale
        shift = np.broadcast_to((p - self.centre)[columns.each(columns.at, columns.window)], (W, problem.L))
        own = y[P:].reshape(W, S)
        start = self.rollouts.starts.T + scale * (_times(self._follow, shift) + _times(self._scatter, own))
        memory = start[:, 6:] - self._remembered
        cost, d_start, d_local = self._data(start, p)
        d_start *= self.power * scale
        d_start[:, 6:] += self._memory * memory * scale[6:]  # what came before the log has a prior of its own
        d_local = self.power * columns.each(problem.std, columns.window) * d_local
        d_local += _times(np.swapaxes(self._follow, 1, 2), d_start)
        d_p = columns.vector(columns.total(d_local, columns.window), P) + p  # the prior counts whole
        value = self.power * cost + 0.5 * float((self._memory * memory**2).sum() + p @ p) - volume
        if problem.captive:  # counts whole, by its stated accuracy
            shared, theta = slice(columns.shared), problem.captive_coefficients(p)
            value += problem.captive.cost(theta)
            d_p[shared] += problem.prior.std[shared] * problem.captive.gradient(theta)
        d_own = _times(np.swapaxes(self._scatter, 1, 2), d_start).reshape(-1)
        return value, np.concatenate([self._root.T @ (d_p * slope - bent), d_own])

    def _data(self, start: np.ndarray, p: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Cost of all samples, and its slopes by first states (W, S) and coefficients of each window (W, L), SI."""
        problem, loss, window = self.problem, self.rollouts, self.columns.window
        (W, S), L, h, theta = start.shape, problem.L, problem.kernels.measurement, problem.coefficients(p)
        end, inside = self._shooting.values(start.T, theta)
        states = np.concatenate([start.T[None], inside, end[None]])
        rows = len(states)
        points = np.ascontiguousarray(np.moveaxis(states, 1, 0)).reshape(S, -1)
        every = theta if theta.ndim == 1 else np.tile(theta[window].T, (1, rows))
        e = np.moveaxis(h.values(points, every).reshape(6, rows, W), 0, 1) - loss.targets
        we = loss.cost.weight(loss.weights, e) * e
        pull, direct = h.slope(points.T, np.moveaxis(we, 1, 2).reshape(-1, 6), every, L)
        pull = np.moveaxis(pull.reshape(rows, W, S), 2, 1)
        slope = self._shooting.gradient(start.T, theta, pull[1:-1], pull[-1])  # by the adjoint
        d_local = slope[:, S:] + (direct.reshape(rows, W, L).sum(axis=0) if len(direct) > 1 else 0.0)
        return 0.5 * float(loss.cost.cost(loss.weights, e).sum()), slope[:, :S] + pull[0].T, d_local


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Products (m, a) of matrices (m, a, b) and vectors (m, b)."""
    return (matrices @ vectors[:, :, None])[:, :, 0]


def needs_nutpie() -> None:
    """Raises UserError where nutpie is missing."""
    try:
        import nutpie  # noqa: F401
    except ImportError:
        raise NotInstalled(
            'draws by "nuts" need nutpie and ArviZ: pip install "mmg-ident[bayes]", or draw from the normal '
            "distribution: fit.sample(n)"
        ) from None


@with_one_thread
def sampled_posterior(found: Calibration, n: int, seed: int = 0) -> Posterior:
    """At least ``n`` draws from the posterior of the coefficients of the calibration ``found``, in CHAINS chains.

    seed: of the draws. Raises UserError for n < 1, for a calibration that did not converge or has no covariance,
    without nutpie.
    """
    if n < 1:
        raise OutOfRange(f"n = {n}: give at least one draw")
    if not found.converged or not np.isfinite(found.covariance).all():
        raise NotCalibrated("the fit did not converge or has no covariance, from which draws begin; fit it again first")
    needs_nutpie()
    began, density = time.perf_counter(), JointDensity(found)
    trace = draws_of_density(density, found.problem.prior.symbols, -(-n // CHAINS), seed)
    table = table_of(trace, density)
    return Posterior(trace, table, density.power, _messages(trace, table, density, time.perf_counter() - began))


def draws_of_density(density: JointDensity, symbols: tuple[str, ...], draws: int, seed: int) -> Any:
    """So many ``draws`` by chain from a ``density``, its coefficients by ``symbols``, as of nutpie, by ``seed``."""
    import nutpie
    from nutpie.compiled_pyfunc import from_pyfunc

    began = time.perf_counter()
    density(np.zeros(density.n))
    seconds = time.perf_counter() - began
    LOGGER.info(
        "drawing from the posterior: %d draws, %.1f ms of a processor for each of the 7 or more gradients of a draw",
        CHAINS * (draws + TUNING), 1e3 * seconds,
    )  # fmt: skip

    def log_density(y: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = density(y)
        return -value, -slope

    def named(*_: int) -> Callable[[np.ndarray], dict[str, np.ndarray]]:
        return lambda y: dict(zip(symbols, map(np.array, density.coefficients(y)), strict=True))

    def begin(own: int) -> np.ndarray:
        return np.random.default_rng(own).standard_normal(density.n)

    count, kind = len(symbols), np.dtype("float64")
    model = from_pyfunc(
        density.n, lambda: log_density, named, [kind] * count, [()] * count, list(symbols), make_initial_point_fn=begin
    )
    options = {"progress_bar": False, "save_warmup": False}
    return nutpie.sample(model, draws=draws, tune=TUNING, chains=CHAINS, seed=seed, **options)


def table_of(trace: Any, density: JointDensity) -> pd.DataFrame:
    """The table of a ``Posterior`` of the draws in a ``trace`` of the ``density``."""
    import arviz
    import pandas as pd

    prior, logger = density.problem.prior, logging.getLogger("arviz")
    values = np.array([trace.posterior[s].values for s in prior.symbols])  # (P, chains, draws)
    low, middle, high = np.quantile(values, (0.05, 0.5, 0.95), axis=(1, 2))
    centre, std = prior.mean + prior.std * density.centre, prior.std * np.sqrt(np.diag(density.covariance))
    ends = (np.clip(centre + side * NORMAL * std, prior.lower, prior.upper) for side in (-1, 1))
    before = np.subtract(*reversed(list(ends)))
    level = logger.level
    logger.setLevel(logging.ERROR)  # of few draws R-hat is no number, which the table says
    r_hat, effective = (np.array([float(f(v)) for v in values]) for f in (arviz.rhat, arviz.ess))
    logger.setLevel(level)
    columns = {
        "mean": values.mean(axis=(1, 2)), "std": values.std(axis=(1, 2)), "lower": low, "median": middle,
        "upper": high, "wider": (high - low) / before - 1, "skewness": 0.5 * (low + high - 2 * middle) / (high - low),
        "r_hat": r_hat, "effective": effective,
    }  # fmt: skip
    return pd.DataFrame(columns, index=pd.Index(prior.symbols, name="coefficient"))


def _messages(trace: Any, table: pd.DataFrame, density: JointDensity, seconds: float) -> tuple[Message, ...]:
    """What is to be known of the draws: effort and agreement, and where Laplace's approximation is off."""
    statistics, worst = trace.sample_stats, float(table["r_hat"].max())
    words = (
        f"{trace.posterior.sizes['draw']} draws in each of {CHAINS} chains in {seconds:.0f} s, likelihood to the power "
        f"{density.power:.2g}; R-hat at most {worst:.3f}, {table['effective'].min():.0f} effective draws or more"
    )
    found = [Message(words, "posterior")]
    lost = int(statistics["diverging"].sum())
    if not worst < AGREE or lost:
        words = f"the chains have not come together (R-hat below {AGREE} is wanted, {lost} divergences): draw more"
        found.append(Message(words, APART))
    farthest = table.loc[table["wider"].abs().sort_values(ascending=False).index[:NAMED]]
    told = [
        f"{s} {abs(row.wider):.0%} {'wider' if row.wider > 0 else 'narrower'}"
        + (f", skewed to {'larger' if row.skewness > 0 else 'smaller'} values" if abs(row.skewness) > SKEWED else "")
        for s, row in farthest.iterrows()
    ]
    words = f"90 % intervals by those of the Laplace approximation of the same density: {'; '.join(told)}"
    return (*found, Message(words, "against_laplace"))
