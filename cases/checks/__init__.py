"""Import checks: is this trial what its header says, and what can be learned from it?

``check(trials)`` gives one ``CheckReport`` per trial; ``pooled(reports)`` says what they excite together.

In brackets behind a constant that was set by hand: how many of 22 answers get other codes when it is halved, and when
it is doubled (shares above a half: what they lack of one); without brackets none does. The answers are those to 19
faults of ``benchmarks.file_faults`` and two sound sets (seed 1), and to eight records of Train-TZRB (November 2026).
"""

from cases.checks.folders import check
from cases.checks.report import CheckFinding, CheckReport
from cases.checks.single import inputs_are_constant, pooled

__all__ = ["CheckFinding", "CheckReport", "check", "inputs_are_constant", "pooled"]
