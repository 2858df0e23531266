"""What a search has found at a fit already, for those from the same fit that follow it with fewer candidates.

A search whose names are withdrawn is repeated without them: the tests and refits of the others stay as they are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.hypotheses.found_again import OtherTrials
from diagnosis.hypotheses.score_test import Slopes
from diagnosis.hypotheses.unnamed import UnnamedForms

Beside = tuple[int, tuple[Candidate, ...], Candidate]
"""A refit: number of the fit it begins from, the effects named before, the candidate."""


@dataclass
class KnownResults:
    """Slopes and refits by the fit that they belong to. fits: these fits, so that none takes another's number; tests:
    slopes by the fit's number; refits: fits with one candidate more; others: trials that took no part, followed by
    that fit; left: the last fit of which it is known what
    unnamed forms explain beside it, and that."""

    fits: dict[int, Estimate] = field(default_factory=dict)
    tests: dict[int, tuple[frozenset[Candidate], Slopes]] = field(default_factory=dict)
    refits: dict[Beside, Estimate] = field(default_factory=dict)
    others: dict[int, OtherTrials] = field(default_factory=dict)
    left: tuple[Estimate, UnnamedForms] | None = None

    def slopes(
        self, before: Estimate, candidates: Sequence[Candidate], make: Callable[[Sequence[Candidate]], Slopes]
    ) -> Slopes:
        """The slopes of ``candidates`` at the fit ``before``, which ``make`` gives where they are not known."""
        known = self.tests.get(id(before))
        if known is None or not known[0].issuperset(candidates):
            self.fits[id(before)] = before
            known = self.tests[id(before)] = frozenset(candidates), make(candidates)
        return known[1].only(candidates)

    def refit(self, before: Estimate, named: Sequence[Candidate], candidate: Candidate) -> Estimate | None:
        """The fit from ``before``, with the effects ``named``, with one ``candidate`` more; None where not known."""
        return self.refits.get((id(before), tuple(named), candidate))

    def followed(self, fit: Estimate, make: Callable[[], OtherTrials]) -> OtherTrials:
        """Trials that took no part, followed by a ``fit``, which ``make`` gives where they are not known."""
        if id(fit) not in self.others:
            self.fits[id(fit)], self.others[id(fit)] = fit, make()
        return self.others[id(fit)]

    def unnamed(self, fit: Estimate, make: Callable[[], UnnamedForms]) -> UnnamedForms:
        """What unnamed forms explain at a ``fit``, which ``make`` gives where it is not known."""
        if self.left is None or self.left[0] is not fit:
            self.left = None  # both together would take twice the memory
            self.left = fit, make()
        return self.left[1]

    def keep(self, before: Estimate, named: Sequence[Candidate], candidate: Candidate, fit: Estimate) -> None:
        """Keep the ``fit`` that ``refit`` of the same ``before``, ``named`` and ``candidate`` then gives."""
        self.fits[id(before)] = before
        self.refits[id(before), tuple(named), candidate] = fit
