"""The way of a second log into a grid: functions and modules of possmap that it passes, and depth.

    python tests/benchmarks/way_of_a_log.py

What is counted is what runs between the call of ``fuse`` and its end, comprehensions left out;
depth is how many functions of possmap are on the stack at once. A function of core/ is the method,
and is counted apart.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from types import FrameType

from scaling import print_table
from tracks import the_km

import possmap
from possmap.fusing.fuse import fuse

ROOT = str(Path(possmap.__file__).parent)


class Way:
    """Notes which functions are called."""

    def __init__(self) -> None:
        self.functions: set[tuple[str, str]] = set()
        self.depth = self.deepest = 0
        self.deepest_way: list[str] = []

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        """Note a call or a return, as ``sys.setprofile`` tells of it."""
        code = frame.f_code
        if event not in ("call", "return") or not code.co_filename.startswith(ROOT):
            return
        if code.co_name.startswith("<"):
            return
        self.depth += 1 if event == "call" else -1
        if event == "call":
            self.functions.add((code.co_filename.removeprefix(ROOT + "/"), code.co_qualname))
            if self.depth > self.deepest:
                self.deepest, self.deepest_way = self.depth, _stack(frame)


def _stack(frame: FrameType | None) -> list[str]:
    found = []
    while frame is not None:
        if frame.f_code.co_filename.startswith(ROOT):
            found.append(frame.f_code.co_qualname)
        frame = frame.f_back
    return found[::-1]


def main() -> None:
    """Print the figures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        logs = []
        for seed in (1, 2):
            path = folder / f"{seed}.json"
            path.write_text(json.dumps(the_km(seed) | {"excursion": f"{seed}"}))
            logs.append(str(path))
        fuse(logs[:1], folder / "site.possmap")
        way = Way()
        sys.setprofile(way)
        fuse(logs[1:], folder / "site.possmap")
        sys.setprofile(None)
    modules = {module for module, _ in way.functions}
    core = {module for module in modules if module.startswith("core/")}
    print_table(
        f"{len(way.functions)} functions in {len(modules)} modules, {len(core)} of them the method;"
        f" depth {way.deepest}: {' > '.join(way.deepest_way)}",
        "module | functions",
        [[module, str(sum(m == module for m, _ in way.functions))] for module in sorted(modules)],
    )


if __name__ == "__main__":
    main()
