"""What is no draw of what draws the others: slips, copies, drifts round and round, small turns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from calibrated import PAPER, SPINS, Faults, hold, trials

from possmap.core.model import ErrorModel
from possmap.lab.calibrate.assumptions import variance_ratio
from possmap.lab.calibrate.cutting import TrueTrack, cut
from possmap.lab.calibrate.estimates import for_tracks, is_clear
from possmap.lab.calibrate.model import chord_share, fit_model
from possmap.lab.calibrate.odd import notes, without_slips
from possmap.lab.calibrate.robots import Unusable, calibrate_robot
from possmap.lab.calibrate.trials import Floats, Trial
from possmap.lab.calibrate.trials_file import repeated
from possmap.lab.calibrate.words import findings

pytestmark = pytest.mark.thorough


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.mark.parametrize(
    ("which", "change", "told"),
    [
        (lambda one: not one.distance, {"heading": 30.0}, "heading +"),
        (lambda one: one.distance > 0, {"heading": 70.0}, "heading +7"),
        (lambda one: one.distance > 0, {"across": 2.0, "heading": 0.0}, "end aside +"),
        (lambda one: one.distance > 0, {"along": -1.5, "heading": 0.0}, "distance -"),
    ],
)
def test_one_slip_of_many_trials_does_not_own_the_model(
    which: Callable[[Trial], bool], change: dict[str, float], told: str
) -> None:
    some = trials(Faults(), rng(2), 10, PAPER + SPINS)
    at = next(k for k, one in enumerate(some) if which(one))
    slipped, old = list(some), some[at]
    change = {name: getattr(old, name) + by for name, by in change.items()}
    slipped[at] = replace(old, **change, place="a.csv:9")  # type: ignore[arg-type]
    result = calibrate_robot("r", slipped, rng())
    sound = calibrate_robot("r", some[:at] + some[at + 1 :], rng())
    assert result.parameters == sound.parameters
    (note,) = result.slips
    assert note.startswith("1 of 80 trials far off all others: a.csv:9 (") and told in note
    assert note.endswith("left out (--keep-slips keeps them)")
    kept = calibrate_robot("r", slipped, rng(), keep_slips=True)
    assert len(kept.trials) == 80 and not kept.slips


def test_a_slip_that_hides_behind_a_larger_one_is_found() -> None:
    some = trials(Faults(), rng(3), 20)
    for k, off in ((0, 85.0), (1, 30.0)):
        some[k] = replace(some[k], heading=some[k].heading + off)
    assert without_slips(some)[0] == some[2:]


def test_robots_that_never_slip_lose_hardly_a_trial() -> None:
    lost = sum(80 - len(without_slips(trials(Faults(), rng(seed)))[0]) for seed in range(40))
    assert lost <= 3


def test_trials_that_often_lie_far_off_are_how_the_robot_errs() -> None:
    some = trials(Faults(), rng(4), 20, SPINS)
    some[::8] = [replace(one, heading=one.heading + 60) for one in some[::8]]
    kept, (note,) = without_slips(some)
    assert kept == some and note.endswith("too many for slips, this is how the robot errs; kept")


def test_a_robot_that_differs_from_day_to_day_has_that_in_its_spreads() -> None:
    """A model of six days holds a seventh; one of a single day does not, and says what it is."""
    held, single = [], []
    for seed in range(8):
        draw = rng(seed)
        days = [
            replace(one, day=str(day))
            for day in range(7)
            for one in trials(
                Faults(drift=2 * draw.standard_normal(), scale=1 + 0.03 * draw.standard_normal(),
                       turn_bias=0.0, turn_gain=0.05 * draw.standard_normal()),
                draw, 3, PAPER + SPINS,
            )
        ]  # fmt: skip
        new = days[-24:]
        for some, found in ((days[:-24], held), (days[:24], single)):
            result = calibrate_robot("r", some, rng())
            own = hold(new, ErrorModel(**result.parameters), "heading")
            found.append(np.nanmean(own.inside(0, 1)))
    assert np.mean(held) >= 0.9 > 0.75 > np.mean(single)
    assert any("all of one day" in note for note in notes(result))


def noisy(exact: bool, seed: int = 5, noise: float = 0.03, count: int = 400) -> list[Trial]:
    """Return runs of a track whose truth is noisy: each takes back what the last one gave."""
    draw = rng(seed)
    back = noise * np.diff(draw.standard_normal(count + 1))
    return [
        Trial(
            "r", f"t:{k // 8}", 2.0, 0.0, float(back[k] + 0.01 * draw.standard_normal()),
            float(0.05 * draw.standard_normal()), float(draw.standard_normal()), track="t",
            exact=exact,
        )
        for k in range(count)
    ]  # fmt: skip


def test_only_a_truth_that_may_be_noisy_is_taken_back_and_never_below_the_limit() -> None:
    plain = fit_model(noisy(exact=False))
    kept, ratios = for_tracks(plain, noisy(exact=True))
    assert kept.parameters == plain.parameters and not ratios
    narrowed, _ = for_tracks(plain, noisy(exact=False))
    result = calibrate_robot("r", noisy(exact=False), rng())
    low = result.estimates["along"].low
    assert low <= narrowed.parameters["along"] < plain.parameters["along"]
    assert narrowed.parameters["across"] == plain.parameters["across"]


def test_the_coverage_that_is_told_is_that_of_the_model_that_is_written() -> None:
    some = noisy(exact=False)
    result = calibrate_robot("r", some, rng())
    assert result.validation is not None
    told, full = result.heading, result.validation.full
    own = hold(some, ErrorModel(**result.parameters), "heading").score
    assert told.size < full.size and told.coverage < full.coverage
    assert told.size == pytest.approx(own.size, rel=0.02)
    assert told.coverage == pytest.approx(own.coverage, abs=0.02)


def test_independent_errors_are_hardly_ever_corrected() -> None:
    draw, corrected = rng(6), 0
    for _ in range(500):
        found = variance_ratio(draw.standard_normal(250), ["one"] * 250)
        assert found is not None
        corrected += found.widening != 1.0
    assert corrected <= 4, "one time in a thousand"
    assert variance_ratio(draw.standard_normal(190), ["one"] * 190) is None, "fewer than 20 blocks"


def turned(*turns: float, exact: bool = True) -> TrueTrack:
    """Return a track that runs 1 m, turns so often on the spot, and runs 1 m."""
    rows = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
    for turn in turns:
        rows.append((1.0, 0.0, rows[-1][2] + turn))
    rows.append((2.0, 0.0, rows[-1][2]))
    poses: Floats = np.array(rows)
    return TrueTrack("r", "r-1", poses, poses, np.zeros(len(rows) - 1, dtype=np.bool_), exact)


def test_small_turns_among_others_are_no_trials() -> None:
    def turns(track: TrueTrack) -> list[float]:
        return [one.turn for one in cut(track) if one.manoeuvre == "turn"]

    assert turns(turned(-10)) == [-10]
    assert turns(turned(-8, -1)) == []
    assert turns(turned(1, -10, 7)) == []
    assert turns(turned(45, 45)) == [90]
    assert turns(turned(-8, -1, exact=False)) == [-9]


def test_a_drift_that_goes_round_and_round_cannot_be_told() -> None:
    assert chord_share(1000.0, np.array([3.0])) > 0.6
    draw, some = rng(9), []
    for k, distance in enumerate((1.0, 3.0) * 10):
        along, across, heading = draw.standard_normal(3).tolist()
        some.append(
            Trial("r", str(k), distance, 0.0, along / 100, across / 100, 80 * distance + heading)
        )
    with pytest.raises(Unusable, match="more than half a circle in its run of 3 m"):
        calibrate_robot("r", some, rng())


def test_drift_that_nobody_can_know_is_not_said_to_be_nothing() -> None:
    some = trials(Faults(), rng(10), 20, ((3.0, 45.0),))
    result = calibrate_robot("r", some, rng())
    assert "drift_spread" not in result.parameters and "drift_spread" not in result.estimates
    assert any("drift and drift_spread are left out" in note for note in notes(result))


def test_copies_are_found_and_a_coarse_ruler_is_none() -> None:
    some = trials(Faults(), rng(11))
    assert repeated(some) == []
    assert len(repeated(some + some[:4])) == 4
    assert len(repeated(some + some)) == len(some)
    coarse = [
        replace(one, along=round(one.along, 2), across=round(one.across, 1), heading=float("nan"))
        for one in some
    ]
    assert repeated(coarse) == []
    for step in (1, 2):
        told = [
            replace(one, heading=float(step * round(other.heading / step)))
            for one, other in zip(coarse, some, strict=True)
        ]
        assert repeated(told) == []
    spins = [
        replace(one, heading=round(one.heading)) for one in trials(Faults(), rng(12), 30, SPINS)
    ]
    assert repeated(spins) == []


def test_the_words_and_the_terms_share_one_level() -> None:
    """What the paper lacks is what is kept as clearly there: Bonferroni over the known parts."""
    clear = 0
    for seed in range(6):
        result = calibrate_robot("r", trials(Faults(turn_gain=0.0, drift=0.0), rng(seed)), rng())
        words = list(findings(result))
        kept = any(w.startswith("turn_gain") and "is clearly there" in w for w in words)
        assert not kept or ("it lacks" in words[0] and "turn_gain" in words[0])
        clear += is_clear(result.fit, "drift") + is_clear(result.fit, "turn_gain")
    assert clear <= 1
