"""Hostile files, made by code: each case says what it is, who reads it, and what is said of it."""

from __future__ import annotations

from fuzz.hostile_files import FILES
from fuzz.hostile_logs import LOGS
from fuzz.hostile_work import WORK
from fuzz.making import Case

CASES: tuple[Case, ...] = (*LOGS, *WORK, *FILES)
"""All of them: the worst that was thought of, and all that fuzzing found."""
