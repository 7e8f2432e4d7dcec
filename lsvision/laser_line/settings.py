"""How a laser line is looked for and measured in an image."""

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

from lsvision.laser_line.line_image import Channel, Direction
from lsvision.laser_line.path_search import PathSettings

Method = Literal["derivative", "gaussian", "steger"]


@dataclass(frozen=True, kw_only=True)
class LineSettings:
    """How a laser line is looked for and measured in an image.

    Parameters
    ----------
    method : {"derivative", "gaussian", "steger"}
        How the sub-pixel place is found. "derivative": zero crossing of a
        derivative-of-Gaussian filter down each column; fast and without bias. "gaussian": fit
        of a Gaussian to each column, saturated pixels left out; ten times slower, the choice
        for overexposed lines. "steger": ridge of the smoothed image, for lines that run
        steeply in both directions; smooths along the line, too, which biases curves inwards
        (a radius of 25 mm by -10 um on the rig of the tests) and makes neighbours err alike.
    sigma : float
        Of the filter: best at 1 to 1.5 times the line's own. Doubled, up to 8 times, where
        the line proves wider. Units: px.
    direction : {"columns", "rows"}, optional
        One point for each column (a level line), or for each row (an upright one). Found from
        the image by default.
    channel : {"grey", "red", "green", "blue", "white"}
        The laser's colour in a colour image; "grey" for a camera without colours.
    full_scale : float, optional
        Largest number the camera records; by default that of the image's depth, see
        `prepare_line_image`. Units: DN.
    min_contrast : float
        Height above its surroundings that a line needs, as a share of the full scale.
    read_noise : float, optional
        One sigma; estimated from the image by default. Units: DN.
    gain : float, optional
        Number per electron: a pixel's variance is read_noise^2 + gain * value. Estimated
        from the image by default. Units: DN per electron.
    path : PathSettings
        How the line is followed among rivals.

    Raises
    ------
    ValueError
        If a number is not positive, or a word is not one of those listed.
    """

    method: Method = "derivative"
    sigma: float = 2.0
    direction: Direction | None = None
    channel: Channel = "grey"
    full_scale: float | None = None
    min_contrast: float = 0.02
    read_noise: float | None = None
    gain: float | None = None
    path: PathSettings = field(default_factory=PathSettings)

    def __post_init__(self) -> None:
        words = {"method": Method, "channel": Channel}
        for name, allowed in words.items():
            if getattr(self, name) not in get_args(allowed):
                raise ValueError(f"want {name} in {get_args(allowed)}, got {getattr(self, name)!r}")
        if self.direction not in (None, *get_args(Direction)):
            raise ValueError(
                f"want direction in {get_args(Direction)} or None, got {self.direction!r}"
            )
        for name in ("sigma", "full_scale", "min_contrast"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"want a positive {name}, got {value}")
        for name in ("read_noise", "gain"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise ValueError(f"want {name} >= 0, got {value}")
