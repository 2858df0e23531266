#!/usr/bin/env -S uv run --script
# /// script
# dependencies = ["nox>=2024.4"]
# ///
"""Tasks: ``nox -l`` lists them, ``nox -s NAME`` does one in an environment of its own; ``.ci/run`` does all."""

from __future__ import annotations

import nox

nox.needs_version = ">=2024.4"
nox.options.default_venv_backend = "uv|virtualenv"


@nox.session
def tests(session: nox.Session) -> None:
    """The tests of the default run; what follows -- goes to pytest."""
    session.install("-e", ".[dev]")
    session.run("pytest", *session.posargs)


@nox.session(default=False)
def slow(session: nox.Session) -> None:
    """The slow tests, the longest among them."""
    session.install("-e", ".[dev]")
    session.run("pytest", "-m", "slow", *session.posargs)


@nox.session
def lint(session: nox.Session) -> None:
    """Style, types, spelling, metadata, workflows, and the completeness of the public types."""
    session.install("-e", ".[dev,lint]")
    session.run("bash", ".ci/lint", external=True)


@nox.session(default=False)
def docs(session: nox.Session) -> None:
    """The documentation as a site in site/."""
    session.install("-e", ".[docs]")
    session.run("sphinx-build", "-W", "docs", "site")


@nox.session(default=False)
def figures(session: nox.Session) -> None:
    """A benchmark, recorded, and the pages of the record: nox -s figures -- timings fit."""
    session.install("-e", ".[dev]")
    name, *options = session.posargs
    session.run("python", "-m", f"benchmarks.{name}", *options, "--record")
    session.run("python", "-m", "benchmarks.pages")


@nox.session(default=False)
def build(session: nox.Session) -> None:
    """Wheel and source archive in dist/, checked as an upload would be."""
    session.install("build", "twine")
    session.run("python", "-m", "build")
    session.run("twine", "check", "--strict", "dist/mmg_ident*", external=False)


if __name__ == "__main__":
    nox.main()
