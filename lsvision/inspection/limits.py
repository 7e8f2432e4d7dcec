"""Quantities that a job can limit, and the limits of one of them."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

from lsvision.results.quantities import Quantity, Unit

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A finite number; text and booleans are rejected."""
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
"""A finite number above 0."""

SECTION_KEYS = ("radius_mm", "diameter_mm", "theta_deg", "phi_deg", "centre_x_mm", "centre_y_mm")
"""Limits of a part that one profile can be judged by."""
SCAN_KEYS = (
    "radius_mm", "diameter_mm", "direction_deg", "position_mm", "point_x_mm", "point_y_mm",
    "point_z_mm", "bow_mm", "taper_mm_per_m", "ovality_percent", "length_seen_mm",
)  # fmt: skip
"""Limits of a part that a scan can be judged by."""
RELATION_KEYS = ("distance_mm", "angle_deg", "gap_mm", "flush_mm")
"""Limits of a relation."""
POSSIBLE_RANGES = {
    **dict.fromkeys(("phi_deg", "direction_deg", "angle_deg"), (0.0, 90.0)),
    **dict.fromkeys(("radius_mm", "diameter_mm", "position_mm", "bow_mm"), (0.0, math.inf)),
    **dict.fromkeys(("ovality_percent", "length_seen_mm", "distance_mm"), (0.0, math.inf)),
}
"""Smallest and largest possible value of the quantities that have one, by key."""
UNITS: tuple[Unit, ...] = ("mm_per_m", "percent", "deg", "mm")
"""Units at the end of keys."""
LIMIT_DECIMALS = 9
"""Decimals to which nominal + deviation is rounded: 19 - 0.1 is 18.9, not 18.899999999999999."""


def quantity_from_key(key: str) -> Quantity:
    """Return name and unit of the quantity with a given key.

    Examples
    --------
    >>> quantity_from_key("taper_mm_per_m")
    Quantity(name='taper', unit='mm_per_m')
    """
    unit = next(unit for unit in UNITS if key.endswith(f"_{unit}"))
    return Quantity(key.removesuffix(f"_{unit}"), unit)


class JobTable(BaseModel):
    """Base of the tables of a job: frozen; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Limits(JobTable):
    """Limits of a quantity, in the unit of its key.

    Either a nominal value with deviations (`upper`, `lower`, as on a drawing; both may have the
    same sign, as in an ISO 286 fit of shaft and bore), or `min`, `max` or both; then `nominal` is
    only the radius by which a part is identified. Without a deviation or an end, that side has no
    limit.

    Examples
    --------
    >>> Limits(nominal=19, upper=0.1, lower=-0.1).ends
    (18.9, 19.1)
    >>> Limits(max=2.0).ends
    (-inf, 2.0)
    """

    nominal: Number | None = None
    upper: Number | None = None
    lower: Number | None = None
    min: Number | None = None
    max: Number | None = None

    @model_validator(mode="after")
    def _check(self) -> Limits:
        """Raise an error unless the limits are stated in one way and in order."""
        deviations = self.upper is not None or self.lower is not None
        ends = self.min is not None or self.max is not None
        if deviations == ends:
            got = "both" if ends else "neither"
            raise ValueError(f"expected upper and lower beside nominal, or min and max, got {got}")
        if deviations and self.nominal is None:
            raise ValueError("expected a nominal beside upper and lower, got none")
        lower, upper = self.ends
        if lower >= upper:
            raise ValueError(
                f"limits reversed: from {lower:.9g} to {upper:.9g}; exchange them"
                if lower > upper
                else f"expected different limits, got {lower:.9g} twice"
            )
        # With two deviations the nominal may lie outside, as for a shaft with -0.02 and -0.05.
        two_deviations = self.upper is not None and self.lower is not None
        if self.nominal is not None and not two_deviations and not lower <= self.nominal <= upper:
            raise ValueError(
                f"nominal {self.nominal:.9g} lies outside its limits {lower:.9g} to {upper:.9g}"
            )
        return self

    @property
    def ends(self) -> tuple[float, float]:
        """Smallest and largest permissible value; infinite where there is none."""
        if self.nominal is not None and (self.upper is not None or self.lower is not None):
            lower = -math.inf if self.lower is None else self.nominal + self.lower
            upper = math.inf if self.upper is None else self.nominal + self.upper
            return round(lower, LIMIT_DECIMALS), round(upper, LIMIT_DECIMALS)
        return (
            -math.inf if self.min is None else self.min,
            math.inf if self.max is None else self.max,
        )

    @property
    def middle(self) -> float | None:
        """The nominal, or the middle between both limits; None without a nominal and a limit."""
        if self.nominal is not None:
            return self.nominal
        middle = sum(self.ends) / 2
        return middle if math.isfinite(middle) else None
