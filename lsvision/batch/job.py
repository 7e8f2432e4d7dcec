"""Settings of a batch: how files are read, and how their profiles are measured."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, is_dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from lsvision.io.profiles.settings import ReadOptions
from lsvision.measure import Measurement, measure_profiles

if TYPE_CHECKING:
    from lsvision.inspection.job import Job


@dataclass(frozen=True, eq=False)
class BatchJob:
    """Settings of a batch; the same for each of its files.

    Parameters
    ----------
    measure : functools.partial
        Function that measures profiles: `measure_profiles` with its keyword arguments.
    reading : ReadOptions
        Options of reading.
    inspection : Job, optional
        Parts and limits by which each profile is judged.

    Examples
    --------
    >>> from functools import partial
    >>> BatchJob(partial(measure_profiles, radius=19.0)).settings["radius"]
    19.0
    """

    measure: partial[list[Measurement]] = field(default_factory=lambda: partial(measure_profiles))
    reading: ReadOptions = field(default_factory=ReadOptions)
    inspection: "Job | None" = None

    @property
    def settings(self) -> dict[str, Any]:
        """All settings that differ from their defaults, as plain numbers and text."""
        changed: dict[str, Any] = {"measure": self.measure.func.__name__}
        changed |= {name: _convert_to_plain(value) for name, value in self.measure.keywords.items()}
        reading = {name: _convert_to_plain(value) for name, value in self.reading.items()}
        changed["reading"] = {
            name: value for name, value in reading.items() if value not in (None, False)
        }
        if self.inspection is not None:
            changed |= {"job": self.inspection.name, "job_hash": self.inspection.hash}
        return {name: value for name, value in changed.items() if value is not None}

    @property
    def hash(self) -> str:
        """Hash of the settings (16 hex digits); results in one folder must have the same."""
        canonical = json.dumps(self.settings, sort_keys=True, allow_nan=False)
        return hashlib.sha256(canonical.encode()).hexdigest()[:16]


def _convert_to_plain(value: Any) -> Any:
    """Return a value as numbers, text, lists and mappings, ready for JSON."""
    if is_dataclass(value) and not isinstance(value, type):
        return {name: _convert_to_plain(member) for name, member in asdict(value).items()}
    if isinstance(value, Mapping):
        return {str(name): _convert_to_plain(member) for name, member in value.items()}
    if isinstance(value, (list, tuple)):
        return [_convert_to_plain(member) for member in value]
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)
