"""Small valid files of every kind, for mutations to begin with."""

from __future__ import annotations

import gzip
import io
import json
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

DATA = Path(__file__).parents[2] / "data"


def log_seeds() -> list[bytes]:
    carried = {
        "robot": "b", "excursion": "1", "x_note": [1, {"a": None}],
        "records": [{"seq": 0, "kind": "pose", "x": 0, "y": 0, "heading": 0}],
    }  # fmt: skip
    records = [
        {"seq": 0, "kind": "meet", "peer": "b", "peer_excursion": "1", "upto": 0},
        {"seq": 1, "kind": "pose", "t": 0.5, "x": 0.0, "y": 0.0, "heading": 90, "error_x": 0.1},
        {"seq": 2, "kind": "wall", "x": 0, "y": 1, "x2": 1, "y2": 1, "followed": False},
        {"seq": 3, "kind": "beam", "x": 0, "y": 1, "x2": 1, "y2": 1, "hit": True, "x_a": "b"},
        {"seq": 9, "kind": "corner", "x": 0, "y": 1, "corner": "end"},
        {"seq": 10, "kind": "pose", "t": 5, "x": 0.0, "y": 2e0, "heading": -90},
    ]
    log = {"possmap_log": 1, "robot": "a", "excursion": "1", "model": {"turn_spread": 0.5}}
    return [json.dumps({**log, "records": records, "carried": [carried]}).encode()]


def lines_seeds() -> list[bytes]:
    log = json.loads(log_seeds()[0])
    records, carried = log.pop("records"), log.pop("carried")
    (other,) = carried
    lines = [log, *records[:3], {k: v for k, v in other.items() if k != "records"}]
    lines += [*other["records"], {"robot": "a", "excursion": "1", "x_b": 1}, *records[3:]]
    return ["\n".join(map(json.dumps, lines)).encode() + b"\n"]


def csv_seeds() -> list[bytes]:
    return [b"\n".join((DATA / "csv" / "team.csv").read_bytes().splitlines()[:12]) + b"\n"]


def image_seeds() -> list[bytes]:
    from PIL import Image

    seeds = [b"P5 4 4 255\n" + bytes(range(0, 256, 16)), b"P2 2 2 255 0 255 9 254\n"]
    for mode, form in (("L", "PNG"), ("RGBA", "PNG"), ("1", "PNG"), ("P", "PNG"), ("I;16", "PNG"),
                       ("RGB", "BMP"), ("1", "PPM")):  # fmt: skip
        stream = io.BytesIO()
        white = Image.new("RGB", (6, 5), "white")
        image = Image.new(mode, (6, 5), 65535) if mode == "I;16" else white.convert(mode)
        image.save(stream, form)
        seeds.append(stream.getvalue())
    return seeds


def carmen_seeds() -> list[bytes]:
    odom = b"ODOM 0.1 0 0 0 0 0 1.0 host 1.0\nODOM 0.2 0 0.1 0 0 0 2.0 host 2.0\n"
    laser = b"PARAM a b\n" + b"".join(
        b"FLASER 4 1.0 2.0 81 0.5 %d 0 0 %d 0 0 %d host %d\n" % (n, n, n, n) for n in range(4)
    )
    new = b"".join(
        b"ROBOTLASER1 0 -1.5 3.1 1.5 80 0.01 0 2 1.0 2.0 0 %d 0 0 %d 0 0 0 0 0 0 0 %d host %d\n"
        % (n, n, n, n)
        for n in range(4)
    )
    return [odom, laser, new]


def table_json_seeds() -> list[bytes]:
    row = {"t": 0, "x": 0, "y": 1, "yaw": 0.1, "vx": 0, "vy": 0.5, "front": 1, "left": 2.5}
    rows = [{**row, "t": t, "y": t / 2} for t in range(4)]
    ticks = [{"t": t, "l": 9 * t, "r": 10 * t, "s": [1, 2.5, None]} for t in range(4)]
    return [json.dumps(rows).encode(), "\n".join(map(json.dumps, rows)).encode(),
            json.dumps(ticks).encode()]  # fmt: skip


def bag_seeds(form: str) -> Callable[[], list[bytes]]:
    def seeds() -> list[bytes]:
        from bags import bag_ns, words_of, write_bag

        words = words_of(form)
        found = []
        for compression in (
            ("", "bz2") if form == "bag" else ("", "storage")[: 1 + (form == "mcap")]
        ):
            messages = []
            for n in range(3):
                messages.append(("/odom", bag_ns(n), words.odometry(n, 0.1 * n)))
                messages.append(("/scan", bag_ns(n + 0.1), words.scan(n + 0.1, [1.0, 2.0, 3.0])))
            with TemporaryDirectory() as folder:
                found.append(write_bag(Path(folder), form, messages, compression).read_bytes())
        return found

    return seeds


def grid_seeds() -> list[bytes]:
    import possmap

    with TemporaryDirectory() as folder:
        log, grid = Path(folder) / "a.json", Path(folder) / "a.possmap"
        log.write_bytes(log_seeds()[0])
        possmap.fuse([log], grid)
        return [grid.read_bytes()]


def zipped(seeds: Callable[[], list[bytes]]) -> Callable[[], list[bytes]]:
    return lambda: [gzip.compress(seed, mtime=0) for seed in seeds()]
