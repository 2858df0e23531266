"""The ``mmg`` command: collects the verbs and turns every failure into one clear line."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import gc
import importlib.util
import io
import keyword
import multiprocessing
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable
from importlib import import_module
from typing import Annotated, Any

from mmg_ident.commands.watcher import tell, watch

# before numpy is loaded, which reads these once; here, as workers of a pool read this module too
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"  # sums of several threads differ in their last bits from those of one
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "1")  # none is used, and to look for them takes time
gc.set_threshold(50_000, 10, 3)  # here and in the processes that read this module: few of so many objects are garbage


def _stopped(*_: Any) -> None:
    """Ctrl-C while the program is still being read: one line instead of a traceback."""
    os.write(2, b"mmg: interrupted; nothing was written\n")
    os._exit(130)


interruptions: list[int] = []  # an entry for each Ctrl-C while a verb runs


def note_interruption(*given: Any) -> None:
    """Ctrl-C while a verb runs: a library that is just being imported may make another exception of it.

    given: signal and frame. Raises KeyboardInterrupt.
    """
    interruptions.append(1)
    tell("ending")  # first: if the exception is lost in a library, the watcher still ends the process
    signal.default_int_handler(*given)


def observe(word: str) -> None:
    """``tell`` of a ``word`` of the solvers, before which a Ctrl-C that a library has swallowed is raised once more.

    Raises KeyboardInterrupt where something is to be held though all was to end.
    """
    if word == "held" and interruptions:  # lost while torch was imported, say
        raise KeyboardInterrupt
    tell(word)


def terminated(_: int, frame: Any) -> None:
    """SIGTERM ends a verb as Ctrl-C does: what can be kept is written, and nothing half-written is left.

    frame: where it came.
    """
    handler = signal.getsignal(signal.SIGINT)  # called, not sent: a second signal would end it at once
    (handler if callable(handler) else note_interruption)(signal.SIGINT, frame)


def _raised_again(found: Any) -> None:
    """Ctrl-C that was raised where nothing can be (while an object is deleted, say) is raised once more elsewhere."""
    if issubclass(found.exc_type, KeyboardInterrupt):
        threading.Timer(0.05, ctypes.pythonapi.PyErr_SetInterrupt).start()  # not from here, where it is dropped as well
    else:
        sys.__unraisablehook__(found)


_usual = signal.getsignal(signal.SIGINT)  # SIG_IGN where a shell started the command in the background


def answer_signals() -> None:
    """From now on Ctrl-C and SIGTERM are answered with one line, and within two seconds (``watcher``).

    Not in a process of ``fitting.parallel``, which reads this module as well: SIGTERM ends it at once, without a word.
    """
    if multiprocessing.current_process().name != "MainProcess":  # parent_process() is None until all is read
        return
    signal.signal(signal.SIGINT, _stopped)
    sys.unraisablehook = _raised_again
    signal.signal(signal.SIGTERM, terminated)
    watch()


# before typer is imported, which takes a while; not where another program, whose signals are its own, imports this
if __name__ == "__main__" or sys.argv[0].endswith(("mmg", "mmg-ident")):
    answer_signals()

import typer
from typer.core import TyperGroup

from mmg_ident import shadowing_mmg

# Verbs that need more memory than the least; with less the libraries they use neither end nor answer Ctrl-C.
HEAVY = ("start", "demo", "fit", "fleet", "months", "train", "compare", "diagnose", "gap", "select")
LEAST_MEMORY = 1.5 * 2**30  # [bytes], set by hand from runs below ulimit -v
# Options that take several values after one name: ``--validate a.csv b.csv``.
MANY = ("--validate", "--train", "--test", "--sigma-from", "--new", "--trials", "--baseline")


def _interruptible(verb: Callable[..., Any]) -> Callable[..., Any]:
    """The verb with Ctrl-C as ``typer.Abort``, since typer would make a silent exit code of it.

    Lists of tasks of a verb with the option --workers are counted on a terminal as they are done, and go to the Dask
    scheduler where one is named.
    """

    @functools.wraps(verb)
    def run_verb(*given: Any, **options: Any) -> Any:
        if signal.getsignal(signal.SIGINT) is _stopped:  # from here on something may have been written
            signal.signal(signal.SIGINT, _usual if _usual is signal.SIG_IGN else note_interruption)
        from mmg_ident.commands.output import narration, progress

        try:
            with contextlib.ExitStack() as stack:
                stack.enter_context(narration(for_machines=options.get("json") is True))
                if "workers" in options:
                    from fitting.parallel import listening

                    stack.enter_context(listening(progress()))
                if options.get("scheduler") is not None:
                    from fitting.parallel.dask_cluster import dask_cluster

                    stack.enter_context(dask_cluster(str(options["scheduler"])))
                return verb(*given, **options)
        except KeyboardInterrupt:
            raise typer.Abort from None

    return run_verb


# Panel of ``mmg --help`` -> verb -> its line; each verb has a module and a function of its name in this folder
# ("import_" for import, which is a word of Python).
PANELS = {
    "Start": {
        "start": "From logs to a calibrated ship, a report and an FMU, in one go.",
        "demo": "The whole story on embedded synthetic trials, in about a minute.",
        "import": "Turn raw logs (text, Excel, NMEA; any units, clocks) into trial files.",
        "cut": "Find the manoeuvres in long records, write them as trials.",
        "check": "Check trial files: units, signs, frames, gaps, copies, lags.",
        "ships": "List the ships of the package, print one, write a starting ship.",
        "effects": "List the effects that a model may leave out, or explain one.",
        "simulate": "Simulate a manoeuvre, or the inputs of a trial file.",
    },
    "Calibrate": {
        "fit": "Calibrate a ship on trials.",
        "train": "Learn a residual on a calibrated ship, or a black box.",
        "select": "Generate models of any structure, fit them and choose.",
    },
    "Judge": {
        "score": "Score models on trials, side by side.",
        "predict": "Predict open-loop windows of trials.",
        "imo": "Judge a ship, or measured runs, by the IMO criteria.",
        "diagnose": "Say which effect a model lacks and how far the gap shrinks.",
        "gap": "Compare white, learned and named models on test trials.",
        "compare": "Compare models with the networks of the literature.",
    },
    "Deliver": {
        "export": "Deliver a ship: FMU, C, MATLAB and other formats.",
        "report": "Write one HTML page on a run, or on several side by side.",
        "card": "Write pilot card, wheelhouse poster and manoeuvring booklet.",
        "view": "Write one interactive page: tracks, histories, forces.",
        "scale": "Carry a calibrated model to the size of the ship.",
        "plan": "Design the next trial: the one that tells most in an area.",
    },
    "Many": {
        "months": "Study months of operational data; date what changed.",
        "fleet": "Fit, judge, diagnose and compare many ships.",
    },
}
VERBS = {verb: words for verbs in PANELS.values() for verb, words in verbs.items()}
_PLAIN: dict[str, Any] = {"add_completion": False, "pretty_exceptions_enable": False, "rich_markup_mode": None}


class _Verbs(TyperGroup):
    """The verbs, of which a module is imported when its verb is called or its help is shown."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(VERBS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in VERBS:
            return None
        from mmg_ident.commands.options import Verb

        name = f"{cmd_name}_" if keyword.iskeyword(cmd_name) else cmd_name
        verb = getattr(import_module(f"mmg_ident.commands.{name}"), name)
        one = typer.Typer(**_PLAIN)  # typer makes a command only of a program: one of this verb alone
        one.command(cmd_name, cls=Verb)(_interruptible(verb))
        return typer.main.get_command(one)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        for title, verbs in PANELS.items():
            with formatter.section(title):
                formatter.write_dl(list(verbs.items()))


app: typer.Typer = typer.Typer(name="mmg", cls=_Verbs, **{**_PLAIN, "add_completion": True})


@app.callback(invoke_without_command=True)
def _about(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    """Manoeuvring models (MMG) of ships, calibrated from trial data."""
    if version:
        from mmg_ident import __version__

        typer.echo(f"mmg-ident {__version__}")
        raise typer.Exit


def expand(arguments: list[str]) -> list[str]:
    """The ``arguments`` with an option of ``MANY`` repeated before each of its values, which end at the next option.

    One without a value ends the line, so that the missing value is what is complained about.
    """
    result: list[str] = []
    option, has_value = None, True  # the option of MANY whose values are being read, and whether one has come
    for argument in arguments:
        # "-" is a file, "-3.5" the value of an option: neither is a new option
        if argument.startswith("-") and argument != "-" and not (option and re.match(r"-[\d.]", argument)):
            if not has_value:
                break
            option = argument if argument in MANY else None
            has_value = option is None
            result += [argument] if has_value else []
        elif option:
            result += [option, argument]
            has_value = True
        else:
            result.append(argument)
    return result if has_value or not option else [*result, option]


def _check_memory(arguments: list[str]) -> None:
    """Raises UserError where the memory that the process may use is too little for the verb."""
    if not set(arguments[:1]) & set(HEAVY) or importlib.util.find_spec("resource") is None:  # Windows has no limit
        return
    import resource

    from mmg.errors import OutOfRange

    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < LEAST_MEMORY:
        sizes = f"limited to {limit / 2**20:.0f} MB, mmg {arguments[0]} needs {LEAST_MEMORY / 2**20:.0f} MB"
        raise OutOfRange(f"memory is {sizes}; raise the limit (ulimit -v)")


def _drop_output() -> None:
    """What standard output still holds goes nowhere: at its end Python would try to write it once more, and fail."""
    with contextlib.suppress(OSError, ValueError):  # a stream in memory has no file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main(arguments: list[str] | None = None) -> int:
    """Run one command line; returns the exit code: 0 success, 1 unfinished, 2 bad input, 130 interrupted.

    arguments: without the program's name; default those of the process.
    """
    if in_the_way := shadowing_mmg():
        print(f"mmg: {in_the_way}", file=sys.stderr)
        return 2
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and not stream.encoding.lower().startswith("utf"):  # cp1252, say
            stream.reconfigure(errors="backslashreplace")  # a name that the console lacks must not end the command
    from fitting.solvers.control import OBSERVER
    from mmg.errors import UserError
    from mmg.messages import printable
    from mmg_ident.settings import refuse_gone_options

    OBSERVER.told = observe  # the floor of the solvers knows no commands: it is told whom to tell
    try:
        given = expand(sys.argv[1:] if arguments is None else arguments) or ["--help"]
        refuse_gone_options(given)
        _check_memory(given)
        outcome = app(given, standalone_mode=False)
        sys.stdout.flush()  # here, so that a full disk or a closed pipe is met below and not at the interpreter's end
        return outcome if isinstance(outcome, int) else 0
    except UserError as error:
        from mmg_ident.commands.output import say_fault

        say_fault(error, for_machines="--json" in (arguments or sys.argv))
        return 2
    except (KeyboardInterrupt, EOFError, typer.Abort):
        print("mmg: interrupted; nothing was written", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader, such as head, has all that it wanted
        sys.stderr.close()  # or Python complains of the pipe at its end
        return 0
    except MemoryError:
        print("mmg: memory does not suffice; close other programs, or give less at once", file=sys.stderr)
        return 2
    except OSError as error:
        where = error.filename or "output"
        if not error.filename:
            _drop_output()
        print(f"mmg: {printable(str(where))}: {error.strerror or error}", file=sys.stderr)
        return 2
    except typer.Exit as stop:
        return int(stop.exit_code)
    except Exception as error:
        if hasattr(error, "format_message"):  # a usage error of the command line
            print(f"mmg: {' '.join(error.format_message().split()).rstrip('.')}; see mmg --help", file=sys.stderr)
            return 2
        if interruptions:  # an import that is broken off ends in an error of its own
            print("mmg: interrupted", file=sys.stderr)
            return 130
        raise


def taken_back() -> None:
    """Semaphores of pools that are still held, on a busy machine say, as an end of the interpreter takes them back."""
    finalizers = getattr(sys.modules.get("multiprocessing.util"), "_run_finalizers", None)
    if finalizers is not None:  # it has no public name
        with contextlib.suppress(Exception):
            finalizers(0)


def run() -> None:
    """Entry point of the console script."""
    code = main()
    if code == 130:  # at once: taking down the libraries that were loaded lasts longer than an answer may
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        patience = time.monotonic() + 0.5  # [s] set by hand: within the two seconds of an answer
        for thread in threading.enumerate():  # those that see processes of a pool end still hold its queues
            if thread is not threading.current_thread():
                thread.join(max(patience - time.monotonic(), 0.0))
        gc.collect()  # semaphores go with their queues, or their tracker warns of them
        taken_back()
        os._exit(code)
    gc.freeze()  # nothing is looked through once more when the interpreter ends
    sys.exit(code)


if __name__ == "__main__":
    run()
