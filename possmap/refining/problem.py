"""The residuals of METHOD §8, each divided by its standard deviation, as rows to be solved.

Of node k the unknowns are x, y (of the building's frame) and h, the heading error of the run from
k to k + 1 beyond what the filter corrected: in this order each excursion's matrix is banded. The
border is o and b of each excursion, and the coordinates of walls.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from possmap.core.walls import LEAST_SPREAD_DEG
from possmap.refining.bordered import OWN, Bordered, Solution
from possmap.refining.runs import CutExcursion, Floats, Ints, Sighting

LEAST_PLACE_M, LEAST_ACROSS_M, LEAST_UNKNOWN = 2e-3, 5e-4, 1e-6
"""Nothing is known better: a place, what a run misses beside its heading [m]; o and b [rad]."""


class TrackProblem:
    """All excursions of a ledger, in canonical order, ready to be solved for any association.

    Attributes
    ----------
    first_node, first_run
        Of each excursion, and one more.
    node
        At which each run begins.
    owner
        CutExcursion of each run.
    seen_sd, noise_sd
        Standard deviations of walls' directions [rad] and of sightings [m].
    sighting_owner, kind, normal, low, high
        Of each sighting: its excursion; 2·normal + (side > 0); and as in ``Sighting``.
    """

    def __init__(self, excursions: Sequence[CutExcursion]) -> None:
        runs = [len(one.chord) for one in excursions]
        self.first_node = np.append(0, np.cumsum([count + 1 for count in runs]))
        self.first_run = np.append(0, np.cumsum(runs))
        self.owner = np.repeat(np.arange(len(runs)), runs)
        self.node = np.arange(self.first_run[-1]) + self.owner
        factor = np.array([one.model.factor for one in excursions])
        self.factor, per_run = factor, factor[self.owner]
        self.start = np.stack([one.start for one in excursions])
        start_half = np.stack([one.start_half for one in excursions])
        self._start_sd = np.maximum(start_half, LEAST_PLACE_M) / factor[:, None]
        spreads = [(one.model.turn_spread, one.model.drift_spread) for one in excursions]
        self._own_sd = np.maximum(np.deg2rad(spreads), LEAST_UNKNOWN) / factor[:, None]
        self._chord = _of_runs(excursions, "chord")
        self._length = np.hypot(*self._chord.T)
        self._along_sd = np.maximum(_of_runs(excursions, "along_half"), LEAST_PLACE_M) / per_run
        self._turned_sd = _of_runs(excursions, "turned_half") / per_run
        self._aligned_sd = _of_runs(excursions, "aligned_half") / per_run
        self._straight_sd = math.radians(LEAST_SPREAD_DEG) / per_run
        self._step, self._parts, self._drifted = (
            _of_runs(excursions, name) for name in ("heading_step", "parts", "distance")
        )
        seen_owner = np.repeat(np.arange(len(runs)), [len(one.seen) for one in excursions])
        seen = _of_runs(excursions, "seen")
        self.seen_run = seen[:, 0].astype(np.int64) + self.first_run[seen_owner]
        self.seen_off, self.seen_sd = seen[:, 1], seen[:, 2] / factor[seen_owner]
        self.sighting_owner = np.repeat(
            np.arange(len(runs)), [len(one.sightings) for one in excursions]
        )
        every = [one for excursion in excursions for one in excursion.sightings]
        columns = np.array(every, dtype=np.float64).reshape(-1, len(Sighting._fields)).T
        told = dict(zip(Sighting._fields, columns, strict=True))
        self._sighting_run = told["run"].astype(np.int64) + self.first_run[self.sighting_owner]
        self.normal = told["normal"].astype(np.int64)
        self.kind = 2 * self.normal + (told["side"] > 0)
        self._a, self._b = told["a"], told["b"]
        self.low, self.high = told["low"], told["high"]
        self.noise_sd = told["half_width"] / factor[self.sighting_owner]
        fixed_owner = np.repeat(np.arange(len(runs)), [len(one.fixed) for one in excursions])
        fixed = _of_runs(excursions, "fixed")
        poses = [one.poses[one.fixed[:, 0].astype(np.int64), :3] for one in excursions]
        run, self._fixed_a, self._fixed_b = np.concatenate(poses).T
        self._fixed_node = self.node[run.astype(np.int64) + self.first_run[fixed_owner]]
        self._fixed = fixed[:, [1, 2, 5]]
        least = [LEAST_PLACE_M, LEAST_PLACE_M, LEAST_UNKNOWN]
        self._fixed_sd = np.maximum(fixed[:, [3, 4, 6]], least) / factor[fixed_owner, None]

    def laid_out(self) -> Floats:
        """Return the nodes as the filter's runs make them, one behind the other [m]."""
        nodes = np.empty((int(self.first_node[-1]), 2))
        for i, (first, last) in enumerate(pairwise(self.first_run.tolist())):
            at = int(self.first_node[i])
            nodes[at] = self.start[i]
            chords = self._chord[first:last]
            nodes[at + 1 : at + 1 + len(chords)] = self.start[i] + np.cumsum(chords, axis=0)
        return nodes

    def middles(self, nodes: Floats) -> Floats:
        """Return the middles of all sightings for given nodes [m]; shape (sightings, 2)."""
        k = self.node[self._sighting_run]
        step = nodes[k + 1] - nodes[k]
        across = np.stack([-step[:, 1], step[:, 0]], axis=1)
        middles: Floats = nodes[k] + self._a[:, None] * step + self._b[:, None] * across
        return middles

    def at_sightings(self, of_nodes: Floats) -> Floats:
        """Return what holds for a coordinate of nodes at the sightings of walls across it.

        of_nodes : shape (nodes, 2 or more); taken linearly along runs.
        """
        k, share = self.node[self._sighting_run], np.clip(self._a, 0.0, 1.0)
        ends = of_nodes[k, self.normal], of_nodes[k + 1, self.normal]
        found: Floats = (1 - share) * ends[0] + share * ends[1]
        return found

    def solve(
        self, wall_of: Ints, heading: Floats, weights: Floats, seen: Floats, with_variances: bool
    ) -> Solution:
        """Solve once, the runs' directions linearised at given headings.

        Parameters
        ----------
        wall_of
            The wall of each sighting, < 0: none.
        heading
            h of each run [rad].
        weights, seen
            How much each sighting, and each direction of a wall, counts: 0 to 1.
        """
        system = Bordered(3 * self.first_node, int(wall_of.max(initial=-1)) + 1)
        self._add_tracks(system, heading)
        direction = self.seen_run
        h = 3 * self.node[direction] + 2
        system.add([h], [np.ones(len(h))], -self.seen_off, seen * self.seen_sd**-2.0)
        used = wall_of >= 0
        node, normal = self.node[self._sighting_run[used]], self.normal[used]
        system.add(
            *_place(node, normal, self._a[used], self._b[used]),
            np.zeros(len(node)),
            weights[used] * self.noise_sd[used] ** -2,
            [OWN * system.blocks + wall_of[used]],
            [-np.ones(len(node))],
        )
        for axis in (0, 1):
            system.add(
                *_place(self._fixed_node, axis, self._fixed_a, self._fixed_b),
                self._fixed[:, axis],
                self._fixed_sd[:, axis] ** -2,
            )
        known = np.ones(len(self._fixed_node))
        system.add(
            [3 * self._fixed_node + 2], [known], self._fixed[:, 2], self._fixed_sd[:, 2] ** -2
        )
        return system.solve(with_variances)

    def _add_tracks(self, system: Bordered, heading: Floats) -> None:
        """Add what each excursion tells of itself: start, runs, turns, and walls followed."""
        first, last = 3 * self.first_node[:-1], 3 * self.first_node[1:] - 1
        every, one_each = np.ones(len(first)), np.ones(len(heading))
        blocks = OWN * np.arange(len(first))
        for axis in (0, 1):
            weight = self._start_sd[:, axis] ** -2
            system.add([first + axis], [every], self.start[:, axis], weight)
            unknown = self._own_sd[:, axis] ** -2
            system.add([], [], 0 * every, unknown, [blocks + axis], [every])
        system.add([last], [every], 0 * every, every)  # no run begins at the last node
        x, length = 3 * self.node, self._length
        # A follower goes where the wall goes, whatever its heading.
        followed = np.isfinite(self._aligned_sd)
        heading, bends = np.where(followed, 0.0, heading), np.where(followed, 0.0, -length)
        cos, sin = np.cos(heading), np.sin(heading)
        aside = np.hypot(LEAST_ACROSS_M, np.where(followed, length * self._straight_sd, 0.0))
        along_x = (cos * self._chord[:, 0] - sin * self._chord[:, 1]) / length
        along_y = (sin * self._chord[:, 0] + cos * self._chord[:, 1]) / length
        system.add(
            [x, x + 1, x + 3, x + 4],
            [-along_x, -along_y, along_x, along_y],
            length,
            self._along_sd**-2.0,
        )
        system.add(
            [x, x + 1, x + 2, x + 3, x + 4],
            [along_y, -along_x, bends, -along_y, along_x],
            bends * heading,
            aside**-2.0,
        )
        begins = np.isin(np.arange(len(x)), self.first_run[:-1])
        system.add(
            [x + 2, np.where(begins, x + 2, x - 1)],
            [one_each, np.where(begins, 0.0, -1.0)],
            -self._step,
            self._turned_sd**-2.0,
            [OWN * self.owner, OWN * self.owner + 1],
            [-self._parts, -self._drifted],
        )
        system.add([x + 2], [one_each], 0 * one_each, self._aligned_sd**-2.0)


def _place(node: Ints, axis: Ints | int, a: Floats, b: Floats) -> tuple[list[Ints], list[Floats]]:
    """Return columns and values of a coordinate at the shares a and b of runs' chords."""
    k, turned = 3 * node, np.where(np.asarray(axis) == 0, -b, b)
    columns = [k + axis, k + 1 - axis, k + 3 + axis, k + 4 - axis]
    return columns, [1 - a, -turned, a, turned]


def _of_runs(excursions: Sequence[CutExcursion], name: str) -> Floats:
    return np.concatenate([getattr(one, name) for one in excursions])
