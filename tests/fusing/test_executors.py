"""Executors: results in order, errors with their traceback, bounds, and processes that die."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest
from fusing import tasks

from possmap.budget import Budget
from possmap.errors import GridError, LogError, WorkerError
from possmap.fusing.executors import SERIAL, Hands, Processes, hands

LARGE = 1 << 20


def one_byte(*_: object) -> int:
    return 1


@pytest.mark.parametrize("jobs", [1, 3])
def test_results_come_in_the_order_of_the_tasks(jobs: int) -> None:
    with hands(jobs, None, Budget()) as workers:
        found = workers.map(tasks.square, ((n,) for n in range(50)), one_byte)
        assert list(found) == [n * n for n in range(50)]


def test_two_kinds_of_work_go_on_side_by_side() -> None:
    with hands(2, None, Budget()) as workers:
        one, other = (
            workers.map(function, ((n,) for n in range(20)), one_byte)
            for function in (tasks.square, tasks.power)
        )
        assert list(zip(one, other, strict=True)) == [(n * n, 2**n) for n in range(20)]


def test_what_a_task_raises_is_raised_here_as_it_was() -> None:
    with hands(2, None, Budget()) as workers:
        with pytest.raises(GridError, match="tile 7"):
            list(workers.map(tasks.refuse, [(7,)], one_byte))
        with pytest.raises(LogError, match="a:3: wrong") as caught:
            list(workers.map(tasks.refuse_a_log, [()], one_byte))
        assert (caught.value.place, caught.value.problem) == ("a:3", "wrong")


def test_a_bug_keeps_its_traceback() -> None:
    with (
        hands(2, None, Budget()) as workers,
        pytest.raises(ZeroDivisionError) as caught,
    ):
        list(workers.map(tasks.stumble, [(1,), (0,)], one_byte))
    assert "return 1 // number" in "".join(caught.value.__notes__)


def test_what_cannot_be_sent_is_told() -> None:
    with hands(2, None, Budget()) as workers, pytest.raises(RuntimeError, match="number 3") as told:
        list(workers.map(tasks.fail_unsendably, [(3,)], one_byte))
    assert "Unsendable: number 3" in "".join(told.value.__notes__)


@pytest.mark.parametrize(("workers", "ahead"), [(SERIAL, 0), (Hands(SERIAL.executor, 3), 2)])
def test_no_more_is_begun_than_may_be_on_its_way(workers: Hands, ahead: int) -> None:
    begun: list[int] = []

    def numbers() -> Iterator[tuple[int]]:
        for number in range(9):
            begun.append(number)
            yield (number,)

    found = workers.map(tasks.square, numbers(), one_byte)
    assert next(found) == 0 and len(begun) == ahead + 2
    assert list(found) == [n * n for n in range(1, 9)]


@pytest.mark.skipif(sys.platform == "win32", reason="kills")
@pytest.mark.parametrize("size", [0, 64 * LARGE])
def test_a_process_that_dies_even_while_it_sends_ends_the_work_in_one_line(size: int) -> None:
    with Processes(2) as executor:

        def keep_sending() -> None:
            for _ in range(20):
                for one in [executor.submit(tasks.send, size) for _ in range(4)]:
                    one.result(timeout=20)

        sending = executor.submit(tasks.send, size)
        time.sleep(0.02 if size else 0)
        os.kill(executor.pids[0], signal.SIGKILL)
        with pytest.raises(WorkerError, match="a process of --jobs ended early"):
            keep_sending()
        sending.exception(timeout=20)


def test_threads_that_cannot_start_are_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: Thread) -> None:
        raise RuntimeError("can't start new thread")

    with hands(2, None, Budget()) as workers:
        monkeypatch.setattr(Thread, "start", fail)
        with pytest.raises(WorkerError, match="no room for more threads"):
            list(workers.map(tasks.square, [(1,)], one_byte))
        monkeypatch.undo()


@pytest.mark.skipif(sys.platform == "win32", reason="no groups of processes")
def test_processes_do_not_hear_what_their_group_is_told() -> None:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    with hands(2, None, Budget()) as workers:
        heard = list(workers.map(tasks.unheard, ((n,) for n in range(6)), one_byte))
    assert heard == [tasks.UNHEARD] * 6
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before


def test_no_process_is_left_when_the_work_ends_early(tmp_path: Path) -> None:
    def stop() -> None:
        with hands(2, None, Budget()) as workers:
            for _ in range(3):
                workers.executor.submit(tasks.sleep, tmp_path)
            until = time.monotonic() + 20
            while len(list(tmp_path.iterdir())) < 2 and time.monotonic() < until:
                time.sleep(0.01)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stop()
    pids = {int(path.name.partition("-")[0]) for path in tmp_path.iterdir()}
    assert len(pids) == 2
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
