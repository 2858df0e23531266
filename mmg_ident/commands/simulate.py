"""``mmg simulate``: a manoeuvre, or recorded inputs, on a ship."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from cases.maneuvers.definitions import Maneuver
    from cases.simulation.gusts import Wind
    from cases.trial import Trial
    from mmg.ship import Ship


def simulate(
    ship: Annotated[str, typer.Argument(help="Library ship (see mmg ships), ship file or run folder.")],
    maneuver: Annotated[
        str | None,
        typer.Option(
            "--maneuver",
            help="turning:35, zigzag:20/20 (rudder/heading), spiral:15/5, pull-out:20, crash-stop, random, "
            "random:SEED, straight, berthing or acceleration; degrees, negative begins to port.",
        ),
    ] = None,
    controls: Annotated[
        Path | None,
        typer.Option("--controls", help="Trial file whose n, delta and wind are followed, from its first state."),
    ] = None,
    wind: Annotated[
        str | None,
        typer.Option("--wind", help="speed:direction[:gusty], m/s and degrees it comes from; default calm air."),
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option("--effect", help="NAME or NAME:key=value,... (see mmg effects). May be repeated."),
    ] = None,
    noise: Annotated[bool, typer.Option("--noise", help="Add white sensor noise to the states written.")] = False,
    n: Annotated[float | None, typer.Option("--n", help="Approach revolutions [1/s]; default from the speed.")] = None,
    speed: Annotated[
        float | None,
        typer.Option(
            "--speed", help="Approach speed [m/s]; default from n, else the ship's U_0, else Froude number 0.07."
        ),
    ] = None,
    duration: Annotated[float | None, typer.Option("--duration", help="Longest time [s].")] = None,
    rudder_rate: Annotated[
        float | None,
        typer.Option("--rudder-rate", help="[deg/s]; default the ship's own, else 20 for a 3 m model, Froude scaled."),
    ] = None,
    sampled_helm: Annotated[
        bool,
        typer.Option("--sampled-helm", help="Orders are given at samples only; default: at the very moment."),
    ] = False,
    dt: Annotated[float | None, typer.Option("--dt", help="Sampling interval [s]; default 0.1.")] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of gusts, noise and random manoeuvres.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Trial file to write (.csv or .parquet); default a summary only."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Simulate a manoeuvre, or the inputs of a trial file, on a ship and write the motion as a trial file.

    Lengths of standard manoeuvres are counted from midship at the order (IMO MSC.137(76)), in ship lengths L.

    Example: mmg simulate esso_osaka_3m --maneuver zigzag:20/20 --wind 1.5:60:gusty --noise --out zigzag.csv
    """
    from cases.shipfiles.effects import with_effects
    from cases.shipfiles.ship_file import load_ship
    from cases.simulation.gusts import parse_wind
    from cases.simulation.sensors import SensorNoise, add_noise
    from cases.simulation.simulate import write_trial
    from mmg.errors import UserError
    from mmg_ident.commands.output import say

    if (maneuver is None) == (controls is None):
        raise UserError("give either --maneuver or --controls, one of them")
    _check_options(out, force, seed)
    model, air = with_effects(load_ship(ship), effect or []), parse_wind(wind) if wind is not None else None
    plan = None
    if maneuver is not None:
        rate = None if rudder_rate is None else math.radians(rudder_rate)
        trial, plan = _run_maneuver(
            model, maneuver, air, dt, seed, n=n, speed=speed, duration=duration, rudder_rate=rate, sampled=sampled_helm
        )
    else:
        assert controls is not None
        options = {
            "--n": n,
            "--speed": speed,
            "--duration": duration,
            "--rudder-rate": rudder_rate,
            "--sampled-helm": sampled_helm or None,
            "--dt": dt,
        }
        trial = _run_controls(model, controls, air, seed, options)
    summary = _summary(model, trial, plan)
    if noise and out is None:
        say("note: --noise changes nothing without --out: it belongs to the trial file, not to the summary")
    if noise:
        trial = add_noise(trial, SensorNoise.for_length(model.particulars["L"]), seed)
    if out is not None:
        write_trial(trial, out)
    summary |= {"seed": seed, "noise": noise, "wind": wind, "effects": _effects(model)}
    summary["out"] = None if out is None else str(out)
    _tell(summary, json)


def _effects(ship: Ship) -> dict[str, dict[str, float]]:
    """Effects in force and their parameters, SI."""
    return {name: vars(ship.parameters_of(name)) for name in ship.effects}


def _check_options(out: Path | None, force: bool, seed: int) -> None:
    """Everything about the output that can be refused before simulating."""
    from mmg.errors import UserError

    if seed < 0:
        raise UserError(f"--seed {seed} must not be negative")
    if out is None:
        return
    if out.suffix.lower() not in (".csv", ".parquet"):
        raise UserError(f"--out {out}: trial files end in .csv or .parquet")
    if out.exists() and (out.is_dir() or not force):
        raise UserError(f"--out {out}: exists already; choose another name or add --force")
    if not out.parent.is_dir():
        raise UserError(f"--out {out}: there is no folder {out.parent}")


def _run_maneuver(
    ship: Ship, text: str, wind: Wind | None, dt: float | None, seed: int, **options: Any
) -> tuple[Trial, Maneuver]:
    from dataclasses import replace

    from cases.criteria.completeness import check_completeness
    from cases.maneuvers.definitions import parse_maneuver
    from cases.simulation.simulate import simulate as run

    plan = parse_maneuver(text, ship, seed=seed, **options)
    trial = run(ship, plan, 0.1 if dt is None else dt, wind, seed)
    return replace(trial, notices=trial.notices + check_completeness(trial, plan)), plan


def _run_controls(ship: Ship, path: Path, wind: Wind | None, seed: int, options: Mapping[str, float | None]) -> Trial:
    from dataclasses import replace

    from cases.io.controls import read_controls
    from cases.simulation.simulate import simulate_controls
    from mmg.errors import UserError

    given = [name for name, value in options.items() if value is not None]
    if given:
        raise UserError(f"{given[0]} belongs to --maneuver; with --controls the file gives times and inputs")
    source = read_controls(path, ship.actuators)
    trial = simulate_controls(ship, source, wind, seed)
    notices = source.notices
    if wind is not None and source.has_wind:
        notices += ("the wind of the file is replaced by --wind",)
    return replace(trial, notices=notices + trial.notices)


def _summary(ship: Ship, trial: Trial, plan: Maneuver | None) -> dict[str, Any]:
    """What is printed: SI units, named in the keys; lengths of the figures also in ship lengths."""
    states, L = trial.states, ship.particulars["L"]
    names = ("x_m", "y_m", "psi_rad", "u_m_s", "v_m_s", "r_rad_s")
    figures = _figures(trial, plan)
    lengths = {f"{name[:-2]}_L": value / L for name, value in figures.items() if name.endswith("_m")}
    return {
        "ship": ship.name,
        "run": plan.name if plan else trial.name,
        "samples": len(trial),
        "duration_s": trial.duration,
        "start": dict(zip(names, states[0].tolist(), strict=True)) | {"n_rps": float(trial["n"][0])},
        "final": dict(zip(names, states[-1].tolist(), strict=True)) | {"n_rps": float(trial["n"][-1])},
        "greatest_turn_rate_rad_s": float(abs(trial["r"]).max()),
        "figures": figures | lengths,
        "notices": [*ship.notices, *trial.notices],
    }


def _figures(trial: Trial, plan: Maneuver | None) -> dict[str, float]:
    """Figures of the standard manoeuvres, with their unit as the end of the name."""
    from cases.criteria.figures import figure_unit
    from cases.criteria.standard_runs import figures_of

    found = figures_of(trial, plan) if plan else {}
    return {f"{name}_{figure_unit(name).replace('/', '_')}".rstrip("_"): value for name, value in found.items()}


def _tell(summary: dict[str, Any], as_json: bool) -> None:
    from mmg_ident.commands.output import print_json, say

    if as_json:
        print_json(summary)
        return
    for notice in summary["notices"]:
        say(f"note: {notice}")
    if summary["out"]:
        say(f"{summary['samples']} samples, {summary['duration_s']:g} s, written to {summary['out']}")
        return
    a, b = summary["start"], summary["final"]
    print(f"{summary['ship']}: {summary['run']}, {summary['duration_s']:g} s")
    for word, state in (("start", a), ("final", b)):
        print(
            f"  {word}  x {state['x_m']:.2f} m, y {state['y_m']:.2f} m, "
            f"psi {math.degrees(state['psi_rad']):.1f} deg, "
            f"u {state['u_m_s']:.4f} m/s, v {state['v_m_s']:.4f} m/s, "
            f"r {math.degrees(state['r_rad_s']):.3f} deg/s, "
            f"n {state['n_rps']:.2f} rps"
        )
    print(f"  greatest turn rate  {math.degrees(summary['greatest_turn_rate_rad_s']):.3f} deg/s")
    for name, value in summary["figures"].items():
        if not name.endswith("_L"):
            print(f"  {_line(name, value, summary['figures'])}")


_SHOWN = {
    "_rad_s": ("deg/s", math.degrees(1.0), ".3f"),
    "_rad": ("deg", math.degrees(1.0), ".1f"),
    "_m_s": ("m/s", 1.0, ".3f"),
}
"""Ends of figure names -> unit, factor and format for people."""


def _line(name: str, value: float, figures: Mapping[str, float]) -> str:
    """A figure in words: angles in degrees, lengths also in ship lengths."""
    for end, (unit, factor, form) in _SHOWN.items():
        if name.endswith(end):
            return f"{name[: -len(end)].replace('_', ' ')}  {factor * value:{form}} {unit}"
    words, _, unit = name.rpartition("_")
    if unit not in ("m", "s"):
        return f"{name.replace('_', ' ')}  {value:.3f}"
    lengths = f" = {figures[words + '_L']:.2f} L" if unit == "m" else ""
    return f"{words.replace('_', ' ')}  {value:.2f} {unit}{lengths}"
