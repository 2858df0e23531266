"""Words of ship logs: the quantities that headers mean, and the units, in several languages."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass

from cases.io.read import FRT_NAMES
from cases.quantities import FACTORS, QUANTITIES, SPELLINGS, factor_of, is_canonical, quantity

_ENDINGS = (
    "deg degrees rad kn kt kts knots mps m_s ms kmh deg_s degs dps deg_min rad_s rads rpm rps m s sec us ns m_sec km_h "
    "deg_sec deg_per_sec feet ft radians"
)
# "ms" of a speed; that of a clock is told by its header (``clocks``).
_SHORT = {"ms": "m/s", "m_sec": "m/s", "deg_sec": "deg/s", "deg_per_sec": "deg/s", "feet": "ft"}
# Last words of a header that are a unit.
ENDINGS = {word: SPELLINGS.get(word, word.replace("_", "/")) for word in _ENDINGS.split()} | _SHORT
_FOREIGN = {
    "deg": "grad grader graden grados grado gradi degre degres 度 °n °e °n/s °e/w degn dege",
    "kn": "knoten noeud noeuds nds knop knob knopen nudo nudos nodi ノット 節",
    "m": "metro metros metri mètre メートル",
    "s": "sekunde sekunden sek seconde secondes secondi sekund sekunder segundo segundos seg 秒",
    "rpm": "umdr/min umdrehungen/min omdr/min o/min t/min tr/min tours/min giri/min omw/min varv/min rev/min /min "
    "min⁻¹ 回転/分",
    "deg/s": "grad/s grad/sek grader/s 度/秒 度/s degres/s grados/s",
    "deg/min": "grad/min grader/min degres/min grados/min 度/分 度/min °/min.",
    "m/s": "m/sek m/sec. m·s-1 m·s⁻¹ m/秒",
    "ft": "feet foot fuss fot pieds",
}
# Units of other languages, in lower case without accents -> the unit.
FOREIGN = {word: unit for unit, words in _FOREIGN.items() for word in words.split()}
GIVEN_UNITS = {  # Cells of a line of units, in lower case; some are units of no quantity of a manoeuvre.
    *(u.lower() for known in FACTORS.values() for u in known), *SPELLINGS, *FOREIGN,
    *("h", "-", "%", "utc", "iso", "n", "e", "t", "°m", "bool", "v", "a", "kw", "nm", "hpa", "mbar", "knm", "°c", "st"),
}  # fmt: skip
BEYOND_A_TURN = 6.6  # No direction in radians is larger. Set by hand: 2 pi and a margin for noise.
_PORT = "port ps bb p babord backbord bakbord babor bakboord sinistra sx 左舷"
_STARBOARD = "stbd starboard sb stb strb s tribord steuerbord styrbord estribor stuurboord dritta dx 右舷"
# Words of a side, in several languages without accents -> the side.
SIDES = dict.fromkeys(_PORT.split(), "port") | dict.fromkeys(_STARBOARD.split(), "starboard")
# What a number behind the name of an actuator may mean.
EITHER_SIDE = {"n": "n or n_2", "delta": "delta_starboard or delta_port", "azimuth": "azimuth or azimuth_2",
               "n_azimuth": "n_azimuth or n_azimuth_2"}  # fmt: skip
UNSURE = {  # Headers that may mean one of several quantities.
    r"wind_?(speed|velocity)|ws": "wind_speed or apparent_wind_speed",
    r"wind_?(direction|dir|angle)|wd": "wind_direction or apparent_wind_direction",
    r"speed|velocity|v_ship|ship_speed": "sog (over ground) or nothing (through the water)",
    r"rpm_e": "n or n_2 (of an engine without a gear) or nothing (ahead of a gear)",
}
ORDERS = (  # Words of what was ordered: the ship follows later.
    r"order|orders|ordered|command|commanded|cmd|setpoint|set_point|sp|demand|demanded|desired|reference|ref|target|"
    r"telegraph|eot|lever|requested|request|soll|consigne|ordre|settpunkt|preset"
)
# Headers of speeds through the water: no states.
WATER = r"stw|.*through_(the_)?water|.*log_speed|.*water_speed|spd_over_water|speed_water"
# Words beside which the others say what a column is.
FILLERS = {"actual", "act", "measured", "meas", "feedback", "fbk", "fb", "response", "value", "filtered", "raw", "ist"}
_TRANSLATIONS = {
    "": "de del du des el la le der dem das il lo geogr geographische",
    "over": "uber sobre sur su sul al", "ground": "grund grunn grond fond fondo sol suolo",
    "time": "zeit uhrzeit heure tid tidspunkt hora tijd temps tiempo ora klokkeslett 時刻 日時 時間",
    "timestamp": "zeitstempel horodatage tidsstempel",
    "date": "dato fecha jour datum 日付",
    "latitude": "breite breitengrad bredde breddegrad latitud latitudine breedte breedtegraad 緯度",
    "longitude": "laenge lange langengrad laengengrad lengde lengdegrad longitud longitudine lengte lengtegraad "
    "laengde 経度",
    "course": "kurs rumbo koers route rotta 針路",
    "heading": "cap steuerkurs kreiselkurs styrekurs gyrokurs girokurs prora rw_k rumbo_verdadero voorliggende_koers "
    "船首方位 船首方位角", "compass_heading": "kompasskurs cap_compas rumbo_magnetico",
    "true": "wahr wahrer rechtweisend rechtweisender vrai vraie verdadero verdadera vero vera",
    "speed": "fart fahrt geschwindigkeit vitesse velocidad velocita snelheid hastighet",
    "sog": "fug 対地速力 対地速度 対地船速", "cog": "kug 対地針路", "stw": "fdw 対水速力 対水速度 対水船速",
    "rpm": "drehzahl turtall omdreininger omdrejninger regime toerental varvtal giri 回転数",
    "shaft": "welle arbre aksel axel eje asse", "shaft_rpm": "wellendrehzahl akselturtall axelvarv 主軸回転数 軸回転数",
    "propeller_rpm": "propellerdrehzahl propellturtall",
    "angle": "winkel vinkel angulo angolo", "rudder": "ruder ror barre safran timon roer roder timone",
    "rudder_angle": "ruderwinkel ruderlage rorvinkel rodervinkel roerhoek 舵角 実舵角",
    "rudder_order": "命令舵角 指令舵角",
    "rate_of_turn": "wendegeschwindigkeit drehrate drehgeschwindigkeit taux_giration svinghastighet 回頭角速度",
}  # fmt: skip
# Headers in German, French, Norwegian, Danish, Swedish, Spanish, Dutch, Italian and Japanese, without accents ->
# English words.
TRANSLATIONS = {word: english for english, words in _TRANSLATIONS.items() for word in words.split()}


@dataclass(frozen=True)
class Meaning:
    """What a header means: the quantity, or "" with what it ``may_be``, and the unit that its words name, or ""."""

    quantity: str
    unit: str = ""
    may_be: str = ""


def plain_words(header: str) -> str:
    """The words of a ``header`` in lower case, without accents, with "_" between them; "shaftRPM" is "shaft_rpm"."""
    parted = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", header)
    return re.sub(r"[\W_]+", "_", _without_accents(parted).lower()).strip("_")


def meaning(header: str) -> Meaning:
    """What the words of a ``header`` mean."""
    header = FRT_NAMES.get(header, header)
    if is_canonical(header) or header in QUANTITIES:
        return Meaning(header)
    full = plain_words(header)
    for name, known in QUANTITIES.items():  # first, as "lat_sec" is no latitude in seconds
        if name.endswith(("_min", "_s", "_magnetic")) and re.fullmatch(known.headers, full):
            return Meaning(name)
    meant = _meant(*_without_unit(full))
    if meant.unit and meant.quantity not in ("", "t") and factor(meant.quantity, meant.unit) is None:
        whole = _meant(full, "")  # "rudder_s" is a side, no seconds
        return whole if whole.quantity else meant
    return meant


def _meant(words: str, unit: str) -> Meaning:
    """What ``words`` mean, of which a ``unit`` was taken."""
    words = TRANSLATIONS.get(words, "_".join(filter(None, (TRANSLATIONS.get(w, w) for w in words.split("_")))))
    if is_order(words) or re.fullmatch(WATER, words):
        return Meaning("", unit)
    side, kept = "", []
    for word in words.split("_"):
        if word in SIDES and words != word:
            side = SIDES[word]
        elif word not in FILLERS or words == word:
            kept.append(word)
    short = "_".join(kept)
    for tried in dict.fromkeys((words, short)):
        if name := _named(tried):
            named = re.search(r"(?:^|_)(rp[ms])(?:_|$)", tried)
            unit = unit or (named[1] if named else "")
            unit = "" if name == "t" else unit  # the clock knows more of them
            return Meaning(of_side(name, side), unit)
    may_be = next((what for pattern, what in UNSURE.items() if re.fullmatch(pattern, short)), "")
    one = _named(re.sub(r"_?[1-4](?=_|$)", "", short))  # "rpm_2" does not say of which side it is
    return Meaning("", unit, may_be or (f"{EITHER_SIDE.get(one, one)} or nothing" if one else ""))


def _named(words: str) -> str:
    """The quantity whose headers ``words`` are, or ""."""
    fits = (name for name, known in QUANTITIES.items() if known.headers and re.fullmatch(known.headers, words))
    return next(fits, "")


def is_order(header: str) -> bool:
    """Whether a ``header`` is that of what was ordered, not of what the ship did."""
    return bool(re.search(rf"(?:^|_)(?:{ORDERS})(?:$|_)", plain_words(header)))


def ordered(header: str) -> str:
    """The quantity whose orders a ``header`` is of, "" where its words do not say it."""
    words = plain_words(header).split("_")
    return meaning("_".join(word for word in words if not re.fullmatch(ORDERS, word))).quantity


def _without_unit(words: str) -> tuple[str, str]:
    """Words without a unit at their end, and the unit."""
    endings = [ending for ending in ENDINGS if words.endswith(f"_{ending}") and len(words) > len(ending) + 1]
    ending = max(endings, key=len, default="")
    if not ending:
        return words, ""
    return (words if ending in ("rpm", "rps") else words[: -len(ending) - 1]), ENDINGS[ending]


def of_side(quantity: str, side: str) -> str:
    """The column of a ``quantity`` on that side: two rudders; the port one of two propellers or pods is the second."""
    if quantity == "delta" and side:
        return f"delta_{side}"
    if quantity in ("n", "n_azimuth", "azimuth") and side == "port":
        return f"{quantity}_2"
    return quantity


def turn_in(name: str, unit: str, largest: float) -> float:
    """The period of the quantity ``name`` in a ``unit``; without one ("") the ``largest`` number tells degrees."""
    scale = factor(name, unit or ("deg" if largest > BEYOND_A_TURN else "rad"))
    return quantity(name).period / (scale or 1.0)


def known_units(name: str) -> dict[str, float]:
    """Unit that a raw log may use for the quantity ``name`` -> factor to its own."""
    return FACTORS.get(quantity(name).unit, {})


def factor(name: str, unit: str) -> float | None:
    """Factor from ``unit`` as written to that of the quantity ``name``, or None for one that does not belong to it."""
    house_unit, written = quantity(name).unit, unit.strip().lower()
    return factor_of(house_unit, FOREIGN.get(_without_accents(written), FOREIGN.get(written, unit)))


def _without_accents(text: str) -> str:
    for letter, plain in (("ø", "o"), ("ß", "ss"), ("Ø", "O"), ("œ", "oe")):
        text = text.replace(letter, plain)
    return "".join(c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
