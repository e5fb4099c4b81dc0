"""Where independent pieces of work run: here, in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import importlib
import multiprocessing
import socket
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import Any, TypeVar
from urllib.parse import urlsplit

from backsight.models.errors import InputError

from .threads import one_each

CONNECT_SECONDS = 5.0
K = TypeVar("K")
T = TypeVar("T")

AHEAD = 64  # calls that a cluster has at hand


class Here(Executor):
    """Runs every call at once, in this process."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The finished future of `fn(*args, **kwargs)`."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def at_hand(jobs: int = 1, scheduler: str | None = None) -> int:
    """How many calls to have submitted at once, so that nobody waits for the next one."""
    return AHEAD if scheduler else 1 if jobs == 1 else 2 * jobs


def as_finished(pool: Executor, calls: Iterable[tuple[K, Callable[[], T]]], ahead: int) -> Iterator[tuple[K, T]]:
    """The key and the result of every call, as it is finished; the next call is drawn when fewer than `ahead` are under way.

    Raises what a call raises.
    """
    left, under_way = iter(calls), dict[Future[T], K]()
    while True:
        for key, call in islice(left, ahead - len(under_way)):
            under_way[pool.submit(call)] = key
        if not under_way:
            return
        for future in wait(under_way, return_when=FIRST_COMPLETED).done:
            yield under_way.pop(future), future.result()


def in_order(calls: Iterable[Callable[[], T]], threads: int) -> Iterator[T]:
    """The result of every call, in order, a few at a time in threads of this process: of what leaves the interpreter while it works.

    The next call is drawn, here, when no more than `threads` are under way. Raises what a call raises.
    """
    if threads < 2:
        yield from (call() for call in calls)
        return
    with ThreadPoolExecutor(threads) as pool:
        under_way = deque[Future[T]]()
        for call in calls:
            under_way.append(pool.submit(call))
            if len(under_way) > threads:
                yield under_way.popleft().result()
        while under_way:
            yield under_way.popleft().result()


def check_workers(jobs: int, scheduler: str | None) -> None:
    """Raise InputError unless it is a number of processes, and something answers where a cluster is said to be."""
    if jobs < 1:
        raise InputError(f"--jobs {jobs}: the number of processes must be at least 1")
    if scheduler is not None:
        _knock(scheduler)


@contextmanager
def workers(jobs: int = 1, scheduler: str | None = None) -> Iterator[Executor]:
    """An executor of `jobs` processes, or of the Dask cluster at address `scheduler`.

    Raises InputError when `jobs` is not positive, the cluster cannot be reached, or a process is lost.
    """
    check_workers(jobs, scheduler)
    if scheduler is not None:
        with _cluster(scheduler) as pool:
            yield pool
    elif jobs == 1:
        yield Here()
    else:
        with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
            try:
                with one_each():
                    for _ in range(jobs):  # a process takes its seconds to be there
                        pool.submit(_there)
                yield pool
            except BrokenProcessPool:
                pool.shutdown(wait=False, cancel_futures=True)
                remedy = 'ask for fewer where memory is short, and in a script of your own under `if __name__ == "__main__":`'
                raise InputError(f"--jobs {jobs}: a process has ended before its work was done; {remedy}") from None
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise


def _there() -> None:
    """What a process has done when it is ready for work."""
    importlib.import_module("backsight.estimation.smoothing.smoother")


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        remedy = "install it by `pip install backsight[cluster]`, or leave --scheduler out"
        raise InputError(f"--scheduler {address}: a cluster needs dask.distributed; {remedy}") from None
    try:
        client = distributed.Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise _no_answer(address, error) from None
    try:
        yield client.get_executor()
    except (distributed.scheduler.KilledWorker, CancelledError, distributed.comm.CommClosedError) as error:
        lost = str(error).splitlines()[0][:200] if str(error) else "the scheduler is gone"
        remedy = "start it again with more memory for each worker, or leave --scheduler out; what was finished is kept"
        raise InputError(f"--scheduler {address}: the cluster was lost before its work was done ({lost}); {remedy}") from error
    finally:
        client.close()


def _knock(address: str) -> None:
    """Raise InputError at once where nobody listens: the client itself keeps trying for long."""
    parts = urlsplit(address if "://" in address else f"tcp://{address}")
    try:
        if parts.scheme in ("tcp", "tls"):
            socket.create_connection((parts.hostname or "", parts.port or 8786), timeout=CONNECT_SECONDS).close()
    except (OSError, ValueError) as error:
        raise _no_answer(address, error) from None


def _no_answer(address: str, error: Exception) -> InputError:
    reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    return InputError(f"--scheduler {address}: no Dask scheduler answers there ({reason[:200]}); start one, or correct the address")
