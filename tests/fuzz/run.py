"""Fuzz every reader, guided by coverage if atheris is there, and print a table.

    python tests/fuzz/run.py [--seconds N | --inputs N] [--reader NAME] [--failures FOLDER]

The extra ``fuzz`` brings atheris; without it the mutations are blind (edges: 0). Each reader runs
in a process of its own. Anything but a PossmapError is a failure, as is a warning: it would be a
line that nobody asked for. Failures are saved, each with its traceback beside it. The exit status
is 1 if there are any.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import re
import resource
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from contextlib import nullcontext
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from fuzz.mutation import mutated

LONGEST_S = 60
LARGEST_MIB = 2048
LARGEST_INPUT = 1 << 16
_TOLD_EVERY_S = 1.0
_COVERED = re.compile(r"cov: (\d+)")


def main() -> int:
    """Run what the command line asks for."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    options.add_argument("--seconds", type=int, default=30, help="for each reader (30)")
    options.add_argument("--inputs", type=int, default=0, help="for each reader, instead")
    options.add_argument("--reader", action="append", help="only this one; may be repeated")
    options.add_argument("--failures", type=Path, default=Path("fuzz-failures"))
    options.add_argument("--child", help=argparse.SUPPRESS)
    given = options.parse_args()
    if given.child:
        _fuzz(given.child, given.seconds, given.inputs, given.failures)
    from fuzz.readers import READERS

    names = given.reader or list(READERS)
    _say(f"{'reader':<11}{'inputs':>9}{'per s':>8}{'edges':>7}{'worst s':>9}{'MiB':>6}  failures")
    total = failed = 0
    for name in names:
        found = _run(name, given)
        total += found["inputs"]
        failed += found["failures"]
        rate = found["inputs"] / max(1e-9, found["seconds"])
        _say(
            f"{name:<11}{found['inputs']:>9}{rate:>8.0f}{found['edges']:>7}{found['worst_s']:>9.3f}"
            f"{found['mib']:>6.0f}  {found['failures']}{found['end']}"
        )
    _say(f"{'all':<11}{total:>9}  failures: {failed}")
    return int(failed > 0)


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def _run(name: str, given: argparse.Namespace) -> dict[str, Any]:
    """Fuzz one reader in a process of its own; return what it counted."""
    with tempfile.TemporaryDirectory() as folder:
        stats = Path(folder) / "stats.json"
        command = [sys.executable, __file__, "--child", name, "--seconds", str(given.seconds)]
        command += ["--inputs", str(given.inputs), "--failures", str(given.failures.resolve())]
        with (Path(folder) / "log").open("w+") as log:
            done = subprocess.run(command, cwd=folder, stdout=log, stderr=log, check=False)
            log.seek(0)
            text = log.read()
        if not stats.exists():
            raise SystemExit(f"{name}: did not start:\n{text[-2000:]}")
        found: dict[str, Any] = json.loads(stats.read_text())
    covered = _COVERED.findall(text)
    found["edges"] = int(covered[-1]) if covered else 0
    found["end"] = ""
    if done.returncode:  # a hang, or more memory than allowed
        found["failures"] += 1
        told = [line for line in text.splitlines() if "ERROR" in line]
        found["end"] = f" ({told[-1][:70] if told else f'ended with {done.returncode}'})"
        given.failures.mkdir(parents=True, exist_ok=True)
        (given.failures / f"{name.replace(' ', '-')}-end.txt").write_text(text[-20000:])
    return found


def _fuzz(name: str, seconds: int, count: int, failures: Path) -> None:
    """Fuzz one reader until time or inputs are used up; does not return."""
    try:
        import atheris  # type: ignore[import-untyped]
    except ImportError:
        atheris = None
    with atheris.instrument_imports(include=["possmap"]) if atheris else nullcontext():
        from fuzz.readers import READERS

        from possmap.errors import PossmapError
    reader = READERS[name]
    warnings.simplefilter("error")
    path = Path(f"input{reader.suffix}").resolve()
    corpus = Path("corpus")
    corpus.mkdir()
    for number, seed in enumerate(reader.seeds()):
        (corpus / str(number)).write_bytes(seed)
    seen: set[str] = set()
    stats = {"inputs": 0, "seconds": 0.0, "worst_s": 0.0, "mib": 0.0, "failures": 0}
    start = told = time.perf_counter()

    def tell() -> None:
        stats["seconds"] = time.perf_counter() - start
        stats["mib"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        Path("stats.json").write_text(json.dumps(stats))

    def try_one(data: bytes) -> None:
        nonlocal told
        path.write_bytes(data)
        began = time.perf_counter()
        try:
            reader.read(path)
        except PossmapError as error:
            if not str(error).isprintable():
                _save(failures, name, data, f"not one plain line: {error!r}", seen, stats)
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            key = f"{type(error).__name__} {frames[-1].filename}:{frames[-1].lineno}"
            _save(failures, name, data, traceback.format_exc(), seen, stats, key)
        now = time.perf_counter()
        stats["inputs"] += 1
        if now - began > stats["worst_s"]:
            stats["worst_s"] = now - began
            Path("slowest").write_bytes(data)
        if now - told > _TOLD_EVERY_S or stats["inputs"] == 1:
            told = now
            tell()

    def mutate(data: bytes, most: int, seed: int) -> bytes:
        rng = random.Random(seed)
        if rng.random() < 0.3:
            return bytes(atheris.Mutate(data, most))
        return mutated(data, rng, reader.words)[:most]

    failures.mkdir(parents=True, exist_ok=True)
    if atheris is None:
        rng, seeds = random.Random(name), list(reader.seeds())
        while stats["inputs"] < count if count else time.perf_counter() - start < seconds:
            try_one(mutated(rng.choice(seeds), rng, reader.words)[:LARGEST_INPUT])
        tell()
        sys.exit(0)
    ends = f"-runs={count}" if count else f"-max_total_time={seconds}"
    atheris.Setup(
        [sys.argv[0], ends, f"-max_len={LARGEST_INPUT}", f"-timeout={LONGEST_S}", "-len_control=0",
         f"-rss_limit_mb={LARGEST_MIB}", f"-artifact_prefix={failures}/", str(corpus)],
        try_one,
        custom_mutator=mutate,
    )  # fmt: skip
    atheris.Fuzz()


def _save(
    failures: Path,
    name: str,
    data: bytes,
    why: str,
    seen: set[str],
    stats: dict[str, float],
    key: str = "",
) -> None:
    """Keep an input that failed in a way not seen before."""
    key = key or why.partition(":")[0]
    if key in seen:
        return
    seen.add(key)
    stats["failures"] += 1
    stem = failures / f"{name.replace(' ', '-')}-{hashlib.sha256(data).hexdigest()[:12]}"
    stem.with_suffix(".input").write_bytes(data)
    stem.with_suffix(".txt").write_text(why)


if __name__ == "__main__":
    sys.exit(main())
