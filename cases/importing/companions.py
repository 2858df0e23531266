"""Columns that change the meaning of another one: its sign (hemisphere, ahead and astern, side of the rudder), whether
it holds (status, quality), what it is counted from (true or magnetic, relative or true), and which sensor it is of."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cases.importing.import_map import ColumnMap, ImportMap, OpenQuestion
from cases.importing.raw_table import RawTable
from cases.importing.vocabulary import SIDES, is_order, meaning, plain_words
from cases.io.conventions import sentinels_in
from cases.io.text_table import EMPTY
from cases.quantities import QUANTITIES, as_number
from mmg.errors import BadValue


class Kind(NamedTuple):
    """quantities: pattern of those that a column of signs may belong to; plus, minus: words of positive and of negative
    numbers; told_by: what has to show that it belongs to them, "place" (its title, or that it stands beside them),
    "title" (a word of theirs in its own) or ""."""

    quantities: str
    plus: tuple[str, ...]
    minus: tuple[str, ...]
    told_by: str = ""


SIDE = Kind(
    r"delta.*|n_bow|n_stern|apparent_wind_direction|true_wind_angle",
    ("starboard", "stbd", "stb", "sb", "s", "r"),
    ("port", "ps", "p", "l"),
    "title",
)
AHEAD = Kind(
    r"n(_2)?|n_azimuth(_\d)?",
    ("ahead", "ahd", "fwd", "forward", "forwards", "+"),
    ("astern", "ast", "rev", "reverse", "reversed", "backward", "backwards", "bwd", "-"),
)
KINDS = (
    SIDE,
    Kind("latitude", ("n", "north"), ("s", "south"), "place"),
    Kind("longitude|variation|deviation", ("e", "east"), ("w", "west"), "place"),
    AHEAD,
)
# Words of what rests; its numbers are zero or nearly so.
NEITHER = ("stop", "stopped", "neutral", "zero", "off", "midships", "0")
REVERSED = r"(.*_)?(astern|reverse|reversed|reversing)"
DIRECTION = (  # A title of the direction of revolutions or of a rudder, whatever the words below it.
    rf"{REVERSED}|.*(shaft|prop|engine|screw|gear|thruster|rudder|rpm).*_(dir|direction|sense|side|sign|ahead|rev)"
)
PLACE = r"(.*_)?(lat|lon|hemi|ns|n_s|n_or_s|ew|e_w|e_or_w).*"  # A title of a hemisphere
MOST_WORDS = 8  # Columns with more different cells hold no directions. Set by hand.


def sign_columns(
    table: RawTable, mapped: Mapping[str, ColumnMap], headers: Sequence[str], chosen: ImportMap
) -> dict[str, ColumnMap]:
    """Quantity with "_sign" behind it -> the column of the ``table`` whose words are the signs of its numbers.

    mapped: the columns that are known; headers: those that ``hold_signs``; chosen: the map. Only numbers of which none
    is negative lack a sign. Raises UserError where two columns hold it, where only an order does, and where the words
    of a column whose title is a direction are not known.
    """
    signs: dict[str, ColumnMap] = {}
    orders: dict[str, str] = {}
    for header in headers:
        title, words = plain_words(header), _words(table.cells(header))
        for kind in _kinds(title, words):
            reads = _reads(kind, title)
            # 0 and 1 say a direction only where the title says which of both is astern.
            known = words <= set(reads) and not (words <= {"0", "1"} and reads["1"] == 1)
            for quantity in _targets(kind, header, table, mapped, headers, chosen):
                unsigned = mapped[quantity].header
                if not known and len(words) > 1:
                    shown = ", ".join(sorted(words)[:4])
                    raise _open(table, unsigned, header, f"holds {shown}, of which the sign is not known")
                negative = known and any(reads[word] < 0 for word in words)
                if is_order(title) and kind.told_by != "place":  # "n or s" of a position is no order
                    orders |= {quantity: header} if negative else {}
                elif known and f"{quantity}_sign" not in signs:
                    signs[f"{quantity}_sign"] = ColumnMap.model_validate({"from": header})
                elif negative:
                    other = signs[f"{quantity}_sign"].header
                    raise _open(table, unsigned, header, f"holds its sign as '{other}' does")
    unused = chosen.ignored_in(table.path)
    # Orders of astern beside revolutions that are never negative show that these lost their sign.
    for header in [h for h in table.headers if is_order(h) and h not in headers and h not in unused]:
        about = _stems(plain_words(header)) & {"rpm", "rps", "shaft", "propeller", "prop", "revs", "telegraph", "eot"}
        astern = any(re.search(r"astern|revers", word) for word in _words(table.cells(header)))
        astern = astern or (table.numeric(header) and bool((table.numbers(header) < 0).any()))
        if about and astern and "n" in mapped and _positive(table, mapped["n"].header, chosen):
            orders["n"] = header
    for quantity, header in orders.items():
        if f"{quantity}_sign" not in {*signs, *mapped}:
            raise _open(table, mapped[quantity].header, header, "holds orders, not what the shaft does")
    return {name: column for name, column in signs.items() if name not in mapped}


def hold_signs(table: RawTable, header: str) -> bool:
    """Whether the cells below ``header`` in the ``table`` hold words of a direction, or its title promises them."""
    has_unit = bool(table.units[table.headers.index(header)])
    return not has_unit and bool(_kinds(plain_words(header), _words(table.cells(header))))


def signed(values: np.ndarray, quantity: str, table: RawTable, header: str, chosen: ImportMap) -> np.ndarray:
    """The ``values`` (N,) of a ``quantity`` with the signs in the column ``header`` of its ``table``. chosen: the map,
    which says the side of positive rudder angles. Raises UserError for a word that is no sign."""
    kind = next(kind for kind in KINDS if re.fullmatch(kind.quantities, quantity))
    # Before the first word the sign is plus; in a later piece of a log that word is not known any more.
    reads = {"": 0 if table.before else 1, **_reads(kind, plain_words(header))}
    words = table.cells(header).ffill().map(_word)  # some are logged where they change
    sign = words.map(lambda word: reads.get(word, 0)).to_numpy()
    if not sign.all():
        row = int(np.argmin(np.abs(sign)))
        where = f"{table.name}: row {table.before + row + 1}, column '{header}'"
        raise BadValue(f"{where}: '{words.iloc[row]}' is no sign of {quantity}")
    out = np.where(sign < 0, -np.abs(values), values)
    return -out if quantity.startswith("delta") and chosen.rudder_positive == "port" else out


SIDE_WORD = "|".join((*SIDE.plus, *SIDE.minus))
# A number with its side before or behind it, such as "P 12,3", "3.0 stbd" or "S5".
WITH_SIDE = rf"(?:({SIDE_WORD})\.?\s*)?(\d+(?:[.,]\d*)?|[.,]\d+)\s*(?:°|deg)?\s*(?:({SIDE_WORD})\.?)?"


def sided(table: RawTable, quantity: str, header: str, chosen: ImportMap) -> np.ndarray | None:
    """The numbers (N,) below ``header`` in the ``table``, if the ``quantity`` has sides and they are written beside
    them, positive to starboard; None where they are not. chosen: as of ``signed``. Raises UserError for a cell that has
    no side."""
    if not re.fullmatch(SIDE.quantities, quantity) or table.numeric(header):
        return None
    cells, signs = table.cells(header), _reads(SIDE, "")
    texts = ["" if cell is None or cell != cell else str(cell).strip().lower() for cell in cells]
    out, bad, said = np.full(len(texts), np.nan), [], False
    for row, text in enumerate(texts):
        match = re.fullmatch(WITH_SIDE, text)
        words = [word for word in (match[1], match[3]) if word] if match else []
        size = as_number(match[2].replace(",", ".")) if match else np.nan
        if len(words) == 1 or size == 0:  # amidships has no side
            out[row], said = size * signs[words[0] if words else "0"], said or bool(words)
        elif text not in EMPTY:
            bad.append(row)
    if bad and said:
        where = f"{table.name}: row {table.before + bad[0] + 1}, column '{header}'"
        words_of = f"'{cells.iloc[bad[0]]}' has no side, as other cells have ({len(bad)} such cells)"
        raise BadValue(f"{where}: {words_of}; write P or S beside the number, or leave the cell empty")
    if not said:
        return None
    return -out if quantity.startswith("delta") and chosen.rudder_positive == "port" else out


def _open(table: RawTable, unsigned: str, header: str, why: str) -> OpenQuestion:
    words = f"the numbers of '{unsigned}' have no sign, and column '{header}' {why}; write the sign into '{unsigned}'"
    return OpenQuestion(table.path, words, {f"'{unsigned}' is right as it is": {"ignore": [header]}})


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
    kind: Kind, header: str, table: RawTable, mapped: Mapping[str, ColumnMap], signs: Sequence[str], chosen: ImportMap
) -> list[str]:
    """The quantities without a sign whose headers share most words with ``header``, the title of a column of signs;
    signs: those of all, which may stand between a position and its own."""
    title, at = plain_words(header), table.headers.index(header)
    stems, both_ways = _stems(title), (table.headers[:at][::-1], table.headers[at + 1 :])
    neighbours = {next((h for h in way if h not in signs), "") for way in both_ways}
    by_position = any(mapped[q].header in neighbours for q in ("latitude", "longitude") if q in mapped)
    fit = {q: column.header for q, column in mapped.items() if re.fullmatch(kind.quantities, q)}
    shared = {q: len(stems & _stems(plain_words(title))) for q, title in fit.items()}
    best = max(shared.values(), default=0)  # of several shafts, the one on the side that the title names
    is_shown = {"": True, "title": best > 0, "place": by_position or bool(re.fullmatch(PLACE, title))}[kind.told_by]
    return [q for q in fit if is_shown and shared[q] == best and _positive(table, fit[q], chosen)]


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
        return f"{float(cell):g}"  # 1, "1" and 1.0 are one word
    except (TypeError, ValueError):
        return str(cell).strip().lower()


GNSS = ("latitude", "longitude", "x", "y", "sog", "cog")  # What a receiver gives, and what its fix holds for
STATUS = (  # A title of what says whether others hold.
    r"(.*_)?(valid|validity|status|stat|quality|qual|fix|fix_?(type|mode|quality|ok)|mode|mode_indicator|ok|flag|error|"
    r"err|fault|alarm|invalid|health|good|bad)"
)
GOOD = (  # Words of what holds, and of what does not.
    "a|d|f|p|r|ok|good|valid|true|yes|(gps_?|gnss_?|3d_?|2d_?|dgps_?|rtk_?)?(fix|fixed|float)|[23]d|d?gps|d?gnss|rtk|"
    "active|on|healthy|normal|auto"
)
BAD = "v|n|e|(in|not_?)valid|bad|false|no_?(fix)?|none|lost|faulty?|fail(ed|ure)?|error|time_?out|void|unavailable|off"
FAULT = r"(.*_)?(error|err|fault|alarm|invalid|bad)"  # A title of what is nonzero or true where others do not hold
# A title whose number 0 says that others do not hold, by NMEA 0183 (GGA) and by the word.
QUALITY = r"(.*_)?(fix|quality|qual|fix_?quality|valid|validity|ok|good)(_indicator)?"
# Words of what directions and winds are counted from; "theoretical" is NMEA's word for the true wind (MWV).
TRUE, MAGNETIC = {"t", "true", "°t", "theoretical"}, {"m", "mag", "magnetic", "°m"}
RELATIVE = {"r", "rel", "relative", "apparent"}
SOURCE = (  # Titles of columns that name what was measured from, and with what.
    r"(.*_)?(source|src|sensor|talker|device|receiver|antenna|instrument|gyro_no|gps_no)(_?(id|no|name|nr|number))?"
)
SHARE = 0.05  # Least share of the rows of each of several sensors: rarer ones are slips. Set by hand.


class Masks(NamedTuple):
    """rows: header -> cells of the rows that are used, for all quantities; of: quantity -> (header, cells for which it
    holds); account: header -> the quantities that it was used for, and how, or why it was not."""

    rows: dict[str, set[str]]
    of: dict[str, list[tuple[str, set[str]]]]
    account: dict[str, tuple[tuple[str, ...], str]]

    @property
    def headers(self) -> list[str]:
        """Of the columns that say whether others hold."""
        return [*self.rows, *(header for conditions in self.of.values() for header, _ in conditions)]


def masks_of(
    table: RawTable, mapped: dict[str, ColumnMap], headers: Sequence[str], signs: Sequence[str], chosen: ImportMap
) -> Masks:
    """What the columns ``headers`` of the ``table``, which are no quantities, say of those that are ``mapped``; signs:
    those that ``hold_signs``.

    References move quantities: a heading that is counted from magnetic north becomes "heading_magnetic" in ``mapped``,
    winds become apparent ones or angles from the bow. chosen: the map. Raises UserError where all rows say that nothing
    holds, and OpenQuestion where several sensors measured one quantity, or where it stays open what a word means.
    """
    masks = Masks({h: set(cells) for h, cells in chosen.rows_of(table.path).items() if h in table.headers}, {}, {})
    for header, cells in masks.rows.items():
        if not _holds(table, header, cells).any():
            shown = ", ".join(sorted(_words(table.cells(header)))[:6]) or "many values"
            raise BadValue(f"{table.name}: no row of column '{header}' holds {', '.join(sorted(cells))}, but {shown}")
        masks.account[header] = ((), f"its rows {', '.join(sorted(cells))} are used")
    for header in [*headers, *signs]:
        title, words = plain_words(header), _words(table.cells(header))
        if header in masks.rows or not words:
            continue
        # References first: their "r" and "t" would be read as words of a rudder's side or of a status.
        if words <= TRUE | MAGNETIC | RELATIVE and (targets := _referred(table, header, title)):
            _refer(header, words, targets, mapped, masks)
            continue
        if header in signs:
            continue
        says = len(words) > 1 and bool(words & {"ok", "good", "valid"})
        says = says and all(re.fullmatch(f"{GOOD}|{BAD}", word) for word in words)
        if says or words <= {"a", "v", "d"} or (re.fullmatch(STATUS, title) and not is_order(title)):
            _status(table, header, title, words, mapped, masks)
        elif re.fullmatch(SOURCE, title) and len(words) > 1:
            _sources(table, header, mapped, masks)
    return masks


def _holds(table: RawTable, header: str, cells: set[str]) -> np.ndarray:
    """Rows (N,) of the ``table`` that hold one of the ``cells`` below ``header``."""
    wanted, column = {_word(cell) for cell in cells}, table.cells(header)
    # By different cells: of millions of rows only some words are looked at one by one.
    return column.isin([cell for cell in column.unique() if _word(cell) in wanted]).to_numpy(dtype=bool)


def masked_rows(table: RawTable, quantity: str, masks: Masks) -> np.ndarray:
    """Rows (N,) of the ``table`` in which the ``quantity`` holds, by the ``masks``."""
    good = np.ones(len(table), dtype=bool)
    for header, cells in [*masks.rows.items(), *masks.of.get(quantity, [])]:
        good &= _holds(table, header, cells)
    return good


def _referred(table: RawTable, header: str, title: str) -> list[str]:
    """Headers of directions and wind speeds with the same word as the ``title``, else of the one on the left."""
    words = re.compile(r"heading|hdg|gyro|course|cog|wind|compass")
    if named := words.search(title):
        return [h for h in table.headers if h != header and named[0] in plain_words(h)]
    at = table.headers.index(header)
    return [h for h in table.headers[max(at - 1, 0) : at] if words.search(plain_words(h))]


def _refer(header: str, words: set[str], targets: Sequence[str], mapped: dict[str, ColumnMap], masks: Masks) -> None:
    """Move quantities to what the words of a reference say that they are."""
    of = {column.header: quantity for quantity, column in mapped.items()}
    used = []
    for target in targets:
        title, now = plain_words(target), of.get(target, "")
        if "wind" in title and not words & MAGNETIC:  # a true angle of MWV is counted from the bow, not from north
            speed = "speed" in title or "velocity" in title
            names = [(RELATIVE, "apparent_wind_speed" if speed else "apparent_wind_direction")]
            names.append((TRUE, "wind_speed" if speed else "true_wind_angle"))
        elif now in ("psi", "heading_magnetic", "cog"):
            names = [(TRUE, "cog")] if now == "cog" else [(TRUE, "psi"), (MAGNETIC, "heading_magnetic")]
        else:
            continue
        column = mapped.pop(now, None) or ColumnMap.model_validate({"from": target})
        masks.account[target] = ((), f"'{header}' says {', '.join(sorted(words))}")
        for kind, name in names:
            if (hits := words & kind) and mapped.get(name, column).header == target:
                mapped[name] = column
                masks.of.setdefault(name, []).append((header, hits))
                used.append(name)
    if used:
        masks.account[header] = (tuple(used), "says what they are counted from")


def _status(
    table: RawTable, header: str, title: str, words: set[str], mapped: Mapping[str, ColumnMap], masks: Masks
) -> None:
    """Mask quantities where their status does not hold."""
    targets = [q for q, row in QUANTITIES.items() if q in mapped and row.valid and re.fullmatch(row.valid, title)]
    before = dict(zip(table.headers[1:], table.headers[:-1], strict=True)).get(header)
    neighbour = next((quantity for quantity, column in mapped.items() if column.header == before), "")
    about = meaning(title.rpartition("_")[0]).quantity  # "heading" of "heading status"
    targets = targets or [about] * (about in mapped)
    if "_" not in title and neighbour:  # a bare "status": behind the time it is that of RMC, for all of a receiver
        targets = [q for q in GNSS if q in mapped] if neighbour in (*GNSS, "t", "date") else [neighbour]
    if not targets:
        stems = _stems(title)
        shared = {q: len(stems & _stems(plain_words(c.header))) for q, c in mapped.items() if q not in ("t", "date")}
        best = max(shared.values(), default=0)
        targets = [q for q in shared if best and shared[q] == best]
    says = {word: _says(word, title, words) for word in words}
    good, bad = ({word for word, sound in says.items() if sound is answer} for answer in (True, False))
    shown, codes = ", ".join(sorted(words)[:6]), all(len(word) < 3 for word in words - good - bad)
    # Other words are of no status: letters and numbers may be codes of one, and are asked for.
    if words == good or (len(words) == 1 and not bad) or not (bad or (targets and codes)):
        masks.account[header] = ((), f"says {shown}" + " in all rows" * (len(words) == 1))
    elif words == bad or not targets or words - good - bad:
        choices = {f"where it is {word}": {"rows": {header: [word]}} for word in sorted(words - bad)[:4]}
        which = f"when do {', '.join(targets)} hold" if targets else "which rows hold"
        anyhow: dict[str, Mapping[str, Any]] = {"always": {"ignore": [header]}}
        raise OpenQuestion(table.path, f"column '{header}' says {shown}; {which}", choices | anyhow)
    else:
        for quantity in targets:
            masks.of.setdefault(quantity, []).append((header, good))
        masks.account[header] = (tuple(targets), f"they hold where it says {', '.join(sorted(good))}")


def _says(word: str, title: str, words: set[str]) -> bool | None:
    """Whether what has the status ``word`` holds, None where it is not known. words: all that the column holds."""
    fault, number = re.fullmatch(FAULT, title) is not None, as_number(word)
    if number == number:  # no NaN, which stands for words
        if fault:
            return number == 0
        if re.fullmatch(QUALITY, title):
            return 0 < number < 6  # 6 is estimated, 7 and 8 are typed in and simulated
        return False if re.search("fix|gps|gnss", title) and number <= 0 else None
    if word in ("m", "s", "e") and words & {"a", "d"}:  # mode indicators of NMEA: typed in, simulated, estimated
        return False
    return not fault if re.fullmatch(GOOD, word) else fault if re.fullmatch(BAD, word) else None


def _sources(table: RawTable, header: str, mapped: Mapping[str, ColumnMap], masks: Masks) -> None:
    """Raises OpenQuestion where several sensors that a column names measured the same quantity."""
    cells = table.cells(header).map(_word)
    names = [name for name, share in cells.value_counts(normalize=True).items() if name and share > SHARE]
    for quantity in [q for q in ("latitude", "x", "psi", "heading_magnetic", "sog", "delta", "n") if q in mapped]:
        share = cells[table.cells(mapped[quantity].header).notna()].value_counts() / len(cells)
        sensors = [name for name in names if share.get(name, 0.0) > SHARE]
        if len(sensors) > 1:
            words = f"column '{header}' names several sensors, which all give {quantity}: {', '.join(sensors[:6])}"
            choices: dict[str, Any] = {f"that of {name}": {"rows": {header: [name]}} for name in sensors[:4]}
            raise OpenQuestion(table.path, words, {**choices, "all": {"ignore": [header]}})
    masks.account[header] = ((), f"names {', '.join(names[:4])}, which measured other columns")
