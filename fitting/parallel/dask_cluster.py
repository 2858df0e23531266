"""Tasks on a Dask cluster: a scheduler that is named by its address, and the workers that it has.

Tasks are handed over a few at a time, so that neither the scheduler nor a worker holds more than it works on. A task
whose worker is lost is done again by another one. Nothing is started here, and nothing listens: the cluster is the
user's, and so are its encryption and access rights (``distributed.comm`` in Dask's own configuration).
"""

from __future__ import annotations

import importlib.metadata
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from typing import Any

from fitting.parallel.executors import executing
from fitting.report.run_folder import NOT_INSTALLED, versions
from mmg.errors import Conflict, NotInstalled, ProgramFailed, UserError, reason
from mmg.messages import LOGGER

PACKAGE = "mmg-ident"  # Of which client and workers must have the same version
TIMEOUT = 10.0  # Seconds within which a scheduler answers and has a worker. Set by hand.

_ALONE = threading.Lock()  # Of this worker, whose threads Dask would use side by side


def _alone(function: Callable[[Any], Any], task: Any) -> Any:
    """``function`` of a ``task``, one at a time in each worker, with one thread as in a process of a pool."""
    import sys

    from threadpoolctl import threadpool_limits

    with _ALONE, threadpool_limits(1):  # libraries have as many as Dask or the machine gave them
        if "torch" in sys.modules:  # else it is not wanted, and slow to import
            sys.modules["torch"].set_num_threads(1)
        return function(task)


class DaskCluster:
    """The executor of a scheduler's workers.

    client: connected ``distributed.Client``; address: of the scheduler, as it was given.
    """

    def __init__(self, client: Any, address: str) -> None:
        self.client, self.address = client, address
        self.executor = client.get_executor(pure=False)  # pure tasks with equal arguments would be done once

    @property
    def width(self) -> int:
        """Number of workers that the scheduler has now, one at least. Raises UserError where it is lost."""
        try:
            if self.client.status != "running":
                raise ConnectionError(f"the connection is {self.client.status}")
            return max(1, len(self.client.scheduler_info(n_workers=-1)["workers"]))
        except KeyError:  # what is left of a scheduler that is gone says nothing of workers
            raise self._lost("it does not answer") from None
        except OSError as error:
            raise self._lost(str(error)) from None

    def submit(self, function: Callable[[Any], Any], task: Any) -> Future[Any]:
        """As of ``Workers``."""
        future: Future[Any] = self.executor.submit(_alone, function, task)
        return future

    def explained(self, error: BaseException) -> BaseException:
        """As of ``Workers``: an ``error`` of a lost scheduler, or of a task that ends all workers, is one line."""
        from distributed import KilledWorker

        if isinstance(error, KilledWorker):
            words = f"{self.address}: a task ended one worker after another, perhaps for want of memory"
            return ProgramFailed(f"{words}; give the workers more memory, or use --workers")
        is_lost = isinstance(error, CancelledError | OSError) and self.client.status != "running"
        return self._lost(str(error) or type(error).__name__) if is_lost else error

    def _lost(self, why: str) -> UserError:
        words = f"{self.address}: the scheduler was lost ({why})"
        return ProgramFailed(f"{words}; start it again and repeat the command, with --resume where it has one")


@contextmanager
def dask_cluster(address: str) -> Iterator[DaskCluster]:
    """Within this, ``run_all`` hands its tasks to the Dask scheduler at ``address``, such as tcp://127.0.0.1:8786.

    Yields the executor. Raises UserError where Dask is not installed, where no scheduler of the same version answers
    within TIMEOUT, and for workers that are missing, lack this package or have another version of it.
    """
    try:
        import distributed
    except ImportError:
        raise NotInstalled("--scheduler needs Dask: pip install 'mmg-ident[dask]'") from None
    try:
        check_scheduler(_greeted(address), address)
        with warnings.catch_warnings():  # what differs is said in a line, or does not matter
            warnings.simplefilter("ignore", distributed.versions.VersionMismatchWarning)
            client = distributed.Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError, KeyError, distributed.TimeoutError) as error:
        why = reason(error, 200)
        raise ProgramFailed(f"--scheduler {address}: no Dask scheduler answers there ({why})") from None
    try:
        check_workers(client, address)
        cluster = DaskCluster(client, address)
        LOGGER.info("tasks go to %d worker(s) of %s", cluster.width, address)
        with executing(cluster):
            yield cluster
    finally:
        client.close()


def _greeted(address: str) -> str:
    """The version of Dask of the scheduler at ``address``, asked before a client is made: that waits for ever where
    something else listens, and an old scheduler does not understand it. Raises what Dask raises, or TimeoutError."""
    import asyncio
    from concurrent.futures import ThreadPoolExecutor

    from distributed.comm import connect
    from distributed.core import send_recv
    from distributed.security import Security

    async def version() -> str:
        comm = await connect(address, timeout=TIMEOUT, **Security().get_connection_args("client"))
        try:
            return str((await send_recv(comm, op="versions"))["packages"]["distributed"])
        finally:
            await comm.close()

    with ThreadPoolExecutor(1) as apart:  # a notebook has a loop of its own in this thread
        # 2 s more: connect() says why
        return apart.submit(asyncio.run, asyncio.wait_for(version(), TIMEOUT + 2)).result()


def check_scheduler(theirs: str, address: str) -> None:
    """Raises UserError where ``theirs``, the Dask of the scheduler at ``address``, is not that of this process."""
    import distributed

    if theirs != distributed.__version__:
        raise Conflict(
            f"--scheduler {address}: the scheduler has distributed {theirs}, this process {distributed.__version__}; "
            "install the same version on all machines"
        )


def check_workers(client: Any, address: str) -> None:
    """Raises UserError unless scheduler and workers are there and of the versions of this process.

    client: connected ``distributed.Client``; address: of the scheduler, for the message.
    """
    import distributed

    here = versions()[PACKAGE]
    try:
        client.wait_for_workers(1, timeout=TIMEOUT)
    except (OSError, distributed.TimeoutError):
        raise ProgramFailed(
            f"--scheduler {address}: no worker within {TIMEOUT:g} s; start one: dask worker {address} --nthreads 1"
        ) from None
    reported = client.get_versions()
    check_scheduler(reported["scheduler"]["packages"]["distributed"], address)
    installed = client.run(importlib.metadata.version, PACKAGE, on_error="return")  # an exception where it is not
    for worker, version in sorted(installed.items()):
        if version != here and (here != NOT_INSTALLED or not isinstance(version, Exception)):
            what = f"has {PACKAGE} {version}" if isinstance(version, str) else f"lacks {PACKAGE}"
            raise Conflict(f"--scheduler {address}: the worker {worker} {what}; install {PACKAGE} {here} there")
    ours = reported["client"]["packages"]["python"].rpartition(".")[0]  # without the patch level: pickles are the same
    for worker, about in sorted(reported["workers"].items()):
        if (theirs := about["packages"]["python"]).rpartition(".")[0] != ours:
            raise Conflict(f"--scheduler {address}: {worker} has Python {theirs}, this process another")
