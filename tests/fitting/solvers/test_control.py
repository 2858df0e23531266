"""Ctrl-C while it is held: what may be left out ends at once and is named, what may not goes on."""

from __future__ import annotations

import signal

import pytest

from fitting.solvers.control import (
    INTERRUPTED,
    LEFT_OUT,
    OBSERVER,
    Made,
    interrupts_noted,
    left_out_message,
    make_in_turn,
    unbroken,
)
from fitting.solvers.control import unless_interrupted as unless
from mmg.messages import has_code


def pressed() -> str:
    signal.raise_signal(signal.SIGINT)
    return "went on"


def test_what_may_be_left_out_ends_at_once_and_is_named() -> None:
    with interrupts_noted():
        made = Made()
        make_in_turn({"scores": lambda: None, "profiles": pressed, "figures": lambda: pytest.fail("begun")}, made)
        assert made == {"scores": None} and made.missing == ["profiles", "figures"]
        assert list(made.seconds) == ["scores", "profiles", "figures"]
        assert has_code([left_out_message(made.missing)], LEFT_OUT)


def test_what_may_not_be_left_out_goes_on_and_nothing_is_raised_through_a_library() -> None:
    with interrupts_noted():
        assert pressed() == "went on" and INTERRUPTED.requested
    with interrupts_noted():

        def work() -> str:
            with unbroken():
                seen.append(pressed())
            return "not reached"

        seen: list[str] = []
        assert unless(work) is None and seen == ["went on"]


def test_a_second_ctrl_c_ends_all_and_an_error_of_the_work_is_its_own() -> None:
    with pytest.raises(KeyboardInterrupt), interrupts_noted():
        pressed()
        pressed()
    with interrupts_noted(), pytest.raises(ZeroDivisionError):
        unless(lambda: 1 / 0)
    with pytest.raises(KeyboardInterrupt):  # outside it is raised as usual
        unless(pressed)


def test_the_observer_is_told_when_it_is_held_noted_and_released(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    monkeypatch.setattr(OBSERVER, "told", told.append)
    with interrupts_noted():
        pressed()
    assert told == ["held", "noted", "released"]
