"""Fixtures shared by the tests."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.figures import unrendered
from tests.support.without_torch import skip_what_needs_torch

skip_what_needs_torch()
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in the background of a shell: commands would inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)


TRACED = {Path(__file__).parent / room for room in ("mmg", "cases", "fitting", "mmg_ident")}
"""Tests of the packages whose line coverage has a bound (.ci/run), and of the commands that use them. To trace the
others too takes a quarter of their processor time (27 % measured on the diagnosis')."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.pluginmanager.hasplugin("pytest_cov"):
        for item in items:
            if not TRACED & {*item.path.parents}:
                item.add_marker("no_cover")


@pytest.fixture(scope="session")
def frt() -> Path:
    """The folder of the FRT-DS-ESSO records; the test is skipped where they are not installed."""
    from cases.io.published_splits import data_folder
    from mmg.errors import UserError

    try:
        folder = data_folder() / "frt-ds-esso"
    except UserError as error:
        pytest.skip(f"FRT-DS-ESSO records not here: {error}")
    if not any(folder.glob("*/*.csv")):
        pytest.skip(f"FRT-DS-ESSO records not here: no {folder}/*/*.csv")
    return folder


@pytest.fixture(scope="module")
def blank_figures() -> Iterator[None]:
    """For modules that look at no figure of the run folders that they write."""
    with unrendered():
        yield
