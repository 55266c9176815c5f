"""What every test stands on: figures that were worked out by hand are those of the paper's rules.

``default_profile`` asks for what a user gets who names no profile.
"""

from __future__ import annotations

import pytest

from possmap.settings import request as requested


@pytest.fixture(autouse=True)
def paper_rules(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have new grids follow the profile ``paper`` where a test names none."""
    if "default_profile" not in request.keywords:
        monkeypatch.setattr(requested, "DEFAULT_PROFILE", "paper")
