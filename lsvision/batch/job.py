"""Settings of a batch: how files are read, and how their profiles are measured."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from lsvision.io.profiles.settings import ReadOptions, ReadSettings
from lsvision.measure import Measurement, measure_profiles

if TYPE_CHECKING:
    from lsvision.inspection.job import Job

_READING_DEFAULTS = {setting.name: setting.default for setting in fields(ReadSettings)}


@dataclass(frozen=True, eq=False)
class BatchJob:
    """Settings of a batch; the same for each of its files.

    Parameters
    ----------
    measure : functools.partial
        Function that measures profiles, such as `measure_profiles`, with its keyword arguments.
    reading : ReadOptions
        Options for reading the files.
    inspection : Job, optional
        Job by which each profile is judged; `measure` then measures by this job.

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
        """Settings that determine the results, without unset ones, as plain numbers and text.

        Keys: ``measure``, the name of the function; its keyword arguments; ``reading``, the options
        that differ from their defaults; with an inspection ``job`` and ``job_hash``.
        """
        settings: dict[str, Any] = {"measure": self.measure.func.__name__}
        settings |= {
            name: _convert_to_plain(value) for name, value in self.measure.keywords.items()
        }
        settings["reading"] = {
            name: _convert_to_plain(value)
            for name, value in self.reading.items()
            if value != _READING_DEFAULTS[name]
        }
        if self.inspection is not None:
            settings |= {"job": self.inspection.name, "job_hash": self.inspection.hash}
        return {name: value for name, value in settings.items() if value is not None}

    @property
    def hash(self) -> str:
        """Hash of the settings (16 hex digits); all results in a folder have the same."""
        canonical = json.dumps(self.settings, sort_keys=True, allow_nan=False)
        return hashlib.sha256(canonical.encode()).hexdigest()[:16]


def _convert_to_plain(value: Any) -> Any:
    """Return a value as numbers, text, lists and mappings, ready for JSON; text if it is other."""
    if is_dataclass(value) and not isinstance(value, type):
        return {name: _convert_to_plain(member) for name, member in asdict(value).items()}
    if isinstance(value, Mapping):
        return {str(name): _convert_to_plain(member) for name, member in value.items()}
    if isinstance(value, (list, tuple)):
        return [_convert_to_plain(member) for member in value]
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)
