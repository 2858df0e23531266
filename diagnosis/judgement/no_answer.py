"""The diagnosis of a ship that cannot be followed along the trials at all: "unknown", with the reason."""

from __future__ import annotations

from collections.abc import Sequence

from diagnosis.findings import DiagnosisInputs, RandomSizes, Unnamed
from diagnosis.result import Diagnosis
from mmg.messages import Message
from mmg.ship import Ship

NOTHING = RandomSizes((0.0, 0.0, 0.0), 0.0, (0.0,) * 6, (0.0,) * 6)
"""Sizes of noise where none was estimated."""


def no_answer(ship: Ship, why: str, warnings: Sequence[str], inputs: DiagnosisInputs, seconds: float) -> Diagnosis:
    """The diagnosis "unknown" of a ``ship``, which stays as it is; nothing was tested.

    why: one sentence; warnings: further ones; inputs: what it was made from; seconds: that it took. Returns it.
    """
    return Diagnosis(
        verdict="unknown",
        sentence=f"Nothing can be said: {why}.",
        effects=(),
        instruments=(),
        equivalence_class=(),
        remainder=False,
        candidates=(),
        where={},
        held_out=None,
        next_test="",
        warnings=(Message(why, "model_breaks_down"), *warnings),
        not_screened={},
        noise=NOTHING,
        unnamed=Unnamed({}, {}),
        kinematics=(),
        timings={"total": seconds},
        inputs=inputs,
        ship=ship,
        before=ship,
    )
