"""The estimator ``heading`` (METHOD §1): errors with their causes, so that some can cancel out.

It keeps the covariance P of five errors: x and y [m], the heading h [rad], the over-turn o per 45°
[rad] and the drift b, for bend [rad/m]. The last two are one unknown each per excursion: their
variances never change, and they stay independent of each other.

METHOD divides every half-width by ``factor`` and multiplies the result by it. Nothing in between
depends on it, so P is kept times its square: its entries are squared half-widths, and no factor
can make one overflow or vanish.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from possmap.core.correction import CorrectedStretch
from possmap.core.model import ErrorModel
from possmap.core.propagation import RIGHT_ANGLE, ErrorRectangle
from possmap.core.records import Pose
from possmap.core.track import Stretch, wrap_degrees

SAME_RUN_DEG = 1.0
"""A piece whose direction differs by more from that of a run's first piece begins a run."""


class Covariance(NamedTuple):
    """The entries of P that change, times ``factor`` squared: ``xh`` is that of x and heading.

    Spelt out, since matrices of NumPy take more than twice as long, and leave the order of their
    sums, on which the last bit depends, to a library. The covariance of x and y is left out: no
    half-width ever depends on it.
    """

    xx: float = 0.0
    yy: float = 0.0
    xh: float = 0.0
    yh: float = 0.0
    hh: float = 0.0
    xo: float = 0.0
    yo: float = 0.0
    ho: float = 0.0
    xb: float = 0.0
    yb: float = 0.0
    hb: float = 0.0


class Run(NamedTuple):
    """The run so far, logged in one piece or in several.

    direction_deg : of its first piece, as logged.
    followed : whether it follows walls.
    length : corrected, METHOD's L [m].
    """

    direction_deg: float
    followed: bool
    length: float = 0.0

    def continues(self, direction_deg: float, followed: bool) -> bool:
        """Tell whether a piece belongs to this run. A turn alone does not end one."""
        aside = abs(wrap_degrees(direction_deg - self.direction_deg))
        return followed == self.followed and aside <= SAME_RUN_DEG

    def stretched(self, piece: CorrectedStretch, model: ErrorModel) -> tuple[float, float]:
        """Return what the next piece adds to xx and yy: the error along the run.

        It is one share of the whole run's length, so v = along²·((L+d)² - L²); here without the
        difference of large squares.
        """
        cos, sin = piece.along
        v = model.along**2 * piece.length * (2 * self.length + piece.length)
        return v * cos * cos, v * sin * sin

    def longer(self, piece: CorrectedStretch) -> Run:
        """Return the run with its next piece."""
        return Run(self.direction_deg, self.followed, self.length + piece.length)


class HeadingError(NamedTuple):
    """What may be wrong with a pose: the covariance of the errors, and the run that led there.

    rectangle : around the corrected place, read off the covariance. It may shrink: on the way back
        a heading error undoes itself.
    run : None before the first.
    """

    covariance: Covariance
    rectangle: ErrorRectangle
    run: Run | None = None

    @classmethod
    def at_start(cls, pose: Pose) -> HeadingError:
        """Return the first pose's own error, zero unless the log says otherwise."""
        heading = math.radians(pose.error_heading_deg)
        p = Covariance(xx=pose.error_x**2, yy=pose.error_y**2, hh=heading**2)
        return cls(p, _rectangle(p))

    @property
    def heading_half(self) -> float:
        """Half-width H of the heading [rad], at most a right angle."""
        return min(RIGHT_ANGLE, math.sqrt(max(0.0, self.covariance.hh)))

    def after_run(self, run: CorrectedStretch, model: ErrorModel) -> HeadingError:
        """Carry it along a run in free space, or past walls that were only seen."""
        led = self._joined(run.logged, followed=False)
        # What makes a straight run miss to the side is a heading that is off from its start.
        kick = 0.0 if led is self.run else model.across**2
        moved = _moved(self.covariance, kick, led, run, model)
        return HeadingError(moved, _rectangle(moved), led.longer(run))

    def after_following(self, run: CorrectedStretch, model: ErrorModel) -> HeadingError:
        """Carry it along a followed wall: the heading is the wall's, nothing moves sideways."""
        led = self._joined(run.logged, followed=True)
        xx, yy = led.stretched(run, model)
        p, aligned = self.covariance, math.radians(model.alignment_spread) ** 2
        lined_up = Covariance(
            xx=p.xx + xx, yy=p.yy + yy, hh=aligned, xo=p.xo, yo=p.yo, xb=p.xb, yb=p.yb
        )  # xh, yh, ho and hb: what the heading was forgets its causes
        return HeadingError(lined_up, _rectangle(lined_up), led.longer(run))

    def after_turn(self, turn_deg: float, model: ErrorModel) -> HeadingError:
        """Carry it through a turn: the heading gains the over-turn, and what is new in each turn.

        F is the identity but for F[heading, over-turn] = |t|/45.
        """
        xx, yy, xh, yh, hh, xo, yo, ho, xb, yb, hb = self.covariance
        t, oo = abs(turn_deg) / 45, math.radians(model.turn_spread) ** 2
        new_ho = ho + t * oo
        hh = hh + t * (ho + new_ho) + t * math.radians(model.turn_noise) ** 2
        turned = Covariance(xx, yy, xh + t * xo, yh + t * yo, hh, xo, yo, new_ho, xb, yb, hb)
        return HeadingError(turned, self.rectangle, self.run)  # it turned on the spot

    def _joined(self, piece: Stretch, followed: bool) -> Run:
        """Return the run that a piece continues, or the one that it begins, of length 0 yet."""
        start, end = piece.start, piece.end
        direction_deg = math.degrees(math.atan2(end.y - start.y, end.x - start.x))
        if self.run and self.run.continues(direction_deg, followed):
            return self.run
        return Run(direction_deg, followed)


def _rectangle(p: Covariance) -> ErrorRectangle:
    """Return the half-widths; rounding may leave a variance of nothing a hair below 0."""
    return ErrorRectangle(math.sqrt(max(0.0, p.xx)), math.sqrt(max(0.0, p.yy)))


def _moved(
    p: Covariance, kick: float, led: Run, run: CorrectedStretch, model: ErrorModel
) -> Covariance:
    """Return F·P·Fᵀ and the error along: what a heading and a drift that are off do to a run.

    F is the identity but for F[x, h] = -d·sin θ, F[y, h] = d·cos θ, F[x, b] = -½d²·sin θ,
    F[y, b] = ½d²·cos θ and F[h, b] = d.

    kick : what the heading's variance gains before.
    """
    xx, yy, xh, yh, hh, xo, yo, ho, xb, yb, hb = p
    d, bb, hh = run.length, math.radians(model.drift_spread) ** 2, hh + kick
    reach = math.copysign(d, run.stretch)  # a drift of more than a full circle ends behind
    cos, sin = run.along
    fxh, fyh = -reach * sin, reach * cos
    fxb, fyb = d / 2 * fxh, d / 2 * fyh
    # The new x and y with the old h and b.
    new_xh, new_yh = xh + fxh * hh + fxb * hb, yh + fyh * hh + fyb * hb
    new_xb, new_yb = xb + fxh * hb + fxb * bb, yb + fyh * hb + fyb * bb
    new_hb = hb + d * bb
    along_x, along_y = led.stretched(run, model)
    return Covariance(
        # Each: the new one with the old, then with what the old one gains.
        xx=(xx + fxh * xh + fxb * xb) + fxh * new_xh + fxb * new_xb + along_x,
        yy=(yy + fyh * yh + fyb * yb) + fyh * new_yh + fyb * new_yb + along_y,
        xh=new_xh + d * new_xb,
        yh=new_yh + d * new_yb,
        hh=hh + d * (hb + new_hb),
        xo=xo + fxh * ho,
        yo=yo + fyh * ho,
        ho=ho,
        xb=new_xb,
        yb=new_yb,
        hb=new_hb,
    )
