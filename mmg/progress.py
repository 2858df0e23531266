"""Progress of long work: one kind of event for a callback, and one logger for sentences.

A callback takes a ``Progress``. Sentences for a person go to ``LOGGER``, to which the command line attaches a handler;
in a notebook ``logging.basicConfig(level="INFO")`` shows them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

LOGGER = logging.getLogger("mmg_ident")  # Takes the sentences that long work says on its way, at level INFO


@dataclass(frozen=True)
class Progress:
    """Where long work stands.

    task: what is being done, such as "noise pass 2" or "seed 3"; step: iterations, epochs or parts done so far; of: how
    many there are in all, None where that is not known; values: what is watched, such as {"objective": 12.3}.
    """

    task: str
    step: int
    of: int | None = None
    values: Mapping[str, float] = field(default_factory=dict)


OnProgress = Callable[[Progress], None]
"""What ``progress=`` takes: called with each event, in the process and thread that does the work."""
