"""The first messages of a topic, which tell what the others will be like."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from possmap.errors import RecordingError, shown
from possmap.lab.recordings.rosbag.bag import Bag, Decoder, Topic
from possmap.lab.recordings.rosbag.fields import short

STUBBORN = 100
"""So many messages in a row that cannot be read, and none can."""

_LOOKED_AT = 10  # messages, to see whether anybody stamps them


def first_messages(bag: Bag, topic: Topic, decode: Decoder) -> Iterator[Any]:
    """Yield the first messages that can be read, at least one.

    Raises
    ------
    RecordingError
        If there is none.
    """
    found = failed = 0
    error: Exception | None = None
    for _, _, data in bag.messages(topic.ids):
        try:
            message = decode(data)
        except Exception as fault:  # of rosbags alone: damaged bytes can lead it anywhere
            error = fault
            failed += 1
        else:
            found += 1
            yield message
        if found == _LOOKED_AT or failed == STUBBORN:
            break
    if not found:
        raise RecordingError(
            str(bag.path),
            f"topic {shown(topic.name)}: no message can be read, "
            f"expected {short(topic.type)}" + (f" ({failed} tried)" if failed else ""),
        ) from error
