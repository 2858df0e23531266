"""Positions on the globe in a local frame: x north and y east of an origin [m], by pyproj."""

from __future__ import annotations

import re

import numpy as np

from mmg.errors import BadValue, NotInstalled, OutOfRange

FURTHEST = 200e3
"""Metres from the origin beyond which north and east of the frame are not those of the ship any more."""


def local_positions(
    latitude: np.ndarray, longitude: np.ndarray, origin: tuple[float, float], where: str
) -> tuple[np.ndarray, np.ndarray]:
    """x north and y east [m] of positions (N,) [deg] in the transverse Mercator projection about ``origin`` (latitude,
    longitude) on the WGS 84 ellipsoid.

    where: for messages. Raises UserError where pyproj is missing and for positions further than FURTHEST away.
    """
    pyproj = _pyproj(where)
    lat, lon = origin
    frame = pyproj.Proj(proj="tmerc", lat_0=lat, lon_0=lon, k=1.0, ellps="WGS84")
    east, north = frame(
        np.where(np.isfinite(longitude), longitude, lon), np.where(np.isfinite(latitude), latitude, lat)
    )
    known = np.isfinite(latitude) & np.isfinite(longitude)
    x, y = (np.where(known & np.isfinite(v), v, np.nan) for v in (np.asarray(north), np.asarray(east)))
    far = np.hypot(x, y)
    if np.nanmax(far, initial=0.0) > FURTHEST:
        raise OutOfRange(
            f"{where}: positions lie {np.nanmax(far) / 1000:.0f} km from the origin; import these runs by themselves"
        )
    return x, y


def globe_positions(northing: np.ndarray, easting: np.ndarray, zone: str, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Latitude and longitude [deg] of UTM ``northing`` and ``easting`` (N,) [m] in a ``zone`` such as "32N".

    where: for messages. Raises UserError for a zone that is none, and where pyproj is missing.
    """
    match = re.fullmatch(r"\s*(\d{1,2})\s*([C-HJ-NP-X]?)\s*", zone.upper())
    if match is None or not 1 <= int(match[1]) <= 60:
        raise BadValue(f"{where}: '{zone}' is no UTM zone; write it as 32N")
    south = (match[2] != "" and match[2] != "S" and match[2] < "N") or match[2] == "S"
    frame = _pyproj(where).Proj(proj="utm", zone=int(match[1]), ellps="WGS84", south=south)
    longitude, latitude = frame(easting, northing, inverse=True)
    return np.asarray(latitude), np.asarray(longitude)


def _pyproj(where: str):  # type: ignore[no-untyped-def]
    try:
        import pyproj
    except ImportError:
        words = "latitudes and longitudes need pyproj; pip install 'mmg-ident[import]'"
        raise NotInstalled(f"{where}: {words}") from None
    return pyproj
