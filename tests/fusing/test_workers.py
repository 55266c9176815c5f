"""Processes of ``--jobs``: results in order, errors with their traceback, bounds, and deaths."""

from __future__ import annotations

import os
import pickle
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest
from fusing import tasks

from possmap.errors import GridError, WorkerError
from possmap.fusing.serving import unpacked
from possmap.fusing.workers import IN_FLIGHT, gathered, here, workers

MUCH = 1 << 30


def weightless(_: object) -> int:
    return 0


@pytest.mark.parametrize("jobs", [1, 3])
def test_results_come_in_the_order_of_the_tasks(jobs: int) -> None:
    with workers(jobs, MUCH) as spread:
        assert list(spread(tasks.square, range(50), weightless)) == [n * n for n in range(50)]


def test_two_kinds_of_work_go_on_side_by_side() -> None:
    with workers(2, MUCH) as spread:
        one, other = (
            spread(tasks.square, range(20), weightless),
            spread(tasks.power, range(20), weightless),
        )
        both = list(zip(one, other, strict=True))
    assert both == [(n * n, 2**n) for n in range(20)]


def test_what_a_task_raises_is_raised_here() -> None:
    with workers(2, MUCH) as spread, pytest.raises(GridError, match="tile 7"):
        list(spread(tasks.refuse, [7], weightless))


def test_a_bug_keeps_its_traceback() -> None:
    with workers(2, MUCH) as spread, pytest.raises(ZeroDivisionError) as caught:
        list(spread(tasks.stumble, [1, 0], weightless))
    assert "return 1 // number" in "".join(caught.value.__notes__)


def test_what_cannot_be_sent_is_told() -> None:
    with workers(2, MUCH) as spread, pytest.raises(RuntimeError, match="number 3") as caught:
        list(spread(tasks.fail_unsendably, [3], weightless))
    assert "Unsendable: number 3" in "".join(caught.value.__notes__)


def test_an_answer_is_a_result_or_an_error() -> None:
    assert unpacked(pickle.dumps((5, None))) == 5
    with pytest.raises(GridError):
        unpacked(pickle.dumps((GridError("x"), "trace")))


def wait_for(folder: Path, count: int) -> int:
    """Wait until so many tasks are done, and then a little: return how many are."""
    until = time.monotonic() + 20
    while len(list(folder.iterdir())) < count and time.monotonic() < until:
        time.sleep(0.01)
    time.sleep(0.3)
    return len(list(folder.iterdir()))


def test_as_many_tasks_are_begun_as_may_be_on_their_way(tmp_path: Path) -> None:
    with workers(2, MUCH) as spread:
        results = spread(tasks.note, [tmp_path] * 100, weightless)
        next(results)
        assert wait_for(tmp_path, 2 * IN_FLIGHT) == 2 * IN_FLIGHT


@pytest.mark.parametrize(("weight", "begun"), [(tasks.LARGE, 4), (0, 2 * IN_FLIGHT)])
def test_results_done_ahead_stay_within_their_bound(
    tmp_path: Path, weight: int, begun: int
) -> None:
    taken: list[int] = []

    def folders() -> Iterator[Path]:
        for number in range(100):
            taken.append(number)
            yield tmp_path

    with workers(2, 4 * tasks.LARGE) as spread:
        results = spread(tasks.note, folders(), lambda _: weight)
        next(results)
        assert wait_for(tmp_path, begun) == begun
        next(results)  # however light they were said to be, by now they are known to be large
        assert wait_for(tmp_path, begun) <= max(begun, 5)
        assert len(taken) <= max(begun + 1, 5)
        assert sum(1 for _ in results) == 98


@pytest.mark.skipif(sys.platform == "win32", reason="kills")
def test_a_process_that_dies_ends_the_work_in_one_line() -> None:
    with workers(2, MUCH) as spread:
        results = spread(tasks.die_at_2, range(30), weightless)
        with pytest.raises(WorkerError, match="a process of --jobs ended early"):
            list(results)


def test_threads_that_cannot_start_are_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: Thread) -> None:
        raise RuntimeError("can't start new thread")

    with workers(2, MUCH) as spread:
        monkeypatch.setattr(Thread, "start", fail)
        with pytest.raises(WorkerError, match="no room for more threads"):
            list(spread(tasks.square, [1], weightless))
        monkeypatch.undo()


@pytest.mark.skipif(sys.platform == "win32", reason="no groups of processes")
def test_processes_do_not_hear_what_their_group_is_told() -> None:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    with workers(2, MUCH) as spread:
        assert list(spread(tasks.unheard, range(6), weightless)) == [tasks.UNHEARD] * 6
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before


def test_no_process_is_left_when_the_work_ends_early(tmp_path: Path) -> None:
    with workers(2, MUCH) as spread:
        spread(tasks.sleep, [tmp_path] * 9, weightless)._go_ahead()  # type: ignore[attr-defined]
        wait_for(tmp_path, 2)
    pids = {int(path.name.partition("-")[0]) for path in tmp_path.iterdir()}
    assert len(pids) == 2
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_one_process_does_each_task_when_it_is_asked_for() -> None:
    done: list[int] = []
    results = here(done.append, range(3), weightless)
    next(results)
    assert done == [0]


def test_a_large_item_is_a_task_of_its_own() -> None:
    sizes = [1, 1, 9, 1, 1, 1, 1, 1, 20]
    found = list(gathered(sizes, lambda size: size, 4))
    assert found == [[1, 1], [9], [1, 1, 1, 1], [1], [20]]
