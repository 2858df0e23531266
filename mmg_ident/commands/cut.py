"""``mmg cut``: the manoeuvres of a long record as trial files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from mmg.errors import Missing, UserError
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli


def cut(
    logs: Annotated[
        list[Path], Argument(help="Trial files of long records (mmg import), or folders.", metavar="LOG...")
    ],
    out: Annotated[Path, Option(help="Folder to write: a file for each manoeuvre, trials.toml.")],
    ship: Annotated[str | None, Option(help="Ship of the record: gives L.", autocompletion=cli.ship_names)] = None,
    length: Annotated[float | None, Option(help="L of the ship [m]; default by her turn rates.")] = None,
    force: Annotated[bool, Option("--force", help="Write into a folder that holds files.")] = False,
    json: o.Json = False,
) -> None:
    """Find the manoeuvres in long records and write them as trials, with names, kinds and what their sidecars said.

    Example: mmg cut trials --out manoeuvres --length 33.9

    Turning tests, zigzags, spirals, crash stops and accelerations, each with its straight approach. None overlaps
    another one. A raw log goes through mmg import first.
    """
    from cases.io.files import filled
    from cases.io.read import read_trial, trial_files
    from cases.operation.log import cut_record, write_cut
    from cases.shipfiles.ship_file import load_ship

    cli.positive("--length", length)
    if length is None and ship is not None:
        length = load_ship(ship).particulars["L"]
    files, parts, refused = trial_files(logs), [], []
    for file in cli.each(files, "reading"):
        try:
            record = read_trial(file)
        except UserError as error:
            raw = f"; of a raw log: mmg import {file} --out trials, then mmg cut trials" if file.is_file() else ""
            raise type(error)(f"{error}{raw}") from None
        try:
            parts += cut_record(record, length, f"{record.name}_" if len(files) > 1 else "")
        except Missing as error:  # a record without a manoeuvre: the others are cut
            refused.append(str(error))
    if not parts:
        raise Missing("; ".join(refused))
    with cli.working("writing trials"), filled(out, force) as folder:
        write_cut(parts, folder)
    rows = [part.to_dict() for part in parts]
    if json:
        cli.print_json({"out": str(out), "trials": rows, "left_out": refused})
        return
    cells = [
        [r["file"], r["kind"], r["order"], *(f"{r[k]:.1f}" for k in ("begin_s", "order_s", "end_s"))] for r in rows
    ]
    cli.print_table(("trial", "kind", "order, deg", "begin, s|n", "order, s|n", "end, s|n"), cells)
    remarks = [f"{row['name']}: {remark}" for row in rows for remark in row["remarks"]]
    remarks += ["the ship's length is taken from her turn rates; give --length or --ship"] * (length is None)
    for line in [*remarks, *refused]:
        cli.print_wrapped("  ", line)
    cli.say(f"next: mmg check {out}, then mmg fit SHIP {out} --out runs/first")
