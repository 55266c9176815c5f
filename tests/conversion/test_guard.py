"""Jumps of the pose, told by the velocity."""

from __future__ import annotations

import numpy as np
import pytest

from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.guard import REPLACED, JumpGuard

T = np.arange(100) / 10
STEADY = np.column_stack([0.5 * T, np.zeros(100)])
VELOCITY = np.tile([0.5, 0.0], (100, 1))


def test_jumps_are_replaced_and_counted_and_what_is_sound_stays() -> None:
    jumping = STEADY.copy()
    jumping[40:] += [0.3, -0.2]
    jumping[70:] -= [0.0, 0.4]
    tally = Tally()
    mended = JumpGuard(0.05, tally).mended(T, jumping, VELOCITY)
    assert mended == pytest.approx(STEADY, abs=1e-9)
    assert tally.of(REPLACED) == 2
    assert JumpGuard(0.05, Tally()).mended(T, STEADY, VELOCITY) == pytest.approx(STEADY)


def test_pieces_are_mended_as_the_whole_also_where_the_jump_lies_between_them() -> None:
    jumping = STEADY.copy()
    jumping[50:] += 1.0
    guard = JumpGuard(0.05, Tally())
    parts = [slice(0, 50), slice(50, 51), slice(51, 100)]
    mended = np.concatenate([guard.mended(T[p], jumping[p], VELOCITY[p]) for p in parts])
    assert mended == pytest.approx(STEADY, abs=1e-9)


def test_a_step_over_a_gap_is_believed_for_nobody_heard_the_robot_meanwhile() -> None:
    late = T.copy()
    late[50:] += 10.0
    moved = STEADY.copy()
    moved[50:] += [2.0, 1.0]
    tally = Tally()
    assert (JumpGuard(0.05, tally).mended(late, moved, VELOCITY) == moved).all()
    assert tally.of(REPLACED) == 0


def test_an_unknown_velocity_belies_nothing_and_0_turns_the_guard_off() -> None:
    jumping = STEADY.copy()
    jumping[50:] += 1.0
    unknown = np.full((100, 2), np.nan)
    assert (JumpGuard(0.05, Tally()).mended(T, jumping, unknown) == jumping).all()
    assert (JumpGuard(0.0, Tally()).mended(T, jumping, VELOCITY) == jumping).all()
