"""The report: one self-contained HTML file made from results and the figures in their folders.

Its sections follow the headings of ITTC 7.5-02-06-03 (validation of manoeuvring simulation models) where they fit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import ChoiceLoader, Environment, FileSystemBytecodeCache, PackageLoader, StrictUndefined

from cases.io.files import replace_text, replaced
from cases.quantities import UNITS
from fitting.identifiability.analysis import KINDS
from fitting.record import FitRecord
from fitting.report import sections
from fitting.report.plot_style import figures_of
from fitting.report.run_folder import versions
from fitting.report.use import Delivered, delivery_sections, first_screen
from mmg.components.catalogue import summary
from mmg.components.coefficients import PARTICULARS
from mmg.effects import effect
from mmg.errors import Missing, NotInstalled, writing
from mmg.ship import Ship

# Trial names by which a public data set is known, its licence sentence and what to cite.
DATA_SOURCES = (
    (
        re.compile(r"^(turn|turn_cut|zigzag|random|berthing)_\d\d-[A-Z][a-z]{2}-2020_\d\d_\d\d_\d\d"),
        "Free-running trials of the 3 m ESSO OSAKA model: data set FRT-DS-ESSO, Osaka University, licence "
        "CC BY-NC-SA 4.0 (licence file of the data set; its README says CC BY-NC 4.0): not for commercial use.",
        (
            "Wakita, K., Maki, A., Umeda, N., Miyauchi, Y., Shimoji, T., Rachman, D. M. & Akimoto, Y. (2022). On "
            "neural network identification for low-speed ship maneuvering model. J Mar Sci Technol 27(1), 772-785. "
            "doi:10.1007/s00773-021-00867-1",
            "Miyauchi, Y., Maki, A., Umeda, N., Rachman, D. M. & Akimoto, Y. (2022). System parameter exploration of "
            "ship maneuvering model for automatic docking/berthing using CMA-ES. J Mar Sci Technol 27(2), 1065-1083. "
            "doi:10.1007/s00773-022-00889-3",
        ),
    ),
)

# How the names of figures begin that have their place on the page; the others follow section 4.
PLACES = ("track", "identifiability")
AT_PRIOR = ("prior", "silent")  # Kinds of findings on coefficients that the trials did not move
SETS = {"validation": "Held-out trials", "training": "Training trials"}  # Sets of trials that are scored, in words


def citations_of(result: Mapping[str, Any]) -> list[tuple[str, tuple[str, ...]]]:
    """Licence sentence and papers of each public data set of which ``result`` used trials."""
    names = [str(row["name"]) for row in [*result["data"], *result.get("validation_data", [])]]
    return [(licence, papers) for pattern, licence, papers in DATA_SOURCES if any(map(pattern.match, names))]


def label_of(folder: Path) -> str:
    """Returns the name of a run ``folder``, also of one that is still being written under a temporary name."""
    name = folder.absolute().name
    return name.lstrip(".").rsplit(".", 1)[0] if name.startswith(".") else name


def _run(record: FitRecord, ship: Ship, folder: Path, number: int, known: Delivered) -> dict[str, Any]:
    """All that the template shows of one run."""
    result = record.to_dict()
    groups = sections.coefficient_groups(result, ship)
    kinds = [row["kind"] for group in groups for row in group["rows"]]
    use = delivery_sections(result, ship, known)
    figures: dict[str, list[dict[str, Any]]] = {place: [] for place in (*PLACES, "other")}
    for figure in figures_of(folder, result["figures"]):
        figures[next((place for place in PLACES if figure["name"].startswith(place)), "other")].append(figure)
    return {
        "id": f"run{number}",
        "label": label_of(folder),
        "name": ship.mark.name if ship.mark else result["ship"],
        "about": ship.title if ship.mark else "",
        "result": result,
        "ship": ship,
        "warnings": sections.report_warnings(result),
        "groups": groups,
        "at_prior": AT_PRIOR,
        "counts": [(KINDS[kind], kinds.count(kind)) for kind in KINDS if kind in kinds],
        "identifiability": sections.identifiability_section(result),
        "particulars": [(k, v, *PARTICULARS.get(k, ("", ""))) for k, v in ship.particulars.items()],
        "models": [
            *((role, name, summary(role, name)) for role, name in ship.components.items()),
            *(("effect", name, effect(name).summary) for name in ship.effects),
        ],
        "choice": sections.structure_section(folder),
        "figures": figures,
        "citations": citations_of(result),
        "first": 11,  # number of the first section on use, behind those of report.html.j2
        "numbered": True,
        "usable": bool(result["converged"]),
        "first_screen": first_screen(result, ship, known, use["good"], use["bad"]),
        **use,
    }


def rendered(template: str, package: str = "fitting.report", **content: Any) -> str:
    """The page of a ``template`` of a ``package`` with this ``content`` and the version of the program."""
    page = _environment(package).get_template(f"{template}.html.j2")
    return page.render(version=versions()["mmg-ident"], **content)


@cache
def _environment(package: str) -> Environment:
    """The templates of a ``package`` and the parts that all pages share, with their filters; their content is escaped.

    To compile them takes longer than all else of a page, so that is kept in a folder that only the user can write to.
    """
    try:
        compiled = FileSystemBytecodeCache()
    except (OSError, RuntimeError):  # there is no such folder
        compiled = None
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(name) for name in (package, "fitting.report")]), autoescape=True,
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, bytecode_cache=compiled,
    )  # fmt: skip
    environment.filters |= {
        "number": sections.shown_number,
        "plus_minus": sections.plus_minus,
        "setting": sections.shown_setting,
        "as_numbers": lambda names: [f"{name}|n" for name in names],  # headings of the macro ``table``
    }
    environment.globals |= {"zip": zip, "sets": SETS, "state_units": UNITS}
    return environment


def build_page(results: Sequence[tuple[FitRecord, Ship, Path]], known: Sequence[Delivered] = ()) -> str:
    """One self-contained HTML page on ``results``: record, calibrated ship and folder with the figures of each. known:
    of each result its trials and its form for IMO; none by default. Raises UserError for no results."""
    if not results:
        raise Missing("no run folder given")
    deliveries = [*known, *(Delivered() for _ in results[len(known) :])]
    runs = [_run(*result, i + 1, deliveries[i]) for i, result in enumerate(results)]
    ships = [run["name"] + ("" if run["result"]["converged"] else " (not converged)") for run in runs]
    return rendered("report", runs=runs, ships=ships)


def write_page(text: str, out: Path) -> None:
    """Write the page ``text`` to ``out``, atomically. Raises UserError when it cannot be written."""
    with writing(out):
        replace_text(out, text)


def needs_weasyprint() -> None:
    """Raises UserError where WeasyPrint, or a library that it needs, is missing."""
    try:
        import weasyprint  # noqa: F401
    except (ImportError, OSError) as error:
        why = str(error).splitlines()[0]
        raise NotInstalled(
            f"a PDF needs WeasyPrint and its library Pango ({why}): pip install 'mmg-ident[pdf]', or print the HTML "
            "page in a browser"
        ) from None


def write_pdf(text: str, out: Path) -> None:
    """Write the page ``text`` as PDF to ``out``, whole or not at all. Raises UserError where that cannot be done."""
    needs_weasyprint()
    from weasyprint import HTML
    from weasyprint.urls import URLFetcher

    inside = URLFetcher(allowed_protocols=("data",), allow_redirects=False)  # pictures that the page holds itself
    content = HTML(string=text, url_fetcher=inside).write_pdf()
    with writing(out), replaced(out) as scratch:
        scratch.write_bytes(content)
