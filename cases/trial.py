"""A trial: one run of one ship, in SI units, radians and the frames of this product; and stretches of it that are left
out: their states become gaps, their inputs stay."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from cases.quantities import UNITS, is_canonical, quantity
from mmg.errors import (
    BadValue,
    Conflict,
    Missing,
    OutOfRange,
    TooFewData,
    UnknownName,
    as_array,
    by_name,
    check_name,
    refusing,
)
from mmg.messages import Message, html_table
from mmg.motion.flow import INPUTS, RUDDERS, STATES

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

# What makes trials of frames and arrays; by its name, as users look for it here and it knows trials.
READER = "cases.io.read"
MOST_ROWS = 2_500_000  # Of a trial. Set by hand: it bounds memory, to 240 MB
LEFT_OUT = "left_out"  # Code of the notice on what was left out
Span = tuple[float, float]  # Begin and end [s] on the clock of the file.
REQUIRED = ("psi", "u", "v", "r", "n", "delta")  # Columns without which nothing can be calibrated or predicted


def unwrapped(values: np.ndarray) -> np.ndarray:
    """Directions ``values`` (N,) [rad] without jumps of 2 pi, NaN where one is missing."""
    out = np.array(values, dtype=float)
    good = np.isfinite(out)
    out[good] = np.unwrap(out[good])
    return out


def as_column(trial: str, name: str, values: Any) -> np.ndarray:
    """The ``values`` of the column ``name`` of a ``trial``, (N,), read-only. Raises UserError where they are none."""
    column: np.ndarray = as_array(f"{trial}: column {name}", values, None).view()
    column.flags.writeable = False
    return column


@refusing
@dataclass(frozen=True, eq=False)
class Trial:
    """One run in canonical columns.

    Attributes
    ----------
    name: file stem, or the name given by the caller; UserError unless it is plain words (``mmg.errors``).
    columns: canonical name (see ``UNITS``) -> array of shape (N,), SI and radians. Always holds "t",
        strictly increasing, as stored (it need not start at zero). Missing samples are NaN. ``psi`` is
        as stored (possibly wrapped): use ``psi_unwrapped``. Optional columns that the file lacks are
        absent.
    path: where it was read from, if anywhere.
    sha256: hash of the file's bytes, or "".
    notices: messages with codes on everything converted, derived or assumed while reading.
    kind: "turning", "zigzag", "random", "berthing", ... or "".
    role: "train", "validate", "test" or "".
    std: standard errors of states that were derived and not measured, by column [their units].
    ancestors: columns that were not measured -> those from which they were derived; none for what was assumed. A name
        that is no column, such as "cog", is one that the log had and the trial has not.
    whole: the run with what was left out of this one (``left_out``), None where nothing was.
    """

    name: str
    columns: Mapping[str, np.ndarray]
    path: Path | None = None
    sha256: str = ""
    notices: tuple[Message, ...] | tuple[str, ...] = ()
    kind: str = ""
    role: str = ""
    meta: Mapping[str, str] = field(default_factory=dict)
    std: Mapping[str, float] = field(default_factory=dict)
    ancestors: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    whole: Trial | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        check_name(self.name, str(self.path or "trial"))
        # lists, or columns of pandas, become arrays; none is written to, as what is known of a trial is kept
        given = {name: as_column(self.name, name, values) for name, values in by_name(self.columns).items()}
        object.__setattr__(self, "columns", given)  # as a frozen dataclass is completed
        for name, values in given.items():
            if values.dtype.kind not in "fiub":
                raise BadValue(f"{self.name}: column {name} holds what is no number")
        shapes = {name: values.shape for name, values in given.items()}
        if "t" not in shapes or len(shapes["t"]) != 1:
            raise Missing(f"{self.name}: a trial needs a column t [s] of one dimension")
        for name, shape in shapes.items():
            if shape != shapes["t"]:
                raise Conflict(f"{self.name}: column {name} has shape {shape}, t has {shapes['t']}")
        if not (np.diff(self.columns["t"]) > 0).all():
            raise BadValue(f"{self.name}: t does not increase from sample to sample")

    @classmethod
    def from_pandas(
        cls, frame: pd.DataFrame, *, units: Mapping[str, str] | None = None, name: str = "trial", **settings: Any
    ) -> Trial:
        """The run in a DataFrame, a row per sample, read like a file, with the same checks and refusals.

        frame: columns named as in a trial file (docs/reference/trials.md), "u [kn]", or "u" with its unit in ``units``;
        without a column t its index is the time, numbers or stamps (of a zone: in UTC); a Dataset of xarray, whose
        units stand in its attributes, and a frame of polars or table of pyarrow do as well; units: by column; name: of
        the trial, plain words; settings: keys of ``trials.toml``, such as inputs="sampled", reference_point={"x":
        -42.0, "y": 0.0}, rudder_positive="port". Raises UserError, with the name of the column, for what cannot be read
        safely.
        """
        made: Trial = import_module(READER).trial_from_pandas(frame, name, units, settings)
        return made

    @classmethod
    def from_arrays(cls, *, name: str = "trial", units: Mapping[str, str] | None = None, **columns: Any) -> Trial:
        """The run in arrays (N,) by name: t [s], x, y [m], psi [rad], u, v [m/s], r [rad/s], n [1/s], delta [rad], ...

        units: of columns that are in others, by name, such as {"psi": "deg"}; name: of the trial; further keywords are
        settings, as of ``from_pandas``. Raises UserError as that does.
        """
        made: Trial = import_module(READER).trial_from_arrays(name, columns, units)
        return made

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw its track, north up, on ``ax`` (None: new axes), which it returns; without positions its velocities over
        time."""
        if ax is None:
            from matplotlib import pyplot  # late: slow to import

            ax = pyplot.subplots(layout="constrained")[1]
        if self.has_position:
            ax.plot(self["y"], self["x"], label=self.name)
            ax.plot(self["y"][:1], self["x"][:1], "k.")
            ax.set(xlabel="y, east [m]", ylabel="x, north [m]")
            ax.set_aspect("equal", adjustable="datalim")
        else:
            for name, scale, unit in (("u", 1.0, "m/s"), ("v", 1.0, "m/s"), ("r", math.degrees(1.0), "deg/s")):
                ax.plot(self.t - self.t[0], scale * self[name], label=f"{name} [{unit}]")
            ax.set(xlabel="time from the first sample [s]")
        ax.legend(fontsize=8, frameon=False)
        return ax

    def between(self, begin: float, end: float) -> Trial:
        """The samples from ``begin`` to ``end`` [s], both included, on the clock of the trial; so is trial[begin:end].
        Raises UserError where fewer than two lie there."""
        rows = (self.t >= begin - 1e-9) & (self.t <= end + 1e-9)  # 0.1 + 0.2 s is sample 0.3 s, too
        if rows.sum() < 2:
            span = f"it lasts from {self.t[0]:g} to {self.t[-1]:g} s"
            raise TooFewData(f"{self.name}: fewer than two samples from {begin:g} to {end:g} s; {span}")
        return self._with_rows({name: values[rows] for name, values in self.columns.items()}, rows)

    def resample(self, dt: float) -> Trial:
        """The run every ``dt`` [s] from its first sample on: states along lines, directions the short way round, inputs
        as they are read (held, or along lines where they were sampled). Missing where a neighbour is."""
        if not 0 < dt <= self.duration:
            raise OutOfRange(f"{self.name}: dt = {dt!r} s must be positive and no longer than its {self.duration:g} s")
        if self.duration / dt > MOST_ROWS:
            raise OutOfRange(f"{self.name}: dt = {dt!r} s makes more than {MOST_ROWS} samples; give a longer one")
        t = self.t[0] + dt * np.arange(math.floor(self.duration / dt + 1e-9) + 1)
        # neighbours of each new sample, both the same row where it lies on one
        after = np.clip(np.searchsorted(self.t, t - 1e-9), 0, len(self) - 1)
        before = np.clip(np.searchsorted(self.t, t + 1e-9, side="right") - 1, 0, len(self) - 1)
        columns = {"t": t}
        for name, values in self.columns.items():
            period = quantity(name).period if is_canonical(name) else 0.0
            if name in INPUTS and self.meta.get("inputs") != "sampled":
                columns[name] = values[before]
            elif name != "t":
                line = unwrapped(values) if period else values
                good = np.isfinite(line)
                interpolated = np.interp(t, self.t[good], line[good]) if good.any() else np.full(len(t), np.nan)
                columns[name] = np.where(good[before] & good[after], interpolated, np.nan)
        return self._with_rows(columns, None)

    def _with_rows(self, columns: dict[str, np.ndarray], rows: np.ndarray | None) -> Trial:
        """The trial with other rows; rows: those of its own that stay, None where they are made anew."""
        marks, meta = self.meta.get("bridged", ""), dict(self.meta)  # a mark for each row (``left_out``)
        if marks:
            kept = [] if rows is None else [mark for mark, row in zip(marks, rows, strict=True) if row]
            meta["bridged"] = "".join(kept)
        return replace(self, columns=columns, meta=meta, sha256="", whole=None)

    def __len__(self) -> int:
        return len(self.columns["t"])

    def __contains__(self, column: str) -> bool:
        return column in self.columns

    @overload
    def __getitem__(self, key: str) -> np.ndarray: ...
    @overload
    def __getitem__(self, key: slice) -> Trial: ...
    def __getitem__(self, key: Any) -> np.ndarray | Trial:
        """A column by its name, or the samples between two times [s], both included: trial[20.0:80.0]."""
        if not isinstance(key, slice):
            if not isinstance(key, str) or key not in self.columns:
                raise UnknownName(f"{self.name}: has no column {key!r}; it has {', '.join(self.columns)}")
            return self.columns[key]
        if key.step is not None:
            raise Conflict(f"{self.name}: trial[begin:end] takes times [s]; resample(dt) takes another interval")
        ends = (self.t[0] if key.start is None else key.start, self.t[-1] if key.stop is None else key.stop)
        return self.between(*ends)

    def __add__(self, other: Any) -> Any:
        """A ``TrialSet`` of both; other: a trial, a set, or paths."""
        return import_module("cases.trial_set").TrialSet((self,)) + other

    def __repr__(self) -> str:
        known = [self.kind or "trial", f"{len(self)} samples of {self.dt:.3g} s, {self.duration:.4g} s"]
        known += [f"role {self.role}"] if self.role else []
        return f"<Trial {self.name}: {', '.join(known)}; {', '.join(self.columns)}>"

    @property
    def t(self) -> np.ndarray:
        """Time as stored [s], shape (N,)."""
        return self.columns["t"]

    @property
    def dt(self) -> float:
        """Median sampling interval [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def duration(self) -> float:
        """Last minus first time stamp [s]."""
        return float(self.t[-1] - self.t[0])

    def measured(self, column: str) -> bool:
        """Whether ``column`` was measured, neither derived from others nor assumed."""
        return column in self.columns and column not in self.ancestors

    def roots(self, *columns: str) -> frozenset[str]:
        """The measured columns on which ``columns`` rest: themselves, or what they were derived from."""
        roots: set[str] = set()
        for name in columns:
            roots |= self.roots(*self.ancestors[name]) if name in self.ancestors else {name}
        return frozenset(roots)

    @property
    def has_position(self) -> bool:
        """True when x and y are measured."""
        return "x" in self.columns and "y" in self.columns

    @property
    def has_wind(self) -> bool:
        """True when the true wind is known (measured, or derived from the apparent wind on reading)."""
        return "wind_speed" in self.columns and "wind_direction" in self.columns

    @property
    def psi_unwrapped(self) -> np.ndarray:
        """Heading without jumps of 2 pi [rad], NaN where it is missing, shape (N,)."""
        return self.unwrapped("psi")

    def unwrapped(self, column: str) -> np.ndarray:
        """A ``column`` of directions [rad] without jumps of 2 pi, NaN where it is missing, shape (N,)."""
        return unwrapped(self[column])

    @property
    def rudder(self) -> np.ndarray:
        """Rudder angle [rad], of two rudders their mean, 0 for a ship that logs none, shape (N,)."""
        angles = [self[name] for name in RUDDERS if name in self]  # delta, the first, is that of all where it is logged
        return np.mean(angles[:1] if "delta" in self else angles, axis=0) if angles else np.zeros(len(self))

    @property
    def revolutions(self) -> np.ndarray:
        """Those of the propeller [1/s], 0 for a ship that logs none, as one with pods, shape (N,)."""
        return self["n"] if "n" in self else np.zeros(len(self))

    @property
    def wind_vector(self) -> np.ndarray:
        """Velocity of the air over ground, north and east components [m/s], shape (N, 2). The wind direction is *coming
        from*, so the vector is minus the unit vector of it. Zeros when the wind is not known."""
        if not self.has_wind:
            return np.zeros((len(self), 2))
        speed, direction = self["wind_speed"], self["wind_direction"]
        return np.column_stack([-speed * np.cos(direction), -speed * np.sin(direction)])

    @property
    def states(self) -> np.ndarray:
        """(x, y, psi unwrapped, u, v, r), shape (N, 6); x and y are NaN when not measured."""
        nothing = np.full(len(self), np.nan)
        x, y = (self["x"], self["y"]) if self.has_position else (nothing, nothing)
        return np.column_stack([x, y, self.psi_unwrapped, self["u"], self["v"], self["r"]])

    def to_pandas(self) -> Any:
        """The columns as a DataFrame, a row per sample, named as in a trial file: ``u [m/s]``."""
        import pandas as pd

        return pd.DataFrame({f"{name} [{UNITS.get(name, 'rps')}]": values for name, values in self.columns.items()})

    def _repr_html_(self) -> str:
        caption = f"{self.name}: {self.kind or 'trial'}, {len(self)} samples, {self.duration:g} s"
        rows = [
            (f"{name} [{UNITS.get(name, 'rps')}]", *(float(f(values)) for f in (np.nanmin, np.nanmean, np.nanmax)))
            for name, values in self.columns.items()
            if np.isfinite(values).any()
        ]
        return html_table(caption, ("column", "least", "mean", "greatest"), rows)

    def with_columns(self, **columns: np.ndarray) -> Trial:
        """A copy in which these ``columns``, name -> (N,), are replaced or added."""
        return replace(self, columns={**self.columns, **columns})

    def through_water(self, north: float, east: float) -> Trial:
        """The run as who drifts with a uniform current to ``north`` and ``east`` [m/s] sees it: positions from its
        begin on, velocities and wind relative to the water."""
        c, s, t = np.cos(self.psi_unwrapped), np.sin(self.psi_unwrapped), self.t - self.t[0]
        columns = {"u": self["u"] - (c * north + s * east), "v": self["v"] - (-s * north + c * east)}
        if self.has_position:
            columns |= {"x": self["x"] - north * t, "y": self["y"] - east * t}
        if self.has_wind:
            to_north, to_east = (self.wind_vector - (north, east)).T
            columns |= {"wind_speed": np.hypot(to_north, to_east)}
            columns |= {"wind_direction": np.arctan2(-to_east, -to_north) % (2 * np.pi)}
        return self.with_columns(**columns)


def inside(trial: Trial, spans: Sequence[Span]) -> np.ndarray:
    """Rows of ``trial`` in the ``spans``, ends included, (N,) of bool."""
    rows = np.zeros(len(trial), bool)
    for begin, end in spans:
        rows |= (trial.t >= begin - 1e-6) & (trial.t <= end + 1e-6)
    return rows


def left_out(trial: Trial, spans: Sequence[Span], why: str, moved: Sequence[Span] = ()) -> Trial:
    """``trial`` without the states of its rows in ``spans``, with a notice; with none it is marked as looked at.

    why: in words, where the spans are from; moved: those of the spans in which something else moved the ship, over
    which no prediction may run.
    """
    rows = inside(trial, spans)
    measured = inside(trial, [span for span in spans if span not in moved])
    columns = {name: np.where(rows, np.nan, trial[name]) for name in STATES if name in trial}
    # meta of a trial is text, as run folders and files keep it
    meta = {**trial.meta, "left_out": json.dumps([list(span) for span in spans]), "looked_at": "yes"}
    meta["bridged"] = "".join("1" if row else "0" for row in measured & rows) if rows.any() else ""
    notices = tuple(trial.notices)
    if rows.any():
        words = ", ".join(f"{begin:.1f} to {end:.1f} s" for begin, end in spans)
        seconds = float(rows.sum()) * trial.dt
        text = f"{trial.name}: {seconds:.1f} of {trial.duration:.0f} s left out ({words}): {why}"
        notices = (*notices, Message(text, LEFT_OUT))
    if not rows.any():
        return replace(trial, meta=meta)
    columns = {**trial.columns, **columns}
    return replace(trial, columns=columns, meta=meta, notices=notices, whole=trial.whole or trial)


def bridged(trial: Trial) -> np.ndarray:
    """Rows of ``trial`` without states over which a prediction may run all the same, (N,) of bool: the instruments
    broke there, the ship and her inputs did not."""
    marks = trial.meta.get("bridged", "")
    return np.array([mark == "1" for mark in marks]) if len(marks) == len(trial) else np.zeros(len(trial), bool)


def spans_left_out(trial: Trial) -> list[Span]:
    """Begin and end [s] of each stretch that was left out of ``trial``."""
    return [(float(begin), float(end)) for begin, end in json.loads(trial.meta.get("left_out", "") or "[]")]


def looked_at(trial: Trial) -> bool:
    """Whether it was decided what of ``trial`` is left out, by its sidecar or by the checks."""
    return trial.meta.get("looked_at") == "yes"
