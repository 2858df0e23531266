"""The windows that are chosen tell more than as many others."""

from __future__ import annotations

import numpy as np

from fitting.design.trial_information import choose_windows, window_information
from fitting.prediction.innovations import Innovations


def found(seed: int = 0) -> Innovations:
    """40 windows of two stretches, three coefficients; few windows tell anything of the third."""
    rng = np.random.default_rng(seed)
    gains = rng.standard_normal((80, 24, 3)) * np.array([1.0, 0.5, 0.0])
    gains[[10, 33, 60], :, 2] = rng.standard_normal((3, 24))
    names = ("a", "b", "c")
    return Innovations(np.arange(80.0), np.arange(80) // 2, rng.standard_normal((80, 24)), gains, names, np.ones(3),
                       np.arange(24) % 6)  # fmt: skip


def test_a_rare_manoeuvre_is_chosen_first() -> None:
    choice = choose_windows(found(), 3)
    assert set(choice.windows) & {5, 16, 30}
    assert list(choice.gains) == sorted(choice.gains, reverse=True)


def test_chosen_windows_tell_more_than_random_ones() -> None:
    data = found(1)
    choice, (numbers, information) = choose_windows(data, 6), window_information(data)
    rng = np.random.default_rng(0)
    for _ in range(20):
        chance = rng.choice(len(numbers), 6, replace=False)
        assert sum(choice.gains) > np.linalg.slogdet(np.eye(3) + information[chance].sum(axis=0))[1]
    assert sum(choice.gains) < choice.all


def test_a_window_that_was_moved_by_something_else_is_not_chosen() -> None:
    data = found(2)
    data.errors[20] += 100.0
    assert 10 not in window_information(data)[0]
