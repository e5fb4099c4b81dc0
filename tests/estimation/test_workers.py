"""Pieces of work give the same answers wherever they run."""

from __future__ import annotations

import os
import time
import warnings
from functools import partial

import pytest

from backsight.estimation.workers import as_finished, at_hand, in_order, workers
from backsight.models.errors import InputError


def test_here_and_in_two_processes_the_answers_are_the_same():
    for jobs in (1, 2):
        with workers(jobs) as pool:
            futures = [pool.submit(divmod, k, 7) for k in range(20)]
            assert [future.result() for future in futures] == [divmod(k, 7) for k in range(20)]


def test_processes_have_one_thread_of_linear_algebra_unless_the_user_says_otherwise(monkeypatch):
    """Two processes with two threads each on two cores were slower than one."""
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    with workers(2) as pool:
        futures = [pool.submit(os.getenv, name) for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")]
        assert [f.result() for f in futures] == ["1", "3"]
    assert "OPENBLAS_NUM_THREADS" not in os.environ


def test_a_process_that_is_lost_is_named_with_what_to_do():
    with pytest.raises(InputError, match=r"--jobs 2: a process has ended .*fewer.*__main__"), workers(2) as pool:
        pool.submit(os._exit, 1).result()


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_a_piece_of_work_raises_is_raised_where_its_answer_is_asked_for(jobs):
    with workers(jobs) as pool:
        future = pool.submit(divmod, 1, 0)
        with pytest.raises(ZeroDivisionError):
            future.result()


@pytest.mark.parametrize("jobs", [1, 2])
def test_calls_are_drawn_as_there_is_room_and_every_result_has_its_key(jobs):
    drawn = list[int]()

    def calls():
        for k in range(20):
            drawn.append(k)
            yield k, partial(divmod, k, 7)

    found = dict[int, tuple[int, int]]()
    with workers(jobs) as pool:
        for key, result in as_finished(pool, calls(), at_hand(jobs)):
            found[key] = result
            assert len(drawn) - len(found) < at_hand(jobs)
    assert found == {k: divmod(k, 7) for k in range(20)}


@pytest.mark.checkout
@pytest.mark.slow
@pytest.mark.parametrize("threads", [1, 3])
def test_threads_give_results_in_order_and_draw_no_call_before_there_is_room(threads):
    drawn, taken = list[int](), 0

    def calls():
        for k in range(12):
            drawn.append(k)
            yield lambda k=k: (time.sleep(0.01 * (k % 3 == 0)), k)[1]

    for taken, k in enumerate(in_order(calls(), threads)):
        assert k == taken
        assert len(drawn) <= taken + threads + 1
    assert taken == 11
    with pytest.raises(ZeroDivisionError):
        list(in_order([partial(divmod, 1, 1), partial(divmod, 1, 0)], threads))


def test_a_dask_cluster_is_an_executor_like_any_other():
    distributed = pytest.importorskip("distributed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        cluster = distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None)
        try:
            with workers(scheduler=cluster.scheduler_address) as pool:
                assert [pool.submit(divmod, k, 7).result() for k in range(5)] == [divmod(k, 7) for k in range(5)]
        finally:
            cluster.close()


def _lost() -> None:
    os._exit(1)


@pytest.mark.checkout
@pytest.mark.slow
def test_a_cluster_that_loses_its_workers_is_named_with_what_to_do():
    distributed, dask = pytest.importorskip("distributed"), pytest.importorskip("dask")
    with warnings.catch_warnings(), dask.config.set({"distributed.scheduler.allowed-failures": 0}):
        warnings.simplefilter("ignore")
        cluster = distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None)
        try:
            address = cluster.scheduler_address
            said = rf"--scheduler {address}: the cluster was lost .*memory.*kept"
            with pytest.raises(InputError, match=said), workers(scheduler=address) as pool:
                list(as_finished(pool, [("one", _lost)], 4))
        finally:
            cluster.close()


@pytest.mark.parametrize(
    ("options", "words"),
    [({"jobs": 0}, r"--jobs 0: .* at least 1"), ({"scheduler": "tcp://127.0.0.1:9"}, r"--scheduler tcp://127\.0\.0\.1:9: ")],
)
def test_workers_that_cannot_be_had_are_bad_input(options, words):
    with pytest.raises(InputError, match=words), workers(**options):
        pytest.fail("there was nobody to work")
