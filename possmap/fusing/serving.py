"""What a process of ``--jobs`` does: one task after another, until its pipe ends."""

from __future__ import annotations

import gc
import os
import pickle
import traceback
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from threading import Thread
from typing import Any


def serve(pipe: Connection) -> None:
    """Answer whoever holds the other end of a pipe."""
    # Records are many, and none of them is in a cycle: an eighth of the time of a batch.
    gc.set_threshold(100_000, 50, 100)
    Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            task = pipe.recv_bytes()
        except (EOFError, OSError):
            return
        answer = _answer(task)
        try:
            pipe.send_bytes(answer)
        except OSError:
            return


def _answer(task: bytes) -> bytes:
    try:
        function, argument = pickle.loads(task)
        return pickle.dumps((function(argument), None), pickle.HIGHEST_PROTOCOL)
    except Exception as error:
        trace = "In a process of --jobs:\n" + traceback.format_exc()
        try:
            return pickle.dumps((error, trace))
        except Exception:  # it cannot be sent; what it was can be read
            return pickle.dumps((RuntimeError(str(error)), trace))


def unpacked(answer: bytes) -> Any:
    """Return the result that a process sent, or raise what it raised, with its traceback there."""
    result, trace = pickle.loads(answer)
    if trace is None:
        return result
    result.add_note(trace)
    raise result


def _end_with_parent() -> None:
    """End at once when the process that started this one is gone, killed or not."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
