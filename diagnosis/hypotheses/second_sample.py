"""What trials that took no part say of something found in others, and both said together."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cases.evidence.tails import normal_quantile, normal_tail

SHOWN, OTHER_SIZE = 0.05, 0.005
"""Probability by chance above which trials do not show what was found in others, and that below which they exclude its
size."""

CERTAIN = 1e-4
"""Probability by chance of every name, by training and test trials together, that excludes chance. Then windows and
steps of the test trials must surely become worse to contradict, since what they show of a weak effect is uncertain,
too; a name that is withdrawn leaves something unexplained, though no unnamed form does; and a fault of an instrument
may be small.
"""

EXCESS = 2.0
"""How many times better those that took no part would show something than the trials do from which they are not asked:
no linear response tells so much."""


@dataclass(frozen=True)
class FoundAgain:
    """The slope of the log likelihood of other trials along what was found, over its standard deviation by chance (z),
    and what z would be if it is there as large as it was found (expected)."""

    z: float
    expected: float

    @property
    def p_value(self) -> float:
        """Probability that chance gives such a slope in this direction."""
        return normal_tail(self.z)

    @property
    def gain(self) -> float:
        """Log likelihood that the other trials gain by what was found, as large as it was found."""
        return self.z * self.expected - 0.5 * self.expected**2

    def scaled(self, own: FoundAgain) -> FoundAgain:
        """What is expected here, as far as the response that it hangs on is right.

        own: the same of the trials in which it was found. There z is what is expected of a response that is linear in
        the size. A lag that is long or a mass, which changes how the ship answers to random forces, has less (a hull
        memory of 2 s: 2.4 of 15.8), or more.
        """
        if not (own.expected > 0 and own.z > 0):
            return NOTHING
        return FoundAgain(self.z, self.expected * own.z / own.expected)

    def denies(self, gain: float) -> bool:
        """Whether the other trials do not show it although they would if it had the size found: that is excluded.

        gain: of log likelihood in the first trials, by which the size is uncertain: its deviate there is the root of
        twice the gain.
        """
        if not self.expected > 0 or self.p_value < SHOWN:
            return False
        spread = math.hypot(1.0, self.expected / math.sqrt(max(2 * gain, 1.0)))
        return normal_tail((self.expected - self.z) / spread) < OTHER_SIZE


NOTHING = FoundAgain(0.0, 0.0)
"""What trials say that do not show it."""


def both_by_weight(p_value: float, gain: float, again: FoundAgain) -> float:
    """Probability that chance gives as much in both: a probability ``p_value`` by the first trials, in which the log
    likelihood gains ``gain``, and ``again`` in others.

    The two normal deviates are added with the weights that each should have if it is true (Stouffer's method with the
    weights of Liptak 1958). Trials that do not show it change nothing.
    """
    first, second = math.sqrt(max(2 * gain, 0.0)), max(again.expected, 0.0)
    if not second > 0 or not first > 0:
        return p_value
    deviate = normal_quantile(min(max(p_value, 1e-300), 1 - 1e-9))
    return normal_tail((first * deviate + second * again.z) / math.hypot(first, second))
