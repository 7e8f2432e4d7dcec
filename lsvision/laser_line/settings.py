"""Settings of the extraction of a laser line."""

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

from lsvision.geometry.settings_repr import ShowsChanges
from lsvision.laser_line.line_image import Bayer, Channel, Direction
from lsvision.laser_line.path_search import PathSettings

Method = Literal["derivative", "gaussian", "steger"]


@dataclass(frozen=True, kw_only=True, repr=False)
class LineSettings(ShowsChanges):
    """Settings of `extract_laser_line`.

    Parameters
    ----------
    method : {"derivative", "gaussian", "steger"}
        Sub-pixel method, see `subpixel` and `gaussian_fit`. "derivative": zero crossing of a
        derivative-of-Gaussian filter down each column; fast and without bias. Where a line
        without colours is saturated, a Gaussian is fitted to the unsaturated pixels.
        "gaussian": such a fit to each column; four times slower, for overexposed lines of a
        coloured laser. "steger": ridge of the smoothed image, for lines that are steep in both
        directions; its smoothing along the line correlates the errors of neighbours.
    sigma : float
        Standard deviation of the filter: best at 1 to 1.5 times that of the line. For a wide line
        it is doubled, once to three times. Units: px.
    direction : {"columns", "rows"}, optional
        One point for each column (a nearly horizontal line), or for each row (a nearly vertical
        one). Detected by default.
    channel : {"grey", "red", "green", "blue", "white"}
        The laser's colour in a colour image, "white" for a line of white light; "grey" for a camera
        without colours.
    bayer : {"RGGB", "BGGR", "GRBG", "GBRG"}, optional
        Colours of a sensor's first two pixels of the first row, then of the second: only the
        pixels of the colour `channel` are used, with a filter of the same sigma. The image is raw
        (one number per pixel), or interpolated from such a one.
    luminance : bool
        Locate the line in the luminance where a JPEG file or a mosaic stores the colours with a
        lower resolution, unless it looks as if the line crosses a printed pattern there. False
        where the line is known to cross one, which the colour of the laser hardly shows.
    full_scale : float, optional
        Largest value of a pixel. By default 255 for uint8; for uint16 the smallest of 10, 12, 14
        and 16 bit that holds the image; required for float. Units: DN.
    min_contrast : float
        Smallest height of a line above the background, as a fraction of the full scale; the noise
        of the image may raise it. On faint pipes of 12 % of the full scale in clutter, 34 columns
        are lost and 16 false; with 0.014 17 and 19, with 0.028 57 and 8.
    read_noise : float, optional
        Standard deviation of a dark pixel; estimated from the image by default. Units: DN.
    gain : float, optional
        Conversion gain: a pixel's variance is read_noise^2 + gain * value. Estimated
        from the image by default. Units: DN per electron.
    path : PathSettings
        Costs of the path that connects candidates to a line.

    Raises
    ------
    ValueError
        If a number is not positive (of `read_noise` and `gain`: negative), a string is not one of
        those listed, or `bayer` comes with the channel grey or white.

    Examples
    --------
    >>> LineSettings(channel="red", method="gaussian")
    LineSettings(method='gaussian', channel='red')
    """

    method: Method = "derivative"
    sigma: float = 2.0
    direction: Direction | None = None
    channel: Channel = "grey"
    bayer: Bayer | None = None
    luminance: bool = True
    full_scale: float | None = None
    min_contrast: float = 0.02
    read_noise: float | None = None
    gain: float | None = None
    path: PathSettings = field(default_factory=PathSettings)

    def __post_init__(self) -> None:
        choices = {"method": Method, "channel": Channel, "direction": Direction, "bayer": Bayer}
        for name, literal in choices.items():
            allowed, value = get_args(literal), getattr(self, name)
            may_be_none = name in ("direction", "bayer")
            if value not in allowed and not (value is None and may_be_none):
                none = " or None" * (name == "direction")
                raise ValueError(f"expected {name} among {', '.join(allowed)}{none}, got {value!r}")
        if self.bayer and self.channel in ("grey", "white"):
            raise ValueError(
                f"expected channel red, green or blue beside bayer, got {self.channel!r}"
            )
        for name in ("sigma", "full_scale", "min_contrast"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"expected a positive {name}, got {value}")
        for name in ("read_noise", "gain"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise ValueError(f"expected {name} >= 0, got {value}")
