"""What every test stands on: figures that were worked out by hand are those of the paper's rules.

``default_profile`` asks for what a user gets who names no profile. Processes that a test starts
have the default profile, too: where both are compared, the profile is named.
"""

from __future__ import annotations

import pytest

from possmap.settings import request as requested

OF_USERS = requested.DEFAULT_PROFILE
requested.DEFAULT_PROFILE = "paper"  # for fixtures of whole modules, too


@pytest.fixture(autouse=True)
def users_rules(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have new grids follow the default profile where a test asks for that."""
    if "default_profile" in request.keywords:
        monkeypatch.setattr(requested, "DEFAULT_PROFILE", OF_USERS)
