"""The page inside an FMU: what it is, how it is used, where it holds."""

from __future__ import annotations

from html import escape

from delivery.c.header import about
from delivery.fmi.ship import CoSimulatedShip
from delivery.fmi.variables import FmuVariable, VariableTable

STYLE = """body { font: 15px/1.5 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222 }
table { border-collapse: collapse; margin: 1em 0 } th, td { text-align: left; padding: .2em .8em .2em 0;
border-bottom: 1px solid #ccc; vertical-align: top } code { white-space: nowrap }"""
USE = """<p>Connect the inputs, set <code>initial.*</code> before the initialization ends, and read the outputs.
Positions are those of midship: north, east, down. Angles are in radians, clockwise; revolutions are per second. Inputs
are held over each communication step, which is divided evenly into Runge-Kutta steps of at most {step:g} s. Memory
(lags, delays) settles when the initialization ends. <code>coefficients.*</code> can be written at any time.</p>
<p><code>valid</code> is true, and <code>extrapolation</code> 0, while motion and inputs stay inside what the trials
held. Outside, <code>extrapolation</code> is the largest distance over the width of the range: treat what it computes
there as a guess.</p>"""


def fmu_page(ship: CoSimulatedShip, table: VariableTable) -> str:
    """The HTML page of ``ship`` with the variables of ``table``."""
    words = "".join(f"<li>{escape(line)}</li>" for line in about(ship.plain))
    rows = [
        f"<tr><td><code>{escape(k)}</code></td><td>{a:.4g}</td><td>{b:.4g}</td></tr>"
        for k, (a, b) in ship.ranges.items()
    ]
    limits = f"<table><tr><th>quantity (SI)</th><th>least</th><th>most</th></tr>{''.join(rows)}</table>"
    groups = (("Inputs", "input"), ("Outputs", "output"), ("Parameters", "parameter"))
    tables = "".join(f"<h2>{title}</h2>{_rows(table.of(causality))}" for title, causality in groups)
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(ship.identifier)}</title>'
        f"<style>{STYLE}</style></head><body>\n"
        f"<h1>{escape(ship.ship.title or ship.identifier)}</h1>\n<ul>{words}</ul>\n"
        f"<h2>Use</h2>\n{USE.format(step=ship.longest_step)}\n<h2>What the trials held</h2>\n"
        f"{limits if rows else '<p>No record of it is known, so this FMU cannot say when it extrapolates.</p>'}\n"
        f"{tables}\n</body></html>\n"
    )


def _rows(variables: tuple[FmuVariable, ...]) -> str:
    """A table of ``variables``."""
    cells = "".join(
        f"<tr><td><code>{escape(v.name)}</code></td><td>{escape(v.unit or '')}</td>"
        f"<td>{'' if v.start is None else f'{v.start:.6g}'}</td><td>{escape(v.words)}</td></tr>\n"
        for v in variables
    )
    return f"<table><tr><th>name</th><th>unit</th><th>start</th><th>what it is</th></tr>\n{cells}</table>"
