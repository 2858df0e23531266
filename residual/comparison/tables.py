"""The tables of a comparison as markdown and as plain values."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fitting.report.run_folder import data_rows
from residual.comparison.published import TABLE_9, TABLE_9_NOTE, TABLE_9_TEST
from residual.comparison.study import HORIZONS, Comparison, Entry

METRICS = {"window": "30 s windows every 15 s", "paper": "100 s restarts, Wakita et al. (2022) Eq. 25"}


def mean_and_std(values: Sequence[float], digits: int = 3) -> str:
    """Mean and standard deviation of ``values`` with so many ``digits``, "-" without any; NaN is not left out."""
    if not len(values):
        return "-"
    mean = float(np.mean(values))
    return f"{mean:.{digits}f}" + (f" ± {np.std(values, ddof=1):.{digits}f}" if len(values) > 1 else "")


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table of ``rows`` below a ``header``, its columns aligned."""
    widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]
    lines = [" | ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) for row in (header, *rows)]
    return [f"| {lines[0]} |", "|" + "|".join("-" * (w + 2) for w in widths) + "|", *[f"| {x} |" for x in lines[1:]]]


def accuracy(found: Comparison, metric: str) -> list[str]:
    """One ``metric`` of the comparison ``found`` per test trial and pooled, over the models, on all data."""
    models, subset = found.study.models, found.study.subsets[0]
    names = [t.name for t in found.study.test]

    def row(name: str, value: Callable[[Entry], float]) -> list[str]:
        return [name, *[mean_and_std([value(e) for e in found.of(m, subset)]) for m in models]]

    rows = [row(name, lambda e, i=i: getattr(e.score.trials[i], metric)) for i, name in enumerate(names)]  # type: ignore
    rows.append(row("all rows pooled", lambda e: getattr(e.score, metric)))
    return markdown(["test trial", *models], rows)


def efficiency(found: Comparison) -> list[str]:
    """Pooled 30 s windows of ``found`` over the amount of training data."""
    models, rows = [m for m in found.study.models if m != "captive"], []
    for subset in found.study.subsets:
        seconds = next((e.seconds for e in found.entries if e.subset == subset and e.model != "captive"), float("nan"))
        values = [mean_and_std([e.score.window for e in found.of(m, subset) if e.score]) for m in models]
        rows.append([subset.words, f"{seconds:.0f}", *values])
    return markdown(["training data", "seconds", *models], rows)


def horizon(found: Comparison, column: int) -> list[str]:
    """Growth of the position error [m] (``column`` 0) or of the heading error [deg] (1) of ``found``."""
    models, subset = found.study.models, found.study.subsets[0]
    factor, digits = (1.0, 2) if column == 0 else (np.degrees(1.0), 1)
    rows = []
    for k, seconds in enumerate(HORIZONS):
        values = [mean_and_std([factor * e.growth[k, column] for e in found.of(m, subset)], digits) for m in models]
        rows.append([f"{seconds:g}", *values])
    return markdown(["after [s]", *models], rows)


def published() -> list[str]:
    """Table 9 of Wakita et al. (2022)."""
    rows = [
        [name, *[f"{cell[0]:g}" + (f" ± {cell[1]:g}" if len(cell) > 1 else "") for cell in cells]]
        for name, cells in TABLE_9.items()
    ]
    return markdown(["published", *TABLE_9_TEST], rows)


def tables_text(found: Comparison) -> str:
    """All tables of the comparison ``found`` with what has to be known to read them."""
    study = found.study
    placed = [e for e in found.entries if e.score]
    sigma = "" if not placed else ", ".join(f"{v:.4g}" for v in placed[0].score.sigma)  # type: ignore[union-attr]
    lines = [
        f"Trained on {len(study.train)} trials ({sum(t.duration for t in study.train):.0f} s), tested on "
        f"{len(study.test)}; {study.seeds} seed(s), mean ± standard deviation over them. Mean squared error summed "
        f"over x, y, psi, u, v, r over sigma = ({sigma}), pooled over the test trials. "
        "Nothing was chosen by the test trials; each seed stops by another part of the training trials.",
    ]
    for metric, words in METRICS.items():
        lines += ["", f"### {words}", "", *accuracy(found, metric)]
    lines += ["", "### Growth of the position error, rms [m]", "", *horizon(found, 0)]
    lines += ["", "### Growth of the heading error, rms [deg]", "", *horizon(found, 1)]
    if len(study.subsets) > 1:
        lines += ["", "### Data efficiency: 30 s windows, all rows pooled", "", *efficiency(found)]
    lines += ["", "### Published", "", *published(), "", TABLE_9_NOTE]
    troubles: dict[tuple[str, str], list[str]] = {}
    for e in found.entries:
        if e.status != "finished":
            which = e.model + ("" if e.seed is None else f" seed {e.seed}")
            troubles.setdefault((e.subset.words, e.status), []).append(which)
    lines += [""] * bool(troubles)
    lines += [f"* {', '.join(who)} on {words}: {status}" for (words, status), who in troubles.items()]
    return "\n".join(lines) + "\n"


def comparison_dict(found: Comparison, command: str) -> dict:
    """The comparison ``found`` as plain values, the content of its result.json; command: that made it."""
    return {
        "kind": "comparison",
        "command": command,
        "models": list(found.study.models),
        "seeds": [found.study.seed + i for i in range(found.study.seeds)],
        "epochs": found.study.epochs,
        "train": data_rows(found.study.train),
        "test": data_rows(found.study.test),
        "seconds": found.seconds,
        "interrupted": found.interrupted,
        "horizons_s": list(HORIZONS),
        "entries": [
            {
                "model": e.model, "fraction": e.subset.fraction, "random": e.subset.random, "seed": e.seed,
                "status": e.status, "training_s": e.seconds, "took_s": e.took, "held_out_window": e.held_out,
                "score": e.score.to_dict() if e.score else None,
                "growth": {"position_m": e.growth[:, 0], "heading_rad": e.growth[:, 1]},
            }
            for e in found.entries
        ],
        "published_table_9": {
            "test": TABLE_9_TEST, "values": TABLE_9, "note": TABLE_9_NOTE,
        },
    }  # fmt: skip
