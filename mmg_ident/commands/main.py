"""The ``mmg`` command: collects the verbs and turns every failure into one clear line."""

from __future__ import annotations

import functools
import os
import signal
import sys
from collections.abc import Callable
from typing import Any

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")


def _stopped(*_: Any) -> None:
    """Ctrl-C while the program is still being read: one line instead of a traceback."""
    os.write(2, b"mmg: interrupted; nothing was written\n")
    os._exit(130)


_pressed: list[int] = []


def _noted(*given: Any) -> None:
    """Ctrl-C while a verb runs: a library that is just being imported may make another exception of it."""
    _pressed.append(1)
    signal.default_int_handler(*given)


_usual = signal.getsignal(signal.SIGINT)
if __name__ == "__main__" or sys.argv[0].endswith("mmg"):
    signal.signal(signal.SIGINT, _stopped)

import typer

from mmg.errors import UserError
from mmg_ident.commands.check import check
from mmg_ident.commands.compare import compare
from mmg_ident.commands.demo import demo
from mmg_ident.commands.diagnose import diagnose
from mmg_ident.commands.effects import effects
from mmg_ident.commands.fit import fit
from mmg_ident.commands.imo import imo
from mmg_ident.commands.predict import predict
from mmg_ident.commands.report import report
from mmg_ident.commands.score import score
from mmg_ident.commands.ships import ships
from mmg_ident.commands.simulate import simulate
from mmg_ident.commands.train import train

MANY = ("--validate", "--train", "--test", "--sigma-from", "--new")
"""Options that take several values after one name: ``--validate a.csv b.csv``."""

app = typer.Typer(
    name="mmg",
    help="Manoeuvring models (MMG) of ships, calibrated from trial data.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _interruptible(verb: Callable[..., Any]) -> Callable[..., Any]:
    """The verb with Ctrl-C as ``typer.Abort``, since typer would make a silent exit code of it."""

    @functools.wraps(verb)
    def run_verb(*given: Any, **options: Any) -> Any:
        if signal.getsignal(signal.SIGINT) is _stopped:
            signal.signal(signal.SIGINT, _usual if _usual is signal.SIG_IGN else _noted)
        try:
            return verb(*given, **options)
        except KeyboardInterrupt:
            raise typer.Abort from None

    return run_verb


for verb in (demo, ships, effects, check, simulate, imo, fit, train, predict, score, compare, diagnose, report):
    app.command(verb.__name__)(_interruptible(verb))


def _is_number(argument: str) -> bool:
    try:
        float(argument)
    except ValueError:
        return False
    return True


def expand(arguments: list[str]) -> list[str]:
    """Repeat an option of ``MANY`` before each of its values, which end at the next option.

    One without a value ends the line, so that the missing value is what is complained about.
    """
    result: list[str] = []
    current, waiting = None, False
    for argument in arguments:
        if argument.startswith("-") and argument != "-" and not (current and _is_number(argument)):
            if waiting:
                break
            current = argument if argument in MANY else None
            waiting = current is not None
            if current is None:
                result.append(argument)
        elif current:
            result += [current, argument]
            waiting = False
        else:
            result.append(argument)
    return [*result, current] if waiting and current else result


def main(arguments: list[str] | None = None) -> int:
    """Run one command line; returns the exit code: 0 success, 1 unfinished, 2 bad input, 130 interrupted."""
    try:
        outcome = app(expand(sys.argv[1:] if arguments is None else arguments), standalone_mode=False)
        return outcome if isinstance(outcome, int) else 0
    except UserError as error:
        line = " ".join(str(error).split())
        print(f"mmg: {line}", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, EOFError, typer.Abort):
        print("mmg: interrupted; nothing was written", file=sys.stderr)
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    except typer.Exit as stop:
        return int(stop.exit_code)
    except Exception as error:
        if hasattr(error, "format_message"):  # a usage error of the command line
            print(f"mmg: {' '.join(error.format_message().split())}; see mmg --help", file=sys.stderr)
            return 2
        if _pressed:
            print("mmg: interrupted", file=sys.stderr)
            return 130
        raise


def run() -> None:
    """Entry point of the console script."""
    sys.exit(main())


if __name__ == "__main__":
    run()
