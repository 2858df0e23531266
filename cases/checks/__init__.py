"""Import checks: is this trial what its header says, and what can be learned from it?

``check(trials)`` gives one ``CheckReport`` per trial; ``pooled(reports)`` says what they excite together.

Constants of this room that name no source are set by hand; ``benchmarks.file_faults`` measures what they do together.
"""

from cases.checks.folders import check
from cases.checks.report import CheckFinding, CheckReport
from cases.checks.single import inputs_are_constant, pooled

__all__ = ["CheckFinding", "CheckReport", "check", "inputs_are_constant", "pooled"]
