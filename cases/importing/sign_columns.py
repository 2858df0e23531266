"""Columns of words that give numbers of another one their sign: hemispheres, ahead and astern, the rudder's side."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cases.importing.import_map import ColumnMap, ImportMap
from cases.importing.raw_table import RawTable
from cases.importing.vocabulary import NOT_USED, SIDES, plain_words
from cases.io.sentinels import sentinels_in
from mmg.errors import BadValue, UserError


class Kind(NamedTuple):
    """Quantities (a pattern), the words of positive and of negative numbers, and what has to tell that a column is
    theirs: "place" (its title, or that it stands beside them), "title" (a word of theirs in its own) or ""."""

    quantities: str
    plus: tuple[str, ...]
    minus: tuple[str, ...]
    told_by: str = ""


SIDE = Kind(r"delta.*|n_bow|n_stern", ("starboard", "stbd", "stb", "sb", "s", "r"), ("port", "ps", "p", "l"), "title")
AHEAD = Kind(
    r"n(_2)?|n_azimuth(_\d)?",
    ("ahead", "ahd", "fwd", "forward", "forwards", "+"),
    ("astern", "ast", "rev", "reverse", "reversed", "backward", "backwards", "bwd", "-"),
)
KINDS = (
    SIDE,
    Kind("latitude", ("n", "north"), ("s", "south"), "place"),
    Kind("longitude", ("e", "east"), ("w", "west"), "place"),
    AHEAD,
)
NEITHER = ("stop", "stopped", "neutral", "zero", "off", "midships", "0")
"""Words of what rests; its numbers are zero or nearly so."""
REVERSED = r"(.*_)?(astern|reverse|reversed|reversing)"
DIRECTION = (
    rf"{REVERSED}|.*(shaft|prop|engine|screw|gear|thruster|rudder|rpm).*_(dir|direction|sense|side|sign|ahead|rev)"
)
"""A title of the direction of revolutions or of a rudder, whatever the words below it."""
PLACE = r"(.*_)?(lat|lon|hemi|ns|n_s|n_or_s|ew|e_w|e_or_w).*"
"""A title of a hemisphere."""
ORDERS = rf"{NOT_USED}|(.*_)?(telegraph|eot|lever)(_.*)?"
"""Titles of orders, which say astern before the shaft turns so."""
MOST_WORDS = 8
"""Columns with more different cells hold no directions."""


def sign_columns(
    table: RawTable, mapped: Mapping[str, ColumnMap], headers: Sequence[str], chosen: ImportMap
) -> dict[str, ColumnMap]:
    """Quantity with "_sign" behind it -> the column of the ``table`` whose words are the signs of its numbers.

    mapped: the columns that are known; headers: those that ``hold_signs``; chosen: the map. Only numbers of which none
    is negative lack a sign. Raises UserError where two columns hold it, where only an order does, and where the words
    of a column whose title is a direction are not known.
    """
    found: dict[str, ColumnMap] = {}
    orders: dict[str, str] = {}
    for header in headers:
        title, words = plain_words(header), _words(table.cells(header))
        for kind in _kinds(title, words):
            reads = _reads(kind, title)
            known = words <= set(reads) and not (words <= {"0", "1"} and reads["1"] == 1)
            for quantity in _targets(kind, title, table, mapped, _beside(table, header, headers, mapped), chosen):
                own = mapped[quantity].header
                if not known and len(words) > 1:
                    shown = ", ".join(sorted(words)[:4])
                    raise _open(table, own, header, f"holds {shown}, of which the sign is not known")
                negative = known and any(reads[word] < 0 for word in words)
                if re.fullmatch(ORDERS, title):
                    orders |= {quantity: header} if negative else {}
                elif known and f"{quantity}_sign" not in found:
                    found[f"{quantity}_sign"] = ColumnMap.model_validate({"from": header})
                elif negative:
                    other = found[f"{quantity}_sign"].header
                    raise _open(table, own, header, f"holds its sign as '{other}' does")
    for quantity, header in orders.items():
        if f"{quantity}_sign" not in {*found, *mapped}:
            raise _open(table, mapped[quantity].header, header, "holds orders, not what the shaft does")
    return {name: column for name, column in found.items() if name not in mapped}


def hold_signs(table: RawTable, header: str) -> bool:
    """Whether the cells below ``header`` in the ``table`` hold words of a direction, or its title promises them."""
    has_unit = bool(table.units[table.headers.index(header)])
    return not has_unit and bool(_kinds(plain_words(header), _words(table.cells(header))))


def signed(values: np.ndarray, quantity: str, table: RawTable, header: str, chosen: ImportMap) -> np.ndarray:
    """The ``values`` (N,) of a ``quantity`` with the signs in the column ``header`` of its ``table``.

    chosen: the map, which says the side of positive rudder angles. Raises UserError for a word that is no sign.
    """
    kind = next(kind for kind in KINDS if re.fullmatch(kind.quantities, quantity))
    reads = {"": 0 if table.before else 1, **_reads(kind, plain_words(header))}
    cells = table.cells(header).ffill()  # some are logged where they change
    words = {cell: _word(cell) for cell in cells.unique()}
    sign = cells.map(lambda cell: reads.get(words.get(cell, ""), 0)).to_numpy()
    if not sign.all():
        row = int(np.argmin(np.abs(sign)))
        said = words.get(cells.iloc[row], "")
        raise BadValue(
            f"{table.name}: row {table.before + row + 1}, column '{header}': '{said}' is no sign of {quantity}"
        )
    out = np.where(sign < 0, -np.abs(values), values)
    return -out if quantity.startswith("delta") and chosen.rudder_positive == "port" else out


def _open(table: RawTable, own: str, header: str, why: str) -> UserError:
    return BadValue(
        f"{table.name}: the numbers of '{own}' have no sign, and column '{header}' {why}; write the sign into '{own}', "
        f'or say in the map that the column is not used: ignore = ["{header}"]'
    )


def _kinds(title: str, words: set[str]) -> list[Kind]:
    """What a column of these ``words`` may be: those whose words it holds, or the one that its ``title`` promises."""
    if words and re.fullmatch(DIRECTION, title):
        return [SIDE if re.search("rudder|thruster", title) else AHEAD]
    return [k for k in KINDS if words & {*k.plus, *k.minus} and words <= set(_reads(k, title))]


def _reads(kind: Kind, title: str) -> dict[str, int]:
    """Word -> sign. A column that is called astern or reverse holds whether it is so."""
    astern = re.fullmatch(REVERSED, title) is not None and "ahead" not in title
    return {
        **dict.fromkeys((*kind.plus, *NEITHER, "false", "no"), 1),
        **dict.fromkeys((*kind.minus, "-1", *(("true", "yes") if astern else ())), -1),
        "1": -1 if astern else 1,
    }


def _targets(
    kind: Kind, title: str, table: RawTable, mapped: Mapping[str, ColumnMap], beside: bool, chosen: ImportMap
) -> list[str]:
    """The quantities without a sign whose headers share most words with the ``title`` of a column of signs.

    beside: whether it stands beside positions.
    """
    own = _stems(title)
    fit = {q: column.header for q, column in mapped.items() if re.fullmatch(kind.quantities, q)}
    shared = {q: len(own & _stems(plain_words(header))) for q, header in fit.items()}
    best = max(shared.values(), default=0)
    told = {"": True, "title": best > 0, "place": beside or re.fullmatch(PLACE, title) is not None}[kind.told_by]
    return [q for q in fit if told and shared[q] == best and _positive(table, fit[q], chosen)]


def _beside(table: RawTable, header: str, signs: Sequence[str], mapped: Mapping[str, ColumnMap]) -> bool:
    """Whether only columns of ``signs`` lie between ``header`` and one of latitude or longitude."""
    places = [mapped[q].header for q in ("latitude", "longitude") if q in mapped]
    at = table.headers.index(header)
    both_ways = (reversed(table.headers[:at]), iter(table.headers[at + 1 :]))
    return any(next((h for h in way if h not in signs), "") in places for way in both_ways)


def _stems(title: str) -> set[str]:
    return {SIDES.get(word, word) for word in title.split("_")}


def _positive(table: RawTable, header: str, chosen: ImportMap) -> bool:
    """Whether no number below ``header`` is negative, without those that stand for nothing."""
    if header not in table.headers or not table.numeric(header):
        return False
    values = table.numbers(header)
    for rows in sentinels_in(values, chosen.sentinels).values():
        values = np.where(rows, np.nan, values)
    return bool(np.nanmin(values, initial=np.inf) >= 0)


def _words(cells: Any) -> set[str]:
    """The different words of ``cells``, none where there are too many."""
    different = cells.dropna().unique()
    return {_word(cell) for cell in different} - {""} if len(different) <= 2 * MOST_WORDS else set()


def _word(cell: Any) -> str:
    if cell is None or cell != cell:
        return ""
    try:
        return f"{float(cell):g}"
    except (TypeError, ValueError):
        return str(cell).strip().lower()
