"""The result of a calibration: typed values, the ships behind them, its folder, and how it shows itself.

A run folder holds ``ship.toml`` (the calibrated ship), ``start.toml`` (the ship before), ``result.json``,
``iterate.safetensors`` (from which a fit can be resumed), ``loss.safetensors`` (by which a network can be trained), the
ship's network if it has one, ``figures/`` and ``report.html``. It appears whole or not at all.
"""

from __future__ import annotations

import re
import shutil
import textwrap
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from dataclasses import replace as changed
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal, overload

import numpy as np
from safetensors.numpy import save_file

from cases.shipfiles.network_file import NETWORK, load_network, save_network
from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.trial import Trial
from fitting.record import CoefficientRow, FigureRow, FitObjects, FitRecord, MessageRow, read_record
from fitting.report import run_folder
from fitting.report.plot_style import FigureFolder
from fitting.solvers.control import left_out_message, unless_interrupted
from mmg.errors import Missing, UnknownName, UserError, name_fault, refusing, unknown, whole
from mmg.messages import html_table
from mmg.rollout import Simulator
from mmg.ship import Ship

if TYPE_CHECKING:
    import pandas as pd

    from fitting.calibration import Calibration
    from fitting.report.plots import FitAxes
    from fitting.report.use import Delivered
    from fitting.solvers.reduced import ReducedProblem
    from fitting.solvers.rollout_loss import RolloutLoss
    from fitting.uncertainty.posterior import Posterior

METHODS = ("laplace", "nuts")  # Ways to draw coefficients
MOST_DRAWS = 1_000_000  # Set by hand: of 63 coefficients they take half a gigabyte.
SUMMED_UP = 8  # Coefficients and warnings of a summary. Set by hand: a screen.


@refusing
@dataclass(frozen=True, kw_only=True, eq=False)  # equal where its record is
class FitResult(FitRecord):
    """A calibrated ship and all that is known of it.

    ship, start: the ship after and before. iterate: scaled coefficients "p", node states "nodes" and "sigma", from
    which a fit can be resumed. objects: what its folder does not hold; None for a result that was read. folder: from
    which it was read, or to which it was saved. model: what a scaled ship was scaled from.
    """

    ship: Ship
    start: Ship
    iterate: dict[str, np.ndarray] | None = None
    objects: FitObjects | None = None
    folder: Path | None = None
    model: FitResult | None = None

    @property
    def calibration(self) -> Calibration | None:
        """The solver's own account; None for a result that was read from a folder."""
        return self.objects.calibration if self.objects else None

    @property
    def problem(self) -> ReducedProblem:
        """What was minimised, as a function of the free coefficients alone, for optimisers and samplers from outside.
        Raises UserError for a result that was read from a folder."""
        from fitting.solvers.reduced import ReducedProblem

        found = self.fitted_objects.calibration
        return ReducedProblem(found.problem, found.solution.x)

    @property
    def loss(self) -> RolloutLoss | None:
        """What its coefficients were calibrated by, to train a network by it; None where that is not known. Raises
        UserError where the file of it cannot be read or is of another version."""
        from fitting.solvers.rollout_loss import RolloutLoss, loss_in

        if self.objects:
            return RolloutLoss.of_calibration(self.objects.calibration, self.objects.calibration.trials)
        return loss_in(self.folder / run_folder.LOSS) if self.folder else None

    @property
    def fitted_objects(self) -> FitObjects:
        """``objects``. Raises UserError for a result that was read from a folder, which has none."""
        if self.objects is None:
            raise Missing(f"{self.folder}: was read from its folder, which has no trials; calibrate them again")
        return self.objects

    @property
    def plot(self) -> FitAxes:
        """Its figures: ``fit.plot.tracks(ax)``, ``coefficients``, ``correlation``, ``forces``,
        ``residuals``."""
        from fitting.report.plots import FitAxes  # late: matplotlib is slow to import

        return FitAxes(self, self.start, self.ship, self.objects)

    def without_parts(self, name: str) -> FitResult:
        """The result with the warning that Ctrl-C left out the part ``name``."""
        message = left_out_message([name])
        return changed(self, messages=(MessageRow("warning", message.code, message), *self.messages))

    @property
    def coefficients(self) -> pd.DataFrame:
        """A row per free coefficient by its symbol: value, std, unit, bounds, prior, its share, verdict."""
        import pandas as pd

        names = ["value", "std", "unit", "lower", "upper", "at_bound", "prior_value", "prior_std", "prior_share",
                 "verdict", "description"]  # fmt: skip
        rows = [[getattr(row, name) for name in names] for row in self.estimates.values()]
        return pd.DataFrame(rows, index=pd.Index(self.estimates, name="coefficient"), columns=names)

    def to_pandas(self) -> pd.DataFrame:
        """``coefficients``, under the name that every result's table has."""
        return self.coefficients

    @property
    def _best_known(self) -> list[tuple[str, CoefficientRow]]:
        """The coefficients, those first of which the data say most beside the prior."""
        # 2: beyond all shares
        return sorted(self.estimates.items(), key=lambda row: 2.0 if row[1].prior_share is None else row[1].prior_share)

    def summary(self) -> str:
        """What one wants to know first, in lines: data, errors, verdicts, best determined coefficients, warnings."""
        from fitting.prediction.unit_errors import STATE_ERRORS

        lines = [repr(self).strip("<>"), f"{self.seconds_used:.0f} s of data; loss {self.settings.loss}"]
        for name, pair in self.scores.items():
            if pair.before.units and pair.after.units:
                before, after = pair.before.units.pooled, pair.after.units.pooled
                told = (
                    (label, unit, getattr(before, k), getattr(after, k)) for k, (label, unit) in STATE_ERRORS.items()
                )
                each = ", ".join(f"{label} {a:.3g} -> {b:.3g} {unit}" for label, unit, a, b in told if a and b)
                lines.append(f"{name}, rms over windows: {each}")
        rows = self._best_known
        lines += [
            f"  {s:<10} {c.value:>11.4g} +- {c.std or 0:.2g} {c.unit} {c.verdict}".rstrip() for s, c in rows[:SUMMED_UP]
        ]
        if len(rows) > SUMMED_UP:
            lines.append(f"  and {len(rows) - SUMMED_UP} others: fit.coefficients")
        lines += [textwrap.shorten(f"warning: {words}", 160) for words in self.warnings[:SUMMED_UP]]
        return "\n".join(lines)

    @property
    def covariance(self) -> pd.DataFrame:
        """Covariance (P, P) of the estimates in their units, coefficient by coefficient: robust to autocorrelated
        residuals, with half the distance between two estimates. Raises UserError where it could not be computed."""
        import pandas as pd

        symbols, matrix = self._correlated
        std = np.array([self.estimates[s].std for s in symbols], dtype=float)
        return pd.DataFrame(np.outer(std, std) * matrix, index=symbols, columns=symbols)

    @property
    def _correlated(self) -> tuple[list[str], np.ndarray]:
        symbols, matrix = list(self.correlation.symbols), np.array(self.correlation.matrix, dtype=float)
        if not np.isfinite(matrix).all() or any(self.estimates[s].std is None for s in symbols):
            raise Missing(f"{self.ship.title}: has no covariance; add trials that excite more, or fix coefficients")
        return symbols, matrix

    @overload
    def sample(self, n: int, method: Literal["laplace"] = "laplace", seed: int = 0) -> pd.DataFrame: ...

    @overload
    def sample(self, n: int, method: Literal["nuts"], seed: int = 0) -> Posterior: ...

    def sample(self, n: int, method: str = "laplace", seed: int = 0) -> pd.DataFrame | Posterior:
        """``n`` draws of the coefficients, in their units and within their bounds.

        method: "laplace", from the normal distribution of ``covariance`` about the estimates: a DataFrame (n, P), draws
        beyond a bound put on it; or "nuts", from the posterior of multiple shooting itself, by the no-U-turn sampler on
        its exact gradient: a ``Posterior`` of n draws or a few more. seed: of the draws. Raises UserError for n or seed
        that are no whole numbers or too small, an unknown method, a fit without covariance, and for "nuts" without
        nutpie or for a result from a folder.
        """
        n, seed = whole("n", n, 1, MOST_DRAWS), whole("seed", seed, 0)
        if method not in METHODS:
            raise UnknownName(unknown("method", method, METHODS))
        correlation = self._correlated
        if method == "nuts":
            from fitting.uncertainty.posterior import sampled_posterior

            return sampled_posterior(self.fitted_objects.calibration, n, seed)
        import pandas as pd

        from cases.simulation.simulate_batch import draw_coefficients

        return pd.DataFrame(draw_coefficients(self.ship, n, seed, correlation))[correlation[0]]

    def __repr__(self) -> str:
        state = "converged" if self.converged else f"not converged ({self.status})"
        # of a verdict what stands before its reason, its partners and its share; of a scaled ship that of the model
        kinds = (row.verdict.rpartition("; there: ")[2] for row in self.estimates.values())
        verdicts = Counter(re.split(r"[:(,]|with ", kind)[0].strip() for kind in kinds)
        counts = ", ".join(f"{count} {verdict}" for verdict, count in verdicts.items())
        warned = f"; {len(self.warnings)} warnings" if self.warnings else ""
        return f"<FitResult {self.ship.title}: {state}, {len(self.data)} trials; coefficients: {counts}{warned}>"

    def _repr_html_(self) -> str:
        state = "converged" if self.converged else f"NOT CONVERGED ({self.status})"
        scores = "".join(
            f"; {name}: position {pair.before.units.pooled.position_m:.3g} → {pair.after.units.pooled.position_m:.3g} m"
            for name, pair in self.scores.items()
            if pair.before.units and pair.after.units
        )
        rows = [(s, c.value, c.std, c.unit, c.prior_value, c.verdict) for s, c in self._best_known]
        header = ("coefficient", "value", "std", "unit", "prior", "verdict")
        return html_table(f"{self.ship.title}, {state}{scores}", header, rows)

    def save(
        self,
        folder: str | Path,
        replace: bool = False,
        attach: Callable[[Path], None] | None = None,
        numbers: Callable[[FitResult], None] | None = None,
        report: bool = True,
    ) -> FitResult:
        """Write the run folder ``folder``, which must not exist unless ``replace``; returns the result as it was saved.

        attach: writes further files that belong to it, which appear together with it, into the folder that it is given;
        numbers: called with the result when all but figures and page is written; report: with figures and page.

        Figures are drawn where ``objects`` are known, and copied where the result was read from another folder. They
        and the page come last: one that fails is a warning. Raises UserError where it is no path, exists or cannot be
        written.
        """
        target = Path(folder)
        if not replace:
            run_folder.check_target(target)
        named = self._named(target)
        # stays in the file if drawing is cut short
        warning = MessageRow("warning", run_folder.PENDING.code, run_folder.PENDING)
        pending = (warning,) if report and self.objects else ()
        run_folder.write_whole(target, partial(named._fill, pending=pending, attach=attach), replace)
        if numbers:
            numbers(named)
        return changed(named._illustrated(target) if report else named, folder=target)

    def _named(self, folder: Path) -> FitResult:
        """The result with the name of its ``folder`` for a calibration that has none."""
        mark = self.ship.mark
        if mark is None or mark.name:
            return self
        from fitting.report.page import label_of  # late: jinja is slow to import

        own = label_of(folder)
        mark = changed(mark, name=self.ship.name if name_fault(own) else own)
        return changed(self, ship=changed(self.ship, mark=mark), mark=dict(vars(mark)))

    def _fill(
        self, scratch: Path, pending: tuple[MessageRow, ...] = (), attach: Callable[[Path], None] | None = None
    ) -> None:
        state = "calibrated" if self.converged else "NOT CONVERGED, best iterate"
        note = f"{self.ship.title}, {state} by mmg fit; std is the standard error of each estimate."
        if self.scaling is not None:
            note = f"{self.ship.name}, scaled from {self.scaling['model']['ship']} by mmg scale; with its std."
        (scratch / run_folder.SHIP).write_text(dump_ship(self.ship, note), encoding="utf-8")
        (scratch / run_folder.START).write_text(dump_ship(self.start, "The ship before calibration."), encoding="utf-8")
        if self.iterate:
            save_file({k: np.ascontiguousarray(v) for k, v in self.iterate.items()}, scratch / run_folder.ITERATE)
            (scratch / run_folder.ITERATE).chmod(0o644)  # safetensors gives it to its owner alone
        if loss := self.loss:
            loss.save(scratch / run_folder.LOSS)
        if self.objects and self.objects.posterior:
            self.objects.posterior.save(scratch)
        if self.ship.network is not None:
            save_network(scratch / NETWORK, self.ship.network, self.ship)
        if self.folder and (self.folder / run_folder.FIGURES).is_dir() and not self.objects:
            shutil.copytree(self.folder / run_folder.FIGURES, scratch / run_folder.FIGURES)
        if self.model is not None:
            (scratch / run_folder.MODEL).mkdir()
            changed(self.model, objects=None, figures=(), folder=None)._fill(scratch / run_folder.MODEL)
        if attach:
            attach(scratch)
        saved = changed(self, figures=(), messages=(*pending, *self.messages)) if self.objects else self
        run_folder.write_json(scratch / run_folder.RESULT, saved.to_dict())

    def _illustrated(self, folder: Path) -> FitResult:
        """The result with the figures and the page that could be made in its ``folder``."""
        from fitting.report.page import build_page, write_page
        from fitting.report.plots import write_figures
        from fitting.report.use import Delivered  # late: matplotlib is slow to import

        began, done, objects = time.perf_counter(), self, self.objects
        written = FigureFolder(folder / run_folder.FIGURES)
        if objects:
            models = objects.before, objects.after
            draw = partial(write_figures, written, self, models, objects.trials, objects.validation)
            with written.making("figures"):
                if unless_interrupted(lambda: (draw(),)) is None:  # a tuple: None of ``draw`` is no interruption
                    written.failures.append(left_out_message(["figures"]))
            done = self._with_figures(written, time.perf_counter() - began)
        with written.making(run_folder.PAGE):
            trials = (*objects.trials, *objects.validation) if objects else ()
            write_page(build_page([(done, done.ship, folder)], [Delivered(trials)]), folder / run_folder.PAGE)
        if objects:  # last, as it says that all is there
            done = self._with_figures(written, time.perf_counter() - began)
            with written.making(run_folder.RESULT):
                run_folder.write_json(folder / run_folder.RESULT, done.to_dict())
        return done

    def with_late_figures(self, trials: Sequence[Trial]) -> FitResult:
        """The result with figures drawn into its ``folder``, where it was saved without a report.

        trials: its own that are at hand, for tracks. As given where it has figures already.
        """
        from cases.trial_set import TrialSet, ready
        from fitting.report.plots import write_figures

        if self.figures or self.scaling is not None or self.folder is None:
            return self
        names = {row.name for row in self.validation_data}
        apart = (tuple(t for t in trials if (t.name in names) is held) for held in (False, True))
        train, held_out = map(TrialSet, apart)
        with suppress(UserError):  # fitted all the same (--unchecked)
            train, held_out = ready(train, held_out)
        models = Simulator(self.start, self.compiled), Simulator(self.ship, self.compiled)  # before and after
        written = FigureFolder(self.folder / run_folder.FIGURES)
        with written.making("figures"):
            write_figures(written, self, models, train, held_out)
            run_folder.write_json(self.folder / run_folder.RESULT, (done := self._with_figures(written, 0.0)).to_dict())
            return done
        return self

    def _with_figures(self, written: FigureFolder, seconds: float) -> FitResult:
        """The result with the figures that were ``written`` in so many ``seconds``, and what failed."""
        failed = (MessageRow("warning", m.code, m) for m in written.failures)
        wall = self.timings_s.get("wall", 0.0) + seconds
        return changed(
            self,
            figures=tuple(FigureRow(**row) for row in written.rows),
            messages=(*failed, *self.messages),
            timings_s={**self.timings_s, "wall": wall},
        )


def read_fit(folder: str | Path) -> FitResult:
    """The result in a run folder of a calibration.

    Raises UserError for a folder that is none, or whose result.json lacks keys or holds wrong ones, all named.
    """
    where = Path(folder)
    record = read_record(where / run_folder.RESULT, run_folder.read_result(where))
    start, network = load_ship(where / run_folder.START), where / NETWORK
    start = start.with_network(load_network(network, start)) if network.exists() else start
    iterate = run_folder.read_iterate(where) if (where / run_folder.ITERATE).exists() else None
    model = read_fit(where / run_folder.MODEL) if (where / run_folder.MODEL).is_dir() else None
    return FitResult(**vars(record), ship=load_ship(where), start=start, iterate=iterate, folder=where, model=model)


def write_report(
    folders: Sequence[str | Path],
    out: str | Path,
    full_load: float | None = None,
    imo: bool = True,
    known: Sequence[Delivered] | None = None,
) -> str:
    """Write one self-contained HTML page on the run folders ``folders`` to the file ``out``; returns it.

    full_load: draught [m] of the fully loaded ship, to which tested figures are corrected; imo: with the form for IMO,
    whose figures are simulated; known: of each folder, where it was simulated already. Raises UserError for a folder
    that is no calibration, a draught that makes no sense, and for a file that cannot be written.
    """
    from fitting.report.page import build_page, write_page
    from fitting.report.use import delivered  # late: matplotlib is slow to import

    results = [read_fit(folder) for folder in folders]
    known = known or [delivered(r.to_dict(), r.ship, full_load, imo) for r in results]
    results = [r.with_late_figures(one.trials) for r, one in zip(results, known, strict=True)]
    text = build_page([(r, r.ship, Path(f)) for r, f in zip(results, folders, strict=True)], known)
    write_page(text, Path(out))
    return text
