"""Bands of a trial by its campaign: the error of its constants where it is known, else how much campaigns differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cases.io.campaigns import campaign_among
from cases.trial import Trial
from fitting.prediction.bands import Bands
from mmg.ship import Ship

SEED = 1
"""Of the draws of constants, so that they are independent of those of the coefficients."""


def bands_in(bands: Bands | None, ship: Ship, result: Mapping[str, Any], trial: Trial) -> Bands | None:
    """The ``bands`` of predictions of a ``trial`` by ``ship``, with draws of the constants of its campaign.

    result: content of result.json. Of a campaign that is not known a constant is drawn from the distribution of all,
    whose mean the ship has.
    """
    if bands is None or not ship.campaigns or not bands.root.shape[1]:
        return bands
    campaign = campaign_among(trial, ship.campaigns)
    values = (result.get("campaigns") or {}).get("values") or {}
    root = bands.root.copy()
    random = np.random.default_rng(SEED)
    for symbol in next(iter(ship.campaigns.values())):
        width = ship.coefficients[symbol].std
        row = values.get(campaign, {}).get(symbol) if campaign is not None else None
        std = min(row["std"], width) if row and row["std"] is not None else width
        root[ship.symbols.index(symbol)] = std * random.standard_normal(root.shape[1])
    return replace(bands, root=root)
