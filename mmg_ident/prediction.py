"""What ``mmg_ident.predict`` returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

    from cases.trial import Trial
    from fitting.prediction.predict import Window
    from mmg.messages import Message


@dataclass(frozen=True)
class Prediction:
    """Open-loop windows of one trial.

    trial: that was predicted; windows: each with its rows of the trial, predicted states and, where they are known,
    standard deviations; notes: on windows that were left out; outside: share of the rows that lie outside the data the
    network of a hybrid was trained on, None without a network; past_s: seconds before each window that were used.
    """

    trial: Trial
    windows: tuple[Window, ...]
    notes: tuple[Message, ...] = ()
    outside: float | None = None
    past_s: float = 0.0

    @property
    def diverged(self) -> int:
        """Number of windows whose prediction ends in numbers that are not finite."""
        import numpy as np

        return sum(not np.isfinite(w.states[-1]).all() for w in self.windows)

    @property
    def table(self) -> np.ndarray:
        """Rows window, t, x, y, psi, u, v, r in SI units, (N, 8), or with six standard deviations, (N, 14)."""
        import numpy as np

        parts = []
        for w in self.windows:
            columns = [np.full(len(w.states), float(w.number)), self.trial.t[w.first : w.last + 1], w.states]
            parts.append(np.column_stack(columns if w.std is None else [*columns, w.std]))
        return np.vstack(parts) if parts else np.empty((0, 8))

    def to_pandas(self) -> pd.DataFrame:
        """``table`` as a DataFrame, with the headers of the files that ``mmg predict`` writes."""
        import pandas as pd

        from fitting.prediction.predict import HEADER, STD_HEADER

        rows = self.table
        names = (HEADER + (STD_HEADER if rows.shape[1] > 8 else "")).split(",")
        return pd.DataFrame(rows, columns=names).astype({"window": int})

    def _repr_html_(self) -> str:
        from mmg.notebook import html_table

        last = [(w.number, *self.trial.t[[w.first, w.last]].tolist(), *w.states[-1].tolist()) for w in self.windows]
        header = ("window", "from [s]", "to [s]", "x [m]", "y [m]", "psi [rad]", "u [m/s]", "v [m/s]", "r [rad/s]")
        return html_table(f"{self.trial.name}: predicted states at the end of each window", header, last)
