"""The settings that shape evidence, and so belong to a grid for good (docs/settings.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Annotated, Literal, TypeAlias

from possmap.core.model import ErrorModel
from possmap.core.ranges import Number, Range, at_least, between
from possmap.core.records import OwnModel

Estimator: TypeAlias = Literal["linear", "heading", "walls"]
Independence: TypeAlias = Literal["detection", "excursion"]
FreeFusion: TypeAlias = Literal["minimum", "dempster"]
WIDEST = 10.0
"""Body of a robot [m]."""
SHARE = Range("a number above 0, at most 1", 0, 1, is_open=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceSettings:
    """What turns records into numbers; two grids with other settings cannot be compared.

    Attributes
    ----------
    resolution
        Metres per cell, > 0.
    estimator
        How error rectangles are propagated: ``linear`` is the paper's; ``heading`` needs
        calibrated robots, ``turn_spread`` <= 0.5; to ``walls`` every wall measures the heading.
    orthogonal, axes
        For ``walls``: whether the building's walls stand at right angles, and the direction of
        any one of them in the site frame [deg].
    independence
        ``detection``: every detection of a wall is independent evidence (the paper);
        ``excursion``: only those of different excursions are.
    free_fusion
        ``minimum``: the strongest denial of a wall counts (the paper); ``dempster``: those of
        several excursions are combined by Dempster's rule.
    certainty_power
        An excursion's necessity N counts as N to this power, >= 1.
    pass_weight
        An excursion's denial counts as this share of it, in (0, 1].
    free_along_walls, clip_coobserved
        Whether runs past walls deny walls on their path, and whether they spare what they saw.
    free_along_beams
        Whether the path of a range reading denies walls.
    path_width
        Width of the floor that a robot's body clears on its path [m]; 0: the paper's pyramids.
    accept_models
        Whether a log's own model is believed.
    model
        The error model of a robot of which nothing else is known.

    Raises
    ------
    ValueError
        ``name, value found, what was expected`` for a value outside its range, and for discounts
        that the other settings give no meaning.
    """

    resolution: Annotated[float, Range("a number >= 1e-6", 1e-6), "metres per cell"] = 0.05
    estimator: Annotated[
        Estimator, "linear: the paper's; heading: turn_spread <= 0.5; walls: any"
    ] = "linear"
    orthogonal: Annotated[bool, "the building's walls stand at right angles (walls)"] = False
    axes: Annotated[Number, "direction of any one of its walls [deg] (walls)"] = 0.0
    independence: Annotated[Independence, "what counts as independent: detection or excursion"] = (
        "detection"
    )
    free_fusion: Annotated[FreeFusion, "how several excursions deny a wall together"] = "minimum"
    certainty_power: Annotated[float, at_least(1), "power to which an excursion's N counts"] = 1.0
    pass_weight: Annotated[
        float, SHARE, "share of an excursion's denial that counts (dempster)"
    ] = 1.0
    free_along_walls: Annotated[bool, "runs past walls deny walls on their path"] = False
    free_along_beams: Annotated[bool, "the paths of range readings deny walls"] = False
    clip_coobserved: Annotated[bool, "such a run spares the walls that it saw itself"] = False
    path_width: Annotated[
        float, between(0, WIDEST), "width of floor that a path clears [m]; 0: pyramids"
    ] = 0.0
    accept_models: Annotated[bool, "a log's own error model is believed"] = True
    model: ErrorModel = field(default_factory=ErrorModel)

    def __post_init__(self) -> None:
        k, beta = self.certainty_power, self.pass_weight
        if not k >= 1:  # phrased so that NaN is refused too
            raise ValueError(f"certainty_power, found {k}, expected a number >= 1")
        if not 0 < beta <= 1:
            raise ValueError(f"pass_weight, found {beta}, expected a number above 0, at most 1")
        for name, value in (("certainty_power", k), ("pass_weight", beta)):
            if value != 1 and self.independence != "excursion":
                raise ValueError(
                    f"{name}, found {value}, expected 1 without independence: excursion"
                )
        if beta != 1 and self.free_fusion != "dempster":
            raise ValueError(f"pass_weight, found {beta}, expected 1 without free_fusion: dempster")

    def model_in_force(self, own: OwnModel, robot: Mapping[str, float]) -> ErrorModel:
        """Return the model under which an excursion is fused.

        Parameters
        ----------
        own
            The log's own parameters: the strongest, unless ``accept_models`` is off.
        robot
            The host's entry for this robot (``robots:``), which beats the general model.
        """
        return self.model.with_own({**robot, **(dict(own) if self.accept_models else {})})


RobotModels: TypeAlias = Mapping[str, Mapping[str, float]]
"""Robot name -> parameters that the host knows of it (the setting ``robots``)."""

NO_ROBOTS: RobotModels = MappingProxyType({})
