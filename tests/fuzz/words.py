"""What mutations put in: numbers, texts and words that readers may stumble over."""

from __future__ import annotations

NUMBERS = (
    b"0", b"-0.0", b"-1", b"1e400", b"-1e400", b"1e308", b"-1e308", b"5e-324", b"1e6", b"1000001",
    b"NaN", b"nan", b"-Infinity", b"inf", b"9007199254740991", b"9223372036854775808", b"1_0",
    b"18446744073709551616", b"9" * 400, b"9" * 4400, b"0x10", b"1.", b".5", b"+1",
)  # fmt: skip
TEXTS = (
    b"", b"\x00", b"\x1b[2J", b"\xff", b"\xed\xa0\x80", b"\xf0\x9f\xa4\x96", b"\xe2\x80\xae",
    b"../../etc/passwd", b"'; DROP TABLE record; --", b"a" * 65, b"\xef\xbb\xbf", b"\r\n", b"\n",
)  # fmt: skip
JSON = (
    b"{", b"}", b"[", b"]", b",", b":", b'"', b"\\ud800", b"\\u0000", b"null", b"true", b"false",
    b'"robot"', b'"excursion"', b'"records"', b'"carried"', b'"model"', b'"possmap_log"', b'"kind"',
    b'"seq"', b'"x_a"', b'"a"', b"[" * 20, b'{"a":' * 20, b'"kind":"meet"', b"[" * 2000,
)  # fmt: skip
CSV = (b",", b'"', b'""', b";", b"\t", b"x_a", b"#", b"true", b"pose", b"wall", b"beam", b"meet")
YAML = (
    b"&a ", b"*a", b"!!python/object/apply:os.system ", b"<<: ", b"? ", b"- ", b": ", b"[", b"]",
    b"{", b"}", b"|\n", b">\n", b"---\n", b"...\n", b"%YAML 9.9\n", b"!!binary ", b"~", b"null",
    b"world", b"walls", b"rooms", b"doors", b"image", b"file", b"map", b"generate", b"robots",
    b"/dev/zero", b"/dev/stdin", b"tables", b"columns", b"beams", b"scan", b"ticks",
)  # fmt: skip
CARMEN = (b"FLASER ", b"RLASER ", b"ROBOTLASER1 ", b"ODOM ", b"PARAM ", b" ", b"SYNC ")
JSON_WORDS = NUMBERS + TEXTS + JSON
CSV_WORDS = NUMBERS + TEXTS + CSV
YAML_WORDS = NUMBERS + TEXTS + YAML
CARMEN_WORDS = NUMBERS + TEXTS + CARMEN
