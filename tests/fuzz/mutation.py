"""Mutations that know a little of text: tokens, lines and numbers, not only bits."""

from __future__ import annotations

import gzip
import random
import re
import zlib
from collections.abc import Sequence

MOST_STEPS = 4
_TOKEN = re.compile(rb"[A-Za-z_]+|-?[0-9.]+(?:[eE][+-]?[0-9]+)?|\s+|.", re.DOTALL)


def mutated(data: bytes, rng: random.Random, words: Sequence[bytes]) -> bytes:
    """Return data changed in one to four places; what is compressed is changed inside, mostly."""
    if data[:2] == b"\x1f\x8b" and rng.random() < 0.7:
        try:
            inside = zlib.decompressobj(31).decompress(data, 1 << 20)
        except zlib.error:
            inside = b""
        return gzip.compress(mutated(inside, rng, words), 1, mtime=0)
    for _ in range(rng.randint(1, MOST_STEPS)):
        data = _step(data, rng, words)
    return data


def _step(data: bytes, rng: random.Random, words: Sequence[bytes]) -> bytes:
    if not data:
        return rng.choice(words) if words else b"\0"
    kind = rng.randrange(8 if words else 5)
    at = rng.randrange(len(data))
    end = min(len(data), at + rng.choice((1, 2, 4, 8, 64)))
    if kind == 0:
        return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]
    if kind == 1:
        return data[:at] + data[end:]
    if kind == 2:
        return data[:end] + data[at:end] * rng.choice((1, 1, 8)) + data[end:]
    if kind == 3:
        return data[:at] + rng.randbytes(end - at) + data[end:]
    if kind == 4:
        size = min(rng.choice((1, 2, 4, 8)), len(data) - at)
        value = rng.choice((0, 1, 0x7F, 0x80, 0xFF, 0xFFFFFFFF, 1 << 31, (1 << 64) - 1))
        order = rng.choice(("little", "big"))
        number = (value & (1 << 8 * size) - 1).to_bytes(size, order)  # type: ignore[arg-type]
        return data[:at] + number + data[at + size :]
    if kind == 5:
        return data[:at] + rng.choice(words) + data[at:]
    tokens = _TOKEN.findall(data)
    index = rng.randrange(len(tokens))
    if kind == 6:
        tokens[index] = rng.choice(words)
    else:
        other = rng.randrange(len(tokens))
        tokens[index], tokens[other] = tokens[other], tokens[index]
    return b"".join(tokens)
