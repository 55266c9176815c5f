"""Kills, failing disks, power cuts and many writers: tries them all, and prints what survived.

    python tests/crash/run.py --kills 1000 --faults 200

Needs Linux and a C compiler. Exit code 1 if anything that was promised did not hold.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from crash import shim  # noqa: E402


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--kills", type=int, default=1000)
    parser.add_argument("--faults", type=int, default=200)
    parser.add_argument("--cuts", type=int, default=300, help="power cuts")
    parser.add_argument("--weaker", type=int, default=300, help="the same where less is promised")
    parser.add_argument("--waits", type=int, default=1, help="whether processes wait for others")
    parser.add_argument("--rounds", type=int, default=2, help="of several writers at once")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--small", action="store_true", help="two small batches only")
    parser.add_argument("--json", action="store_true", help="print figures for a program")
    return parser.parse_args()


def main() -> None:
    asked = arguments()
    # The shim is compiled into a folder that outlives the program that is replaced.
    with _scratch("SHIM_FOLDER") as folder:
        shim.preload(folder)
        with _scratch(None, fast=True) as fast, _scratch(None) as slow:
            found = figures(asked, fast, slow)
    if asked.json:
        sys.stdout.write(json.dumps(found) + "\n")
    else:
        sys.stdout.write("\n".join(_table(found)) + "\n")
    sys.exit(any(part["broken"] for part in found.values()))


@contextmanager
def _scratch(variable: str | None, fast: bool = False) -> Iterator[Path]:
    """Make a folder; with a variable of the environment, the same one again after ``exec``."""
    memory = Path("/dev/shm")
    where = memory if fast and os.access(memory, os.W_OK) else None
    given = os.environ.get(variable) if variable else None
    made = Path(given or tempfile.mkdtemp(prefix="possmap-crash.", dir=where))
    if variable:
        os.environ[variable] = str(made)
    try:
        yield made
    finally:
        shutil.rmtree(made, ignore_errors=True)


def figures(asked: argparse.Namespace, fast: Path, slow: Path) -> dict[str, dict[str, object]]:
    """Try everything. fast, slow : folders in memory, and on a disk that takes time to sync."""
    from crash import faults, kills, powercut, writers
    from crash.aftermath import Tally
    from crash.batches import batches

    in_memory = few = batches(fast, short=True)
    if not asked.small:
        in_memory = batches(_made(fast / "all"))
    share = asked.kills // 20
    seed, found = asked.seed, {}

    def part(name: str, do: Callable[[], Tally]) -> None:
        start = time.monotonic(), _cpu()
        tally = do()
        counts = dict(tally.counts.most_common())
        found[name] = {
            "tried": tally.tried, "survived": tally.tried - len(tally.broken), "counts": counts,
            "broken": tally.broken, "seconds": round(time.monotonic() - start[0], 1),
            "cpu": round(_cpu() - start[1], 1),
        }  # fmt: skip
        if not asked.json:
            sys.stderr.write(f"{name}: {tally.tried} tried, {len(tally.broken)} broken\n")

    if asked.kills:
        on_disk = batches(slow, asked.small)
        part("kills at random moments", lambda: kills.at_random(on_disk, 9 * share, 1, seed))
        part("the same with --jobs 2", lambda: kills.at_random(on_disk, 3 * share, 2, seed))
        part("kills before statements", lambda: kills.before_statements(in_memory, 3 * share))
        part("kills at calls", lambda: kills.at_calls(in_memory, 5 * share))
        part("kills of forget", lambda: kills.of_forget(few[1], 2 * share))
    if asked.faults:
        limits = max(4, asked.faults // 10)
        part("calls that fail", lambda: faults.at_calls(few, asked.faults - 2 * limits, seed))
        part("limits on file sizes", lambda: faults.size_limits(few, limits))
        part("full disks", lambda: faults.full_disks(few, limits))
    if asked.cuts:
        part("power cuts", lambda: powercut.power_cuts(in_memory, asked.cuts, seed))
    if asked.weaker:
        part("power cuts, less promised", lambda: powercut.weaker(few, asked.weaker // 3, seed))
    if asked.waits:
        part("processes that wait", lambda: writers.one_that_waits(_made(slow / "waiting")))
    if asked.rounds:
        folder, short = _made(slow / "writers"), asked.small
        part("several writers", lambda: writers.rounds(folder, asked.rounds, seed, short))
    return found


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def _cpu() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def _table(found: dict[str, dict[str, object]]) -> Iterator[str]:
    for name, part in found.items():
        yield (
            f"{name}: {part['survived']} of {part['tried']} survived "
            f"({part['seconds']} s, {part['cpu']} s of CPU)"
        )
        counts = part["counts"]
        assert isinstance(counts, dict)
        yield from (f"    {count:6}  {what}" for what, count in counts.items())
        broken = part["broken"]
        assert isinstance(broken, list)
        yield from (f"    BROKEN  {line}" for line in broken)


if __name__ == "__main__":
    main()
