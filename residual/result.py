"""What a training found, its figures and report, and its run folder: one object, one writer, one reader.

``ship.toml`` (and ``network.safetensors``) is the recommended ship, the other one lies in a folder of its own:
``calibrated/`` beside a hybrid, ``hybrid/`` beside the calibrated ship. ``result.json`` holds settings, seeds, data and
everything that led to the decision, ``training/`` the finished seeds. A black box has ``network.safetensors`` and
``start.toml``, the ship that named its inputs.

The report on a training is one self-contained HTML page, made without torch.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from dataclasses import replace as changed
from itertools import cycle
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from cases.shipfiles.network_file import NETWORK, save_network
from cases.shipfiles.ship_file import dump_ship, load_ship
from fitting.prediction.score import ScorePair, in_words
from fitting.report import run_folder
from fitting.report.page import citations_of, label_of, rendered, write_page
from fitting.report.plot_style import ALARM, BEFORE, DASHES, FigureFolder, dress, figures_of, new_figure
from fitting.report.use import Delivered, delivered, delivery_sections, shown_quantity
from fitting.solvers.control import LEFT_OUT
from mmg.errors import BadValue
from mmg.messages import Message, has_code, html_table, message_rows, messages_from
from mmg.network import Network
from mmg.rollout import Simulator
from mmg.ship import Ship
from residual.decide import Decision, percent
from residual.settings import TrainSettings, settings_from

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from fitting.prediction.predict import Forecaster
    from residual.papers.black_box import BlackBox

TROUBLE = 0.2  # Share of validation rows outside the training range from which on the report warns. Set by hand.


def page_of(
    runs: Sequence[tuple[str, Path, Mapping[str, Any], Ship | None]], full_load: float | None = None, imo: bool = False
) -> str:
    """One self-contained HTML page on trainings, with those of their trials that are at hand.

    runs: of each its name, the folder that holds its figures, the content of its result.json, and the ship that it
    recommends, None of a black box; full_load, imo: as of ``fitting.report.use.delivered``.
    """
    uses = [Delivered() if ship is None else delivered(content, ship, full_load, imo) for _, _, content, ship in runs]
    shown = [_run(*run, own, i) for i, (run, own) in enumerate(zip(runs, uses, strict=True), 1)]
    states = [(run.get("name", run["result"]["ship"]), run["title"], run["headline"]["state"]) for run in shown]
    titles = [f"{ship}: {title}" + (f" ({state})" if state else "") for ship, title, state in states]
    return rendered("training", runs=shown, titles=titles, percent=percent)


def _run(
    label: str, folder: Path, result: Mapping[str, Any], ship: Ship | None, known: Delivered, number: int
) -> dict[str, Any]:
    """All that the template shows of one training, and on the use of its ``ship``, in sections after the others."""
    hybrid, outside = "decision" in result, result["outside"].get("trials", {})
    settings = {k: v for k, v in result["settings"].items() if hybrid or k != "symmetric"}
    shown = {
        "id": f"run{number}",
        "label": label,
        "result": result,
        "hybrid": hybrid,
        "title": "learned residual" if hybrid else f"black box {result['model']}",
        "before": "calibrated ship" if hybrid else "ship model",
        "after": "with residual" if hybrid else "black box",
        "headline": headline(result),
        "warnings": _warnings(result, outside),
        "judged": judged_table(result),
        "seeds": [f"seed {row['seed']}" for row in result["per_seed"]],
        "figures": {f["name"]: f for f in figures_of(folder, result["figures"])},
        "size": result.get("residual_size") or {},
        "envelope": envelope_rows(result),
        "outside": outside,
        "settings": settings,
        "citations": citations_of(result),
        "use": ship is not None,
    }
    if ship is None:
        return shown
    usable = (result.get("calibration") or {}).get("converged") is not False
    shown |= {"name": ship.called, "about": ship.title if ship.mark else ""}
    shown |= {"first": 9, "numbered": False, "usable": usable}
    return shown | delivery_sections(result, ship, known)


def _warnings(result: Mapping[str, Any], outside: Mapping[str, float]) -> list[str]:
    """Its own warnings and those that follow from its numbers; outside: share of the rows of each trial."""
    words = list(result["warnings"])
    far = ", ".join(f"{name} ({percent(share, False)})" for name, share in outside.items() if share > TROUBLE)
    if far:
        words.append(f"much of these validation trials lies outside the network's training range: {far}")
    if "decision" not in result and not result["validation_data"]:
        words.append("no trials were held out: the scores are those of the training trials; give some with --validate")
    return words


def headline(result: Mapping[str, Any]) -> dict[str, str]:
    """The one sentence of a training ``result``, whether it was kept, and what was trained on what."""
    data, decision = result["data"], result.get("decision")
    seconds = sum(row["duration_s"] for row in data)
    what = f"{len(result['per_seed'])} training(s) on {len(data)} trial(s), {seconds:,.0f} s"
    if not decision:
        return {"sentence": _box_sentence(result), "state": "", "what": f"{what}."}
    always = " It is recommended by --keep always." if result["kept"] and not decision["kept"] else ""
    return {
        "sentence": decision["words"] + always,
        "state": "kept" if result["kept"] else "declined",
        "what": f"{what}; judged by {'the validation trials' if result['validation_data'] else 'parts in turn'}.",
    }


def _box_sentence(result: Mapping[str, Any]) -> str:
    """How a black box does on held-out trials, beside the ship that it was trained for."""
    scores, model = result["scores"], f"The black box {result['model']}"
    name = next((n for n in ("validation", "training") if n in scores), "")
    if not name:
        return f"{model} was trained; the trials hold no positions, so its predictions could not be scored."
    before, after = scores[name]["before"], scores[name]["after"]
    where = "on held-out trials" if name == "validation" else "on the trials it was trained on"
    restarts = any(t.get("restarts", True) for t in after["trials"])
    trained, ship = ([in_words(score[key]) for key in ("window", "paper")] for score in (after, before))
    over = f"over 100 s {trained[1]} and {ship[1]}" if restarts else "there is nothing to score over 100 s"
    return (
        f"{model} has an error of {trained[0]} in 30 s predictions {where}, the ship model beside it "
        f"({result['beside']}) {ship[0]}; {over}."
    )


def judged_table(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Per judging run of ``result``: windows, errors before and after over the seeds it judged, changes."""
    seeds = [row["seed"] for row in result["per_seed"]]
    runs: dict[str, dict[int, dict]] = {}
    for row in result["per_seed"]:
        for part in row["judged_runs"] if row["status"] != "diverged" else []:
            runs.setdefault(part["run"], {})[row["seed"]] = part
    table = []
    for name, parts in sorted(runs.items()):
        before, after = (sum(p[k] or nan for p in parts.values()) / len(parts) for k in ("before", "after"))
        changes = {s: p["after"] / p["before"] - 1 for s, p in parts.items() if p["before"] and p["after"] is not None}
        table.append(
            {
                "run": name, "windows": next(iter(parts.values()))["windows"], "before": before, "after": after,
                "change": percent(after / before - 1 if before else None), "worse": after > 1.0005 * before,
                "seeds": [percent(changes[seed]) if seed in changes else "" for seed in seeds],
            }
        )  # fmt: skip
    return table


def envelope_rows(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Range of each feature in the training rows of ``result``, and in the validation rows with the share outside."""
    beyond, rows = result["outside"].get("features", {}), []
    for name, (low, high) in result["envelope"].items():
        words, unit, factor = shown_quantity(name)
        share = beyond.get(name)
        if share:
            share = {**share, "lowest": factor * share["lowest"], "highest": factor * share["highest"]}
        both = {"low": factor * low, "high": factor * high}
        rows.append({"name": name, "words": words, "unit": unit, **both, "own": share})
    return rows


def learning_plot(per_seed: Sequence[Mapping[str, Any]], before: str = "calibrated ship") -> Figure:
    """Stop error over that of what was ``before``, per epoch and seed of ``per_seed``.

    Dots: weights kept; bars: judged error. Returns the figure.
    """
    figure = new_figure(3.2)
    ax = dress(figure.subplots(), "epoch", f"30 s windows: error / {before}")
    end = max(row["history"][-1]["epoch"] for row in per_seed)
    for row, dashes in zip(per_seed, cycle(DASHES), strict=False):
        epochs = [h["epoch"] for h in row["history"]]
        errors = [h["stop"] / row["stop_window"]["before"] for h in row["history"]]
        judged = row["judged_window"]["after"] / row["judged_window"]["before"]
        (line,) = ax.plot(epochs, errors, linewidth=1.1, linestyle=dashes, label=f"seed {row['seed']}")
        if np.isfinite(errors).any():
            best = int(np.nanargmin(errors))
            ax.plot(epochs[best], errors[best], "o", color=line.get_color(), markersize=4)
        ax.plot(1.03 * max(end, 1), judged, "_", color=line.get_color(), markersize=9, markeredgewidth=2.0)
        if row["status"] == "diverged":
            ax.plot(epochs[-1], errors[-1], "x", color=ALARM)
    if ax.get_ylim()[0] < 0.1:
        ax.set_yscale("log")
    ax.axhline(1.0, color=BEFORE, linestyle=(0, (4, 1.5)), linewidth=1.0, label=before)
    ax.legend(fontsize=7.5, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def write_figures(written: FigureFolder, content: Mapping[str, Any]) -> None:
    """Write the figures of the training whose result.json has this ``content``; written: where to."""
    hybrid = content.get("decision") is not None
    start = "calibrated ship" if hybrid else "untrained network"
    apart = ", which took no part in the training" if hybrid else ", here the same that it stopped by, which flatters"
    written.write(
        "learning", lambda: learning_plot(content["per_seed"], start), "Error of the windows to stop by",
        f"Error of the windows to stop by after each epoch, over that of the {start}. Dot: the weights kept; bar "
        f"at the right: their error on the windows that judge{apart}.",
    )  # fmt: skip


# The two ships of a training, and the folder of the one that is not recommended.
CALIBRATED, HYBRID = "calibrated", "hybrid"
FINISHED = "training"  # Folder of the finished seeds, from which ``mmg train --resume`` continues


@dataclass(frozen=True, kw_only=True)
class TrainRecord:
    """What ``result.json`` of a training holds under the names of its attributes, as plain values.

    model: "hybrid" or the kind of black box; per_seed: how each training went; scores: by set of trials, before and
    after; data, validation_data: rows of the trials; sigma: of the loss and of the held out windows; envelope: feature
    -> range in the training rows; outside: validation rows beyond it; figures: rows file, title and caption.
    """

    model: str
    created: str
    command: str
    versions: dict[str, str]
    timings_s: dict[str, Any]
    data: tuple[dict[str, Any], ...]
    validation_data: tuple[dict[str, Any], ...]
    per_seed: tuple[dict[str, Any], ...]
    sigma: dict[str, dict[str, float]]
    envelope: dict[str, list[float]]
    outside: dict[str, Any]
    scores: dict[str, ScorePair]
    figures: tuple[dict[str, str], ...] = ()


@dataclass(frozen=True, kw_only=True)
class TrainResult(TrainRecord):
    """What ``train`` found.

    start: the ship that it started from, without a network (of a black box: whose inputs it takes); network: the mean
    of the residuals, None of a black box and where every training diverged; black_box: of a black box; decision:
    whether the residual is worth keeping; recommended: "hybrid" or "calibrated", "" of a black box. settings: with the
    step filled in; details: what only this kind of model has. interrupted: by Ctrl-C.
    """

    start: Ship
    settings: TrainSettings
    details: dict[str, Any]
    network: Network | None = None
    black_box: BlackBox | None = None
    decision: Decision | None = None
    recommended: str = ""
    warnings: tuple[Message, ...] = ()
    notices: tuple[Message, ...] = ()
    interrupted: bool = False

    @property
    def hybrid(self) -> Ship | None:
        """The ship with the trained residual, recommended or not; None where there is none."""
        return self.start.with_network(self.network) if self.network is not None else None

    @property
    def ship(self) -> Ship:
        """The recommended ship; of a black box the ship that it was trained for."""
        return self.hybrid if self.recommended == HYBRID and self.hybrid else self.start

    @property
    def for_use(self) -> Ship | None:
        """The recommended ship; None of a black box."""
        return None if self.black_box is not None else self.ship

    @property
    def other(self) -> str:
        """Folder of the ship that is not recommended, inside the run folder; "" where there is only one."""
        if self.network is None:
            return ""
        return CALIBRATED if self.recommended == HYBRID else HYBRID

    @property
    def sentence(self) -> str:
        """Kept or declined, by how much and why; of a black box its errors beside those of the ship."""
        return headline(self.to_dict())["sentence"]

    @property
    def complete(self) -> bool:
        """Whether every seed was trained to its end and the folder is whole, so that there is nothing to resume."""
        ended = [row["status"] for row in self.per_seed]
        return len(ended) == self.settings.seeds and "stopped" not in ended and not has_code(self.warnings, LEFT_OUT)

    def models(self) -> dict[str, Simulator | Forecaster]:
        """What predicts, by its name: without, then with what was trained."""
        if self.black_box is not None:
            return {"ship model": Simulator(self.start), "black box": self.black_box}
        found: dict[str, Simulator | Forecaster] = {"calibrated ship": Simulator(self.start)}
        return found | ({"with residual": Simulator(self.hybrid)} if self.hybrid else {})

    def to_dict(self) -> dict[str, Any]:
        """The content of ``result.json``, as plain values."""
        kept = self.recommended == HYBRID
        decided = {"kept": kept, "recommended": self.recommended, "other": self.other, "decision": self.decision}
        levels = (("warning", self.warnings), ("notice", self.notices))
        return run_folder.plain(
            {
                "kind": "training",
                "schema_version": run_folder.SCHEMA_VERSION,
                "ship": self.start.name,
                **{f.name: getattr(self, f.name) for f in fields(TrainRecord)},
                **(decided if self.decision else {}),
                "settings": self.settings,
                "seed": self.settings.seed,
                "seeds": [row["seed"] for row in self.per_seed],
                **self.details,
                "warnings": self.warnings,
                "notices": self.notices,
                "messages": [{"level": level, **row} for level, some in levels for row in message_rows(some)],
            }
        )

    def __repr__(self) -> str:
        kind = self.model if self.black_box is None else f"black box {self.model}"
        return f"<TrainResult {self.start.title}: {kind}, {len(self.per_seed)} seeds; {self.sentence}>"

    def to_pandas(self) -> pd.DataFrame:
        """One row per seed: how it ended, and the errors of the judged windows before and after."""
        import pandas as pd

        kept = ("seed", "status", "judged_by_part", "training_windows", "learning_rate", "restarts", "seconds")
        errors = [(name, when) for name in ("window", "restarts") for when in ("before", "after")]
        rows = [
            {name: row[name] for name in kept} | {f"{n}_{when}": row[f"judged_{n}"][when] for n, when in errors}
            for row in self.per_seed
        ]
        return pd.DataFrame(rows).set_index("seed")

    def _repr_html_(self) -> str:
        table = self.to_pandas().reset_index()
        return html_table(self.sentence, [str(name) for name in table], table.itertuples(index=False))

    def save(self, folder: str | Path, replace: bool = False, report: bool = True) -> None:
        """Write the run folder, whole or not at all; then figures and report, of which one that fails is a warning.

        folder: it must not exist unless ``replace``, which keeps only its finished seeds; report: whether figures and
        report are made. Raises UserError where it exists or cannot be written.
        """
        folder = Path(folder)
        if not replace:
            run_folder.check_target(folder)
        content = changed(self, figures=(), warnings=(*[run_folder.PENDING] * report, *self.warnings)).to_dict()

        def fill(scratch: Path) -> None:
            if (folder / FINISHED).is_dir():
                shutil.copytree(folder / FINISHED, scratch / FINISHED)
            self._write_models(scratch)
            run_folder.write_json(scratch / run_folder.RESULT, content)

        run_folder.write_whole(folder, fill, replace)
        if not report:
            return
        written = FigureFolder(folder / run_folder.FIGURES)
        with written.making("figures"):
            write_figures(written, content)
        done = changed(self, figures=tuple(written.rows), warnings=(*self.warnings, *written.failures))
        with written.making(run_folder.PAGE):
            write_page(page_of([(label_of(folder), folder, done.to_dict(), self.for_use)]), folder / run_folder.PAGE)
        # once more, as the page may have failed after the figures
        done = changed(done, warnings=(*self.warnings, *written.failures))
        with written.making(run_folder.RESULT):  # last, as it says that all is there
            run_folder.write_json(folder / run_folder.RESULT, done.to_dict())

    def _write_models(self, folder: Path) -> None:
        """The recommended ship and the other one, or the black box."""
        if self.black_box is not None:
            from residual.papers.black_box import save_box

            note = f"{self.start.name}: the ship whose inputs the black box takes; nothing else of it is used."
            (folder / run_folder.START).write_text(dump_ship(self.start, note), encoding="utf-8")
            save_box(folder / NETWORK, self.black_box)
            return
        words = "calibrated ship with a residual network (network.safetensors) of mmg train."
        ships = (HYBRID, self.hybrid, words), (CALIBRATED, self.start, "calibrated ship without a residual network.")
        for name, ship, note in ships:
            if ship is None:
                continue
            place = folder if name == self.recommended else folder / name
            place.mkdir(exist_ok=True)
            text = dump_ship(ship.without_network(), f"{self.start.name}, {note}")
            (place / run_folder.SHIP).write_text(text, encoding="utf-8")
            if ship.network is not None:
                save_network(place / NETWORK, ship.network, ship)


# Keys of result.json that every training may have; the others are its details.
_BUILT = {
    "kind", "schema_version", "ship", "kept", "recommended", "other", "decision", "settings", "seed", "seeds",
    "warnings", "notices", "messages", *(f.name for f in fields(TrainRecord)),
}  # fmt: skip


def read_training(folder: str | Path) -> TrainResult:
    """The training in a run folder, with its ships or its black box.

    folder: as ``TrainResult.save`` wrote it. Raises UserError where it is none, or something of it cannot be read.
    """
    folder = Path(folder)
    content = run_folder.read_result(folder)
    if content["kind"] != "training":
        raise BadValue(f"{folder}: is no run of mmg train")
    box, network, decision, recommended = None, None, None, ""
    try:
        if content["model"] == HYBRID:
            names = {f.name for f in fields(Decision)}
            values: dict[str, Any] = {n: nan if v is None else v for n, v in content["decision"].items() if n in names}
            decision = Decision(**values)
            recommended = content.get("recommended", HYBRID if content["kept"] else CALIBRATED)
            place = folder if recommended == HYBRID else folder / HYBRID
            start = load_ship(folder).without_network()
            network = load_ship(place).network if (place / NETWORK).exists() else None
        else:
            from residual.papers.black_box import load_box

            start = load_ship(folder / run_folder.START)
            box = load_box(folder, start)
        warnings, notices = (
            messages_from(row for row in content["messages"] if row["level"] == level)
            for level in ("warning", "notice")
        )
        return TrainResult(
            **vars(run_folder.adapter(TrainRecord).validate_python(content)),
            warnings=warnings,
            notices=notices,
            start=start,
            network=network,
            black_box=box,
            decision=decision,
            recommended=recommended,
            settings=settings_from(content["settings"]),
            details={name: value for name, value in content.items() if name not in _BUILT},
        )
    except ValidationError as error:
        fault = error.errors()[0]
        why = f"{'.'.join(map(str, fault['loc']))}: {fault['msg'].lower()}"
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        why = str(error)
    raise BadValue(f"{folder / run_folder.RESULT}: is incomplete ({why}); train again")


def write_report(
    folders: Sequence[str | Path], out: str | Path, full_load: float | None = None, imo: bool = True
) -> None:
    """Write the report on run folders of trainings, atomically.

    folders: of ``mmg train``; out: the HTML file. full_load: draught [m] of the fully loaded ship, to which tested
    figures are corrected; imo: with the form for IMO of the recommended ship, whose figures are simulated. Raises
    UserError for a folder of another command, for one that was changed so that it cannot be shown, for a draught that
    makes no sense, and when the file cannot be written.
    """
    results, where = [read_training(f) for f in folders], Path(out)
    try:
        runs = [(label_of(Path(f)), Path(f), r.to_dict(), r.for_use) for f, r in zip(folders, results, strict=True)]
        page = page_of(runs, full_load, imo)
    except (LookupError, TypeError, AttributeError, ValueError) as error:
        names = ", ".join(str(Path(f) / run_folder.RESULT) for f in folders)
        raise BadValue(f"{names}: is incomplete ({type(error).__name__}: {error}); train again") from None
    write_page(page, where)
