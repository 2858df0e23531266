"""``mmg simulate``: a manoeuvre, or recorded inputs, on a ship."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from mmg.errors import BadValue, Conflict, OutOfRange
from mmg_ident.commands import options as o
from mmg_ident.commands.output import print_json, refuse_target, say, working

if TYPE_CHECKING:
    from cases.trial import Trial
    from mmg.ship import Ship


@o.options(Run="n speed duration rudder_rate sampled_helm dt seed campaign", Draws="scatter plot")
def simulate(
    ship: o.Ship,
    maneuver: Annotated[
        str | None,
        Option(
            help="turning:35, zigzag:20/20, spiral:15/5, pull-out:20, crash-stop, coasting, random:SEED, straight, "
            "berthing, acceleration, harbour:SEED [deg, negative begins to port]."
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
    scatter: Annotated[
        int | None, Option(help="Ships drawn from the covariance: median and 90 % interval of each figure.")
    ] = None,
    plot: Annotated[Path | None, Option(help="Figure of their tracks (.png, .svg or .pdf).")] = None,
    out: Annotated[Path | None, Option(help="Trial file to write (.csv or .parquet).")] = None,
    force: o.Force = False,
    json: o.Json = False,
) -> None:
    """Simulate a manoeuvre, or the inputs of a trial file, on a ship and write the motion as a trial file.

    Lengths of standard manoeuvres are counted from midship at the order (IMO MSC.137(76)), in ship lengths L.

    Example: mmg simulate esso_osaka_3m --maneuver zigzag:20/20 --wind 1.5:60:gusty --noise --out zigzag.csv
    """
    from cases.criteria.simulated_trial import simulated_trial
    from cases.criteria.standard_runs import figures_of
    from cases.io.campaigns import ship_of_campaign
    from cases.maneuvers.definitions import parse_maneuver
    from cases.shipfiles.effects import with_effects
    from cases.shipfiles.ship_file import load_ship
    from cases.simulation.harbour_inputs import harbour_inputs, harbour_seed
    from cases.simulation.sensors import SensorNoise, add_noise
    from cases.simulation.simulate import write_trial

    if (maneuver is None) == (controls is None):
        raise Conflict("give either --maneuver or --controls, one of them")
    if seed < 0:
        raise OutOfRange(f"--seed {seed} must not be negative")
    if out is not None:
        if out.suffix.lower() not in (".csv", ".parquet"):
            raise BadValue(f"--out {out}: trial files end in .csv or .parquet")
        refuse_target("--out", out, force)
    if plot is not None:
        if plot.suffix.lower() not in (".png", ".svg", ".pdf"):
            raise BadValue(f"--plot {plot}: figures end in .png, .svg or .pdf")
        refuse_target("--plot", plot, force)
    approach: dict[str, Any] = {"n": n, "speed": speed, "duration": duration}
    approach |= {"rudder_rate": None if rudder_rate is None else math.radians(rudder_rate), "sampled": sampled_helm}
    given = [name for name, value in {**approach, "dt": dt}.items() if value not in (None, False)]
    if controls is not None and given:
        option = {"sampled": "sampled-helm"}.get(given[0], given[0].replace("_", "-"))
        raise Conflict(f"--{option} belongs to --maneuver; with --controls the file gives times and inputs")
    model = with_effects(ship_of_campaign(load_ship(ship), campaign), effect or [])
    source: Any = controls
    if maneuver is not None and (own := harbour_seed(maneuver, seed)) is not None:
        if any(value is not None for value in (n, speed, rudder_rate)) or sampled_helm:
            raise Conflict(
                f"{maneuver} starts at rest with actuators at their own rates; give --duration and --dt only"
            )
        maneuver, source = None, harbour_inputs(model, duration, own, dt)
    plan = parse_maneuver(maneuver, model, seed=seed, **approach) if maneuver is not None else None
    if scatter is not None:
        if plan is None and controls is None:
            raise Conflict("--scatter is a standard manoeuvre, not random inputs; leave it out")
        others = {"--controls": controls, "--wind": wind, "--noise": noise or None}
        for option in [name for name, value in others.items() if value is not None]:
            raise Conflict(f"--scatter is a manoeuvre in calm air; leave {option} out")
        _scatter(ship, model, plan, (scatter, seed), dt, (out, plot), json)
        return
    if plot is not None:
        raise Conflict("--plot belongs to --scatter; mmg imo --plot draws the manoeuvres of the standard")
    with working("simulating"):
        trial = simulated_trial(model, plan, source, wind, seed=seed, dt=dt)
    found = figures_of(trial, plan) if plan else {}
    summary = _summary(model, trial, plan.name if plan else trial.name, found)
    if noise and out is None:
        say("note: --noise changes nothing without --out: it belongs to the trial file, not to the summary")
    if out is not None:
        noisy = add_noise(trial, SensorNoise.for_length(model.particulars["L"]), seed) if noise else trial
        write_trial(noisy, out)
    summary |= {"seed": seed, "noise": noise, "wind": wind}
    summary["effects"] = {name: vars(model.parameters_of(name)) for name in model.effects}
    summary["out"] = None if out is None else str(out)
    print_json(summary) if json else _print(summary, found, model)


def _scatter(
    name: str,
    ship: Ship,
    plan: Any,
    draws: tuple[int, int],
    dt: float | None,
    files: tuple[Path | None, Path | None],
    as_json: bool,
) -> None:
    """Draws (how many and their seed), prints the table, and writes the motions and the figure to ``files``."""
    from fitting.prediction.figure_intervals import maneuver_scatter
    from fitting.report.plot_maneuvers import save_figure
    from fitting.report.run_folder import content_on

    content = content_on(Path(name))
    with working(f"simulating {plan.name} {draws[0]} times"):
        found, run, drawn = maneuver_scatter(ship, plan, content, *draws, dt)
    out, plot = files
    if plot is not None:
        if run is None or drawn is None:
            raise Conflict("--plot draws the tracks of a calibration's turning, zigzag, crash-stop or coasting")
        save_figure((run,), f"{ship.title}: {plan.name}, {draws[0]} draws", plot, {run.name: drawn.shown})
        say(f"written: {plot}")
    if out is not None:
        tracks = found.tracks()
        if out.suffix.lower() == ".parquet":
            tracks.to_parquet(out, index=False, engine="pyarrow", write_page_checksum=True)
        else:
            tracks.to_csv(out, index=False)
        say(f"written: {out}")
    if as_json:
        print_json(found.to_dict() | {"title": ship.title, "out": None if out is None else str(out)})
        return
    for notice in found.notices:
        say(f"note: {notice}")
    print(f"{ship.title}: {plan.name}, {found.count} draws of {len(found.coefficients)} coefficients")
    single = "   of a single trial   criterion" if run is not None else ""
    print(f"  {'figure':<28} {'as it is':>10} {'median':>10}   90 % interval{single}")
    for row in found.rows:
        print(f"  {_scatter_line(row, ship.particulars['L'])}")


def _scatter_line(row: Any, length: float) -> str:
    """A line of the table of draws."""
    unit, factor, form = _unit(row.unit, length)

    def shown(*values: float | None) -> list[str]:
        return ["-" if x is None or math.isnan(x) else f"{factor * x:{form}}" for x in values]

    value, middle = shown(row.value, row.median)
    line = f"{row.figure.replace('_', ' ') + f' [{unit}]':<28} {value:>10} {middle:>10}   "
    line += " .. ".join(shown(*row.interval_90))
    if row.interval_90_trial is not None:
        line += "   " + " .. ".join(shown(*row.interval_90_trial))
    if row.probability is not None:
        line += f"   <= {shown(row.limit)[0]}: {100 * row.probability:.0f} %"
    return line if row.share == 1 else f"{line}  ({100 * row.share:.0f} % of the draws)"


def _unit(unit: str, length: float) -> tuple[str, float, str]:
    """Unit shown to people, factor to it, and format; lengths in ship lengths."""
    shown = {"m": ("L", 1 / length, ".3f"), "rad": ("deg", math.degrees(1.0), ".2f")}
    return {**shown, "rad/s": ("deg/s", math.degrees(1.0), ".3f")}.get(unit, (unit or "-", 1.0, ".3f"))


def _summary(ship: Ship, trial: Trial, run: str, found: dict[str, float]) -> dict[str, Any]:
    """What is printed: SI units, named in the keys; lengths of the figures also in ship lengths."""
    from cases.criteria.figures import figure_unit

    states, L = trial.states, ship.particulars["L"]
    names = ("x_m", "y_m", "psi_rad", "u_m_s", "v_m_s", "r_rad_s")
    figures = {f"{key}_{figure_unit(key).replace('/', '_')}".rstrip("_"): value for key, value in found.items()}
    lengths = {f"{name[:-2]}_L": value / L for name, value in figures.items() if name.endswith("_m")}
    return {
        "ship": ship.name,
        "title": ship.title,
        "run": run,
        "samples": len(trial),
        "duration_s": trial.duration,
        "start": dict(zip(names, states[0].tolist(), strict=True)) | {"n_rps": float(trial["n"][0])},
        "final": dict(zip(names, states[-1].tolist(), strict=True)) | {"n_rps": float(trial["n"][-1])},
        "greatest_turn_rate_rad_s": float(abs(trial["r"]).max()),
        "figures": figures | lengths,
        "notices": [*ship.notices, *trial.notices],
    }


def _print(summary: dict[str, Any], figures: dict[str, float], ship: Ship) -> None:
    for notice in summary["notices"]:
        say(f"note: {notice}")
    if summary["out"]:
        say(f"{summary['samples']} samples, {summary['duration_s']:g} s, written to {summary['out']}")
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
    print(f"  greatest turn rate  {math.degrees(summary['greatest_turn_rate_rad_s']):.3f} deg/s")
    for name, value in figures.items():
        print(f"  {_line(name, value, ship.particulars['L'])}")


_SHOWN = {
    "rad/s": ("deg/s", math.degrees(1.0), ".3f"),
    "rad": ("deg", math.degrees(1.0), ".1f"),
    "m/s": ("m/s", 1.0, ".3f"),
    "m": ("m", 1.0, ".2f"),
    "s": ("s", 1.0, ".2f"),
}
"""Unit of a figure -> unit, factor and format for people."""


def _line(name: str, value: float, length: float) -> str:
    """A figure in words: angles in degrees, lengths also in ship lengths."""
    from cases.criteria.figures import figure_unit

    unit, factor, form = _SHOWN.get(figure_unit(name), ("", 1.0, ".3f"))
    lengths = f" = {value / length:.2f} L" if unit == "m" else ""
    return f"{name.replace('_', ' ')}  {factor * value:{form}} {unit}{lengths}".rstrip()
