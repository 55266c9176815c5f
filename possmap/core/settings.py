"""The settings that shape evidence, and so belong to a grid for good (docs/settings.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal, TypeAlias

from possmap.core.model import ErrorModel
from possmap.core.records import OwnModel

Estimator: TypeAlias = Literal["linear", "heading"]
Independence: TypeAlias = Literal["detection", "excursion"]


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceSettings:
    """What turns records into numbers; two grids with other settings cannot be compared.

    Attributes
    ----------
    resolution
        Metres per cell, > 0.
    estimator
        How error rectangles are propagated: ``linear`` is the paper's; ``heading`` needs
        calibrated robots, ``turn_spread`` <= 0.5.
    independence
        ``detection``: every detection of a wall is independent evidence (the paper);
        ``excursion``: only those of different excursions are.
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
    """

    resolution: float = 0.05
    estimator: Estimator = "linear"
    independence: Independence = "detection"
    free_along_walls: bool = False
    free_along_beams: bool = False
    clip_coobserved: bool = False
    path_width: float = 0.0
    accept_models: bool = True
    model: ErrorModel = field(default_factory=ErrorModel)

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
