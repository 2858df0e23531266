"""``mmg simulate``: a manoeuvre, or recorded inputs, on a ship."""

from __future__ import annotations

import math
import statistics
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from mmg.errors import Conflict, OutOfRange
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli

if TYPE_CHECKING:
    from cases.trial import Trial
    from fitting.prediction.figure_intervals import ManeuverScatter
    from mmg.ship import Ship


@o.options(Run="n speed duration rudder_rate sampled_helm dt seed campaign", Draws="scatter members plot")
def simulate(
    ship: o.Ship,
    maneuver: Annotated[
        str | None,
        Option(
            help="turning:35, zigzag:20/20, spiral:15/5, pull-out:20, heading:20/1.5/4, crash-stop, coasting, "
            "random:SEED, straight, berthing, acceleration, harbour:SEED [deg, negative begins to port]."
        ),
    ] = None,
    controls: Annotated[Path | None, Option(help="Trial whose n, delta and wind are followed.")] = None,
    wind: Annotated[str | None, Option(help="speed:direction[:gusty] [m/s, deg it comes from].")] = None,
    effect: Annotated[list[str] | None, Option(help="NAME or NAME:key=value,... (see mmg effects).")] = None,
    noise: Annotated[bool, Option("--noise", help="Add white sensor noise to the states written.")] = False,
    n: Annotated[float | None, Option(help="Approach revolutions [1/s]; default from the speed.")] = None,
    speed: Annotated[float | None, Option(help="Approach speed [m/s]; default from n, U_0, Fn 0.07.")] = None,
    duration: Annotated[float | None, Option(help="Longest time [s].")] = None,
    rudder_rate: Annotated[float | None, Option(help="[deg/s]; default the ship's, else 20 at 3 m.")] = None,
    sampled_helm: Annotated[bool, Option("--sampled-helm", help="Orders are given at samples only.")] = False,
    dt: Annotated[float | None, Option(help="Sampling interval [s]; default 0.1.")] = None,
    seed: Annotated[int, Option(help="Seed of gusts, noise and random manoeuvres.")] = 0,
    campaign: Annotated[str | None, Option(help="Whose instruments log the run; default the mean.")] = None,
    scatter: Annotated[int | None, Option(help="Ships drawn: median and 90 % interval of each figure.")] = None,
    members: Annotated[
        bool, Option("--members", help="Each network of a hybrid alone: spread of each figure.")
    ] = False,
    plot: Annotated[Path | None, Option(help="Figure of their tracks (.png, .svg or .pdf).")] = None,
    out: Annotated[Path | None, Option(help="Trial file to write (.csv or .parquet).")] = None,
    force: o.Force = False,
    json: o.Json = False,
) -> None:
    """Simulate a manoeuvre, or the inputs of a trial file, on a ship and write the motion as a trial file.

    Lengths of standard manoeuvres are counted from midship at the order (IMO MSC.137(76)), in ship lengths L. With
    --members a controller or criterion is judged by the worst network of the ensemble (Wakita et al. 2025, 5.4).

    Example: mmg simulate esso_osaka_3m --maneuver zigzag:20/20 --wind 1.5:60:gusty --noise --out zigzag.csv
    """
    from cases.criteria.standard_runs import figures_of, planned, simulated_trial
    from cases.io.campaigns import ship_of_campaign
    from cases.shipfiles.effects import with_effects
    from cases.shipfiles.ship_file import load_ship
    from cases.simulation.simulate import SensorNoise, add_noise, write_trial

    if (maneuver is None) == (controls is None):
        raise Conflict("give either --maneuver or --controls, one of them")
    if seed < 0:
        raise OutOfRange(f"--seed {seed} must not be negative")
    cli.refuse_target("--out", out, force, (".csv", ".parquet"))
    cli.refuse_target("--plot", plot, force, cli.FIGURES)
    orders = {"--n": n, "--speed": speed, "--rudder-rate": rudder_rate, "--sampled-helm": sampled_helm or None}
    if controls is not None:
        words = "belongs to --maneuver; with --controls the file gives times and inputs"
        cli.refuse_given({**orders, "--duration": duration, "--dt": dt}, words)
    model = with_effects(ship_of_campaign(load_ship(ship), campaign), effect or [])
    source: Any = controls
    plan = None
    if maneuver is not None:
        rate = None if rudder_rate is None else math.radians(rudder_rate)
        more: dict[str, Any] = {"n": n, "speed": speed, "rudder_rate": rate, "sampled": sampled_helm}
        plan, source = planned(model, maneuver, seed, dt, duration, **more)
    if scatter is not None:
        from fitting.prediction.figure_intervals import maneuver_scatter
        from fitting.report.plot_maneuvers import maneuver_figure
        from fitting.report.run_folder import content_on

        others = {"--controls": controls, "--wind": wind, "--noise": noise or None, "--members": members or None}
        cli.refuse_given(others, "does not belong to --scatter, which is a manoeuvre in calm air; leave it out")
        if plan is None:
            raise Conflict("--scatter is of standard manoeuvres, not of random inputs; leave it out")
        with cli.working(f"simulating {plan.name} {scatter} times"):
            drawn = maneuver_scatter(model, plan, content_on(Path(ship)), scatter, seed, dt)
        if plot is not None:
            title = f"{model.title}: {plan.name}, {scatter} draws"
            maneuver_figure((drawn.run,), title, {drawn.run.name: drawn.drawn.shown}).savefig(plot)
        if out is not None:
            tracks = drawn.tracks()
            if out.suffix.lower() == ".parquet":
                # checksums: a byte that a disk changes would else read as another number
                tracks.to_parquet(out, index=False, engine="pyarrow", write_page_checksum=True)
            else:
                tracks.to_csv(out, index=False)
        for path in filter(None, (plot, out)):
            cli.say(f"written: {path}")
        if json:
            about = {"ship": model.name, "title": model.title, "out": None if out is None else str(out)}
            cli.print_json(about | drawn.to_dict())
        else:
            _print_scatter(drawn, model)
        return
    if plot is not None:
        raise Conflict("--plot belongs to --scatter; mmg imo --plot draws the manoeuvres of the standard")
    with cli.working("simulating"):
        trial = simulated_trial(model, plan, source, wind, seed=seed, dt=dt)
    figures = figures_of(trial, plan) if plan else {}
    if members and not (plan and figures):
        raise Conflict("--members is of figures, which this run has not; mmg predict --members follows recorded inputs")
    summary = _summary(model, trial, plan.name if plan else trial.name, figures)
    if noise and out is None:
        cli.say("note: --noise changes nothing without --out: it belongs to the trial file, not to the summary")
    if out is not None:
        # the file alone: figures and summary are those of the motion
        noisy = add_noise(trial, SensorNoise.for_length(model.particulars["L"]), seed) if noise else trial
        write_trial(noisy, out)
    summary |= {"seed": seed, "noise": noise, "wind": wind}
    if members and plan:
        with cli.working(f"simulating {len(model.members)} members"):
            trials = [simulated_trial(member, plan, None, wind, seed=seed, dt=dt) for member in model.members]
        summary["members"] = _spread([figures_of(run, plan) for run in trials])
    summary["effects"] = {name: vars(model.parameters_of(name)) for name in model.effects}
    summary["out"] = None if out is None else str(out)
    cli.print_json(summary) if json else _print(summary, figures, model)


def _print_scatter(scatter: ManeuverScatter, ship: Ship) -> None:
    """The figures of draws as a table."""
    cli.say_notes(scatter.notices)
    count, symbols = scatter.count, len(scatter.coefficients)
    title = f"{ship.title}: {scatter.run.name}, {count} draws of {symbols} coefficients"
    rows = []
    for row in scatter.rows:
        unit, factor, form = _unit(row["unit"], ship.particulars["L"])

        # factor and form as defaults: a closure would take those of the last row
        def shown(*values: float | None, factor: float = factor, form: str = form) -> str:
            return " .. ".join("-" if x is None or math.isnan(x) else f"{factor * x:{form}}" for x in values)

        limit = "" if row["limit"] is None else f"<= {shown(row['limit'])}: {100 * row['probability']:.0f} %"
        # of the draws that come to the event of the figure
        share = "" if row["share"] == 1 else f"({100 * row['share']:.0f} % of the draws)"
        cells = [f"{row['figure'].replace('_', ' ')} [{unit}]", shown(row["value"]), shown(row["median"])]
        cells += [shown(*row["interval_90"]), *[shown(*trial) for trial in [row["interval_90_trial"]] if trial]]
        rows.append([*cells, f"{limit} {share}".strip()])
    trial = ["of a single trial|n"] * any(row["interval_90_trial"] for row in scatter.rows)
    cli.print_table(("figure", "as it is|n", "median|n", "90 % interval|n", *trial, ""), rows, title)


def _unit(unit: str, length: float) -> tuple[str, float, str]:
    """Unit shown to people, factor to it, and format; lengths in ship lengths."""
    shown = {"m": ("L", 1 / length, ".3f"), "rad": ("deg", math.degrees(1.0), ".2f")}
    return {**shown, "rad/s": ("deg/s", math.degrees(1.0), ".3f")}.get(unit, (unit or "-", 1.0, ".3f"))


def _summary(ship: Ship, trial: Trial, run: str, values: dict[str, float]) -> dict[str, Any]:
    """What is printed: SI units, named in the keys; lengths of the figures also in ship lengths."""
    from cases.criteria.figures import figure_unit

    states, L = trial.states, ship.particulars["L"]
    names = ("x_m", "y_m", "psi_rad", "u_m_s", "v_m_s", "r_rad_s")
    figures = {f"{key}_{figure_unit(key).replace('/', '_')}".rstrip("_"): value for key, value in values.items()}
    lengths = {f"{name[:-2]}_L": value / L for name, value in figures.items() if name.endswith("_m")}  # IMO counts in L
    return {
        "ship": ship.name,
        "title": ship.title,
        "run": run,
        "samples": len(trial),
        "duration_s": trial.duration,
        "start": dict(zip(names, states[0].tolist(), strict=True)) | {"n_rps": float(trial["n"][0])},
        "final": dict(zip(names, states[-1].tolist(), strict=True)) | {"n_rps": float(trial["n"][-1])},
        "figures": figures | lengths,
        "notices": [*ship.notices, *trial.notices],
    }


def _spread(each: list[dict[str, float]]) -> dict[str, dict[str, float]]:
    """Mean, standard deviation and ends of each figure over the members of an ensemble that reach it."""
    rows: dict[str, list[float]] = {}
    for name, value in (item for figures in each for item in figures.items()):
        rows.setdefault(name, []).append(value)
    return {  # of the population: the members are all there are
        name: {"mean": statistics.fmean(v), "std": statistics.pstdev(v), "lowest": min(v), "highest": max(v)}
        | {"count": len(v)}
        for name, v in rows.items()
    }


def _print(summary: dict[str, Any], figures: dict[str, float], ship: Ship) -> None:
    from cases.criteria.figures import figure_unit

    cli.say_notes(summary["notices"])
    if summary["out"]:
        cli.say(f"{summary['samples']} samples, {summary['duration_s']:g} s, written to {summary['out']}")
        return
    print(f"{summary['title']}: {summary['run']}, {summary['duration_s']:g} s")
    for word in ("start", "final"):
        state = summary[word]
        print(
            f"  {word}  x {state['x_m']:.2f} m, y {state['y_m']:.2f} m, "
            f"psi {math.degrees(state['psi_rad']):.1f} deg, "
            f"u {state['u_m_s']:.4f} m/s, v {state['v_m_s']:.4f} m/s, "
            f"r {math.degrees(state['r_rad_s']):.3f} deg/s, "
            f"n {state['n_rps']:.2f} rps"
        )
    for name, value in figures.items():
        unit, factor, form = _unit(figure_unit(name), ship.particulars["L"])
        metres = f"{value:.2f} m = " if unit == "L" else ""  # both, as the limits of IMO are in L
        print(f"  {name.replace('_', ' ')}  {metres}{factor * value:{form}} {unit}")
        if row := summary.get("members", {}).get(name):
            mean, std, *ends = (f"{factor * row[key]:{form}}" for key in ("mean", "std", "lowest", "highest"))
            print(f"    of {row['count']} members  {mean} ± {std}, {' to '.join(ends)} {unit}")
