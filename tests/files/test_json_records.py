"""The quick ways to decode records give, and refuse, what the careful one does."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from possmap.logs.fields import Fault, RepeatedKey
from possmap.logs.json_text import SHORT, JsonSyntaxError, JsonText

keys = st.sampled_from(["x", "y", "seq", "kind", 'a"b', "a:b"])
leaves = (
    st.none()
    | st.booleans()
    | st.integers(-9, 9)
    | st.floats(-9, 9)
    | st.text('":\\a{}', max_size=4)
)
values = st.recursive(leaves, lambda of: st.lists(of, max_size=3) | st.dictionaries(keys, of))


@st.composite
def texts(draw: st.DrawFn) -> str:
    """Draw an object whose keys may come twice, perhaps cut or followed by more."""
    pairs = draw(st.lists(st.tuples(keys, values), max_size=5))
    members = (f"{json.dumps(key)}:{json.dumps(value)}" for key, value in pairs)
    text = "{" + ",".join(members) + "}" + draw(st.sampled_from(["", "  ", " ,", "]"]))
    return text[: draw(st.integers(1, len(text)))] if draw(st.booleans()) else text


def outcome(text: str, quick: bool) -> object:
    """Return what comes of decoding: the value, a key given twice, where the cursor stands."""
    cursor = JsonText(text)
    try:
        value = cursor.record() if quick else cursor.value()
    except (JsonSyntaxError, Fault) as error:
        return type(error), str(error), getattr(error, "position", None)
    twice = value.key if isinstance(value, RepeatedKey) else None
    return value, twice, cursor.position


@given(texts())
def test_a_record_is_decoded_as_any_value_is(text: str) -> None:
    assert outcome(text, quick=True) == outcome(text, quick=False)


@pytest.mark.parametrize("text", ['{"x": 1, "x": 2}', '{"x": 1, "y": "a:b", "x": 2}'])
def test_a_key_given_twice_is_told(text: str) -> None:
    assert isinstance(JsonText(text).record(), RepeatedKey)


@given(st.lists(texts(), max_size=3), st.sampled_from(["", " ", "]", ", 1]", "\n]  "]))
def test_a_list_decoded_at_once_is_one_whose_items_say_the_same(items: list[str], end: str) -> None:
    text = "[" + ", ".join(items) + end
    cursor = JsonText(text)
    at_once = cursor.plain_objects()
    if at_once is None:
        assert cursor.position == 0
        return
    slowly = JsonText(text)
    assert at_once == [slowly.value() for _ in slowly.items()]
    assert cursor.position == slowly.position
    assert not any(isinstance(one, RepeatedKey) for one in at_once)


def test_lists_are_decoded_at_once_if_plain_and_short() -> None:
    assert JsonText('[{"x": 1}, {"x": 2, "y": []}] ,').plain_objects() == [
        {"x": 1},
        {"x": 2, "y": []},
    ]
    assert JsonText("[]").plain_objects() == []
    for text in (
        '[{"x": 1, "x": 2}]',
        '[{"x": {"y": 1}}]',
        '[{"x": ":"}]',
        "[1]",
        "[[]]",
        "{}",
        '[{"x": 1}',
    ):
        assert JsonText(text).plain_objects() is None
    assert JsonText('[{"x": 1}' + " " * SHORT + "]").plain_objects() is None
