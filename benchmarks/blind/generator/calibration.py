"""What hidden causes cost: python -m benchmarks.blind.generator.calibration [--world pond] [--cases 5].

For every foreign effect and strength, the 30 s error of the true model without the effect over that with it (the
floor), median over cases that differ in everything else. The levels of the effects are chosen by it.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from benchmarks.blind.generator.cases import Case, floors, run
from benchmarks.blind.generator.deal import Hand
from benchmarks.blind.generator.effect import LEVELS, Effect
from benchmarks.blind.generator.foreign import FOREIGN
from benchmarks.blind.generator.strangers import NEW
from benchmarks.blind.generator.world import NARROW, World

ALL: tuple[Effect, ...] = (*FOREIGN, *NEW)


def costs(effects: Sequence[Effect], world: World, count: int, seed: int = 0) -> dict[str, tuple[float, ...]]:
    """Median ratio of the errors without and with each effect, at weak, medium and strong, over ``count`` cases."""
    found = {}
    for effect in effects:
        seeds = np.random.SeedSequence(seed).spawn(count)
        hands = [Hand("foreign", ((effect, level),)) for level in LEVELS]
        cases = [Case.prepared(hand, "mixed", one, world) for hand in hands for one in seeds]
        runs = run(cases)
        ratio = floors(cases, runs, with_effects=False) / floors(cases, runs)
        found[effect.name] = tuple(float(x) for x in np.median(ratio.reshape(len(LEVELS), count), axis=1))
    return found


def main(arguments: list[str] | None = None) -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind.generator.calibration", description=__doc__)
    parser.add_argument("--world", choices=tuple(NARROW), default="pond")
    parser.add_argument("--cases", type=int, default=5)
    given = parser.parse_args(arguments)
    world = NARROW[given.world]
    print(f"{'cause':34}" + "".join(f"{level:>9}" for level in LEVELS))
    for effect in ALL:
        if effect.name not in world.without:
            (ratios,) = costs([effect], world, given.cases).values()
            print(f"{effect.name:34}" + "".join(f"{x:9.2f}" for x in ratios), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
