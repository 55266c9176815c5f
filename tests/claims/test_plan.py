"""What an excursion says in some tiles is what it says, and lies in them (METHOD §3)."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from possmap.core.evidence import Layer
from possmap.core.lattice import TileKey
from possmap.core.plan import ExcursionPlan
from possmap.core.pyramid import COLUMNS

FAR = 2**42
numbers = st.integers(-2, 2) | st.sampled_from([-FAR, FAR, FAR + 1, 2**32])
keys = st.builds(TileKey, numbers, numbers)


def plan_of(pieces: list[tuple[TileKey, Layer]]) -> ExcursionPlan:
    rows = [(key.row, key.column, layer, 0, 0, 0, 0, 0, -1) for key, layer in pieces]
    return ExcursionPlan(
        np.zeros((1, len(COLUMNS))), np.array(rows, dtype=np.int64).reshape(-1, 9), np.zeros(1), ()
    )


@given(
    pieces=st.lists(st.tuples(keys, st.sampled_from(Layer)), max_size=12),
    wanted=st.lists(keys, max_size=6),
    layer=st.none() | st.sampled_from(Layer),
)
def test_the_pieces_among_some_tiles_are_those_that_lie_in_them(
    pieces: list[tuple[TileKey, Layer]], wanted: list[TileKey], layer: Layer | None
) -> None:
    found = plan_of(pieces).among(wanted, layer).pieces
    expected = [one for one in pieces if one[0] in wanted and layer in (None, one[1])]
    assert found.tolist() == plan_of(expected).pieces.tolist()
