"""Hostile settings, missions, images, recordings, bags."""

from __future__ import annotations

import gzip

from fuzz.making import MIB, Case, database, folder_bag, mcap, png, text

ENDLESS = (
    "CREATE VIEW schema AS WITH RECURSIVE n(schema_version) AS "
    "(SELECT 1 UNION ALL SELECT schema_version + 1 FROM n) SELECT count(*) AS schema_version FROM n"
)
MESSAGES = (
    "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data {})"
)
TOPICS = (
    "CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, "
    "offered_qos_profiles TEXT)"
)
LAUGHS = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 30)
)
ROOM = "{at: [0, 0, 9, 9]}"
IDL = "module m { module msg { const int32 A = %s; struct X { int32 a; }; }; };"

FILES: tuple[Case, ...] = (
    Case(
        "a billion laughs, settings",
        "settings",
        "a.yaml",
        text(LAUGHS),
        "6: found more than 300000 values, with all aliases",
    ),
    Case(
        "a billion laughs, mission",
        "mission",
        "a.yaml",
        text(LAUGHS),
        "6: found more than 300000 values, with all aliases",
    ),
    Case(
        "an alias of itself",
        "mapping",
        "a.yaml",
        text("a: &a [*a]"),
        "1: an alias inside of what it names",
    ),
    Case(
        "YAML nested 100,000 deep",
        "settings",
        "a.yaml",
        text("[" * 100_000),
        "1: nested too deep, expected name: value",
    ),
    Case(
        "1 MiB of YAML in single letters",
        "settings",
        "a.yaml",
        text("[" + "a," * 520_000 + "]"),
        "1: found more than 300000 values, with all aliases",
    ),
    Case(
        "YAML that names a Python object",
        "settings",
        "a.yaml",
        text("turn_spread: !!python/object/apply:os.abort []"),
        "1: turn_spread, found a list, expected one value",
    ),
    Case(
        "rooms by alias, 100,000 times",
        "mission",
        "a.yaml",
        text(f"world: {{rooms: [&r {ROOM}", ", *r" * 100_000, "], home: [5, 5]}"),
        "1: found more than 300000 values, with all aliases",
    ),
    Case(
        "a world that is a device",
        "mission",
        "a.yaml",
        text("world: {file: /dev/stdin}"),
        "/dev/stdin: is no regular file, expected a world",
    ),
    Case(
        "a map whose image is a device",
        "ros map",
        "a.yaml",
        text(
            "{image: /dev/zero, resolution: 1, origin: [0, 0, 0], negate: 0, "
            "occupied_thresh: 0.6, free_thresh: 0.1}"
        ),
        "/dev/zero: is no regular file, expected an image",
    ),
    Case(
        "1,000 tables in a mapping",
        "mapping",
        "a.yaml",
        text("format: csv\ntables: [&t {file: a}", ", *t" * 1000, "]"),
        "2: tables, found 1001, expected at most 100",
    ),
    Case(
        "an image of 10^10 pixels",
        "image",
        "a.png",
        lambda: png(100_000, 100_000, 1, ()),
        "too many pixels, expected at most 25 million",
    ),
    Case(
        "an image of 25 million dots",
        "image",
        "a.png",
        lambda: png(5000, 5000, 1, (bytes(625) if n % 2 else b"\xaa" * 625 for n in range(5000))),
        "found 25000000 walls in the image, expected at most 1000000",
    ),
    Case(
        "a truth of 3 million empty lists",
        "truth",
        "a.json",
        text('{"possmap_truth": 1, "walls": [', "[]," * 3_000_000, "[]]}"),
        "found 3000003 objects and lists, expected at most 2000000 (setting limit_file_objects)",
    ),
    Case(
        "a truth cut short",
        "truth",
        "a.json.gz",
        lambda: gzip.compress(b'{"possmap_truth": 1, "walls": []}')[:-4],
        "the file is cut short",
    ),
    Case(
        "trials cut short",
        "trials",
        "a.csv.gz",
        lambda: gzip.compress(b"robot,distance,turn,along,across\na,1,0,0,0\n")[:-4],
        "the file is cut short",
    ),
    Case(
        "trials with NaN",
        "trials",
        "a.csv",
        text("robot,distance,turn,along,across\na,nan,0,0,0\n"),
        '2: distance, found "nan", expected a number within ±1e6',
    ),
    Case(
        "a laser whose beams lie beyond doubles",
        "carmen",
        "a.log",
        lambda: (
            b"ROBOTLASER1 0 1e308 3.1 1e308 80 0.01 0 2 1.0 2.0 0 0 0 0 0 0 0 0 0 0 0 0 0 host 0\n"
            * 3
        ),
        "expected a CARMEN log",
    ),
    Case(
        "JSON Lines that begin a list each",
        "table json",
        "a.json",
        lambda: b'{"t":0,"x":0,"y":0,"yaw":0,"vx":0,"vy":0,"front":1,"left":1}\n' + b"[1,\n" * MIB,
        "expected at most half (t is missing)",
    ),
    Case(
        "JSON that comes byte by byte",
        "table json",
        "a.json",
        lambda: b"".join(gzip.compress(b, 1, mtime=0) for b in (b"[", b'"', *[b"a"] * 200_000)),
        "not JSON: the file ends too early",
    ),
    Case(
        "escape codes for a column",
        "table csv",
        "a.csv",
        text("t,x,y,ya\x1bw,vx,vy,front,left\n"),
        'did you mean "ya\\u001bw"?',
    ),
    Case(
        "a bag that is an endless view",
        "db3",
        "a.db3",
        database(TOPICS, MESSAGES.format("BLOB"), ENDLESS),
        "found a view or a virtual table, expected tables of messages",
        writes=True,
    ),
    Case(
        "a bag with a column of a billion bytes",
        "db3",
        "a.db3",
        database(TOPICS, MESSAGES.format("BLOB AS (zeroblob(1000000000))")),
        "found a computed column, expected tables of messages",
        writes=True,
    ),
    Case(
        "an IDL of nested parentheses",
        "mcap",
        "a.mcap",
        mcap(IDL % "((((((1))))))", "ros2idl"),
        "cannot be understood: found ( in an expression, expected plain values",
        writes=True,
    ),
    Case(
        "an IDL that shifts by a billion",
        "mcap",
        "a.mcap",
        mcap(IDL % "1 << 1000000000", "ros2idl"),
        "cannot be understood: found << in an expression, expected plain values",
        writes=True,
    ),
    Case(
        "a type of a billion strings",
        "mcap",
        "a.mcap",
        mcap("string[1000000000] a\n", "ros2msg"),
        "cannot be understood: found a type of more than 100000 values",
        writes=True,
    ),
    Case(
        "types that double 40 times",
        "mcap",
        "a.mcap",
        mcap(
            "T0 a\n"
            + "".join(
                f"{'=' * 80}\nMSG: nav_msgs/T{n}\nT{n + 1} a\nT{n + 1} b\n" for n in range(40)
            )
            + f"{'=' * 80}\nMSG: nav_msgs/T40\nbool a\n",
            "ros2msg",
        ),
        "cannot be understood: found a type of more than 100000 values",
        writes=True,
    ),
    Case(
        "a list of messages that hold nothing",
        "mcap",
        "a.mcap",
        mcap(f"E[] a\n{'=' * 80}\nMSG: nav_msgs/E\n", "ros2msg"),
        "cannot be understood: found a list of messages that hold nothing",
        writes=True,
    ),
    Case(
        "a type that holds itself",
        "mcap",
        "a.mcap",
        mcap("Odometry a\n", "ros2msg"),
        "cannot be understood: found a type that holds itself",
        writes=True,
    ),
    Case(
        "a bag whose metadata laugh",
        "bag",
        "a",
        folder_bag(LAUGHS),
        "found an alias in metadata.yaml, expected plain values",
        writes=True,
    ),
    Case(
        "a bag whose metadata are endless",
        "bag",
        "a",
        folder_bag("# " * MIB),
        "found a metadata.yaml larger than 1 MiB",
        writes=True,
    ),
)
