"""Job: settings of a measurement and limits of its parts, read from a TOML file."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import tomllib
from functools import cached_property
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator

from lsvision.errors import InvalidJob
from lsvision.files.limited_reading import read_text
from lsvision.inspection.job_mistakes import (
    Location,
    Mistake,
    MistakesError,
    describe_mistakes,
    find_line,
    syntax_mistake,
)
from lsvision.inspection.job_tables import (
    Count,
    DecisionRule,
    Golden,
    Measure,
    Name,
    Output,
    Part,
    RelationLimits,
    Rig,
    Scan,
    Source,
    find_part,
)
from lsvision.inspection.limits import JobTable

SCHEMA = 1
"""Version of the job file that this package writes, and the newest that it reads."""


class Job(JobTable):
    """Settings of a measurement and limits of its parts, as stated in one TOML file.

    Keys end with the unit of their values; unknown keys are errors. Jobs with equal values have
    equal hashes, whatever the order and layout of the keys in their files.

    Examples
    --------
    >>> job = Job.from_text('''
    ... name = "tube"
    ... [[part]]
    ... name = "left"
    ... order = 1
    ... radius_mm = { nominal = 19, upper = 0.1, lower = -0.1 }
    ... ''')
    >>> job.part("left").radius_mm.ends, job.decision.level, job.extra_std("radius_mm")
    ((18.9, 19.1), 0.95, 0.0)
    """

    format_version: Annotated[int, Field(strict=True, ge=1, le=SCHEMA, alias="schema")] = SCHEMA
    name: Name
    revision: Count = 1
    source: Source | None = None
    rig: Rig = Rig()
    scan: Scan | None = None
    measure: Measure = Measure()
    parts: Annotated[tuple[Part, ...], Field(alias="part", min_length=1)]
    relations: Annotated[tuple[RelationLimits, ...], Field(alias="relation")] = ()
    decision: DecisionRule = DecisionRule()
    golden: Golden | None = None
    output: Output | None = None

    @model_validator(mode="after")
    def _check_parts(self) -> Job:
        mistakes = [
            *_find_ambiguous_parts(self.parts),
            *_find_unknown_parts(self),
            *_find_limits_of_known_radius(self),
        ]
        if mistakes:
            raise MistakesError(mistakes)
        return self

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Job:
        """Return the job of a file.

        Parameters
        ----------
        path : path
            TOML file in UTF-8.

        Returns
        -------
        Job
            Validated job; see `from_text`.

        Raises
        ------
        InvalidJob, UnreadableFile
            If the job has mistakes; if the file cannot be read, or is not text.

        Examples
        --------
        >>> import tempfile
        >>> from pathlib import Path
        >>> file = Path(tempfile.mkdtemp()) / "job.toml"
        >>> _ = file.write_text('''
        ... name = "tube"
        ... [[part]]
        ... name = "left"
        ... order = 1
        ... radius_mm = { min = 9 }
        ... ''')
        >>> Job.load(file).name
        'tube'
        """
        return cls.from_text(read_text(path), os.fspath(path))

    @classmethod
    def from_text(cls, text: str, name: str = "job") -> Job:
        """Return the job of the text of a file.

        Parameters
        ----------
        text : str
            Text in TOML.
        name : str
            Name of the file, in messages.

        Returns
        -------
        Job
            Validated job.

        Raises
        ------
        InvalidJob
            If the job has mistakes; the message states each with its line and the remedy.
        """
        try:
            values = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise InvalidJob(name, (syntax_mistake(error),)) from None
        schema_mistakes = _check_schema(values, text)
        if schema_mistakes:
            raise InvalidJob(name, tuple(schema_mistakes))
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            raise InvalidJob(name, tuple(describe_mistakes(error, text, cls))) from None

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the canonical form: sorted keys, defaults filled in, without layout."""
        values = self.model_dump(mode="json", by_alias=True)
        text = json.dumps(values, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()

    def part(self, name: str) -> Part:
        """Return the part with a given name.

        Parameters
        ----------
        name : str
            Name of the part in the job.

        Returns
        -------
        Part
            Part with its limits.

        Raises
        ------
        ValueError
            If the job has no part with that name.
        """
        return find_part({part.name: part for part in self.parts}, name)

    def extra_std(self, key: str) -> float:
        """Return the stated uncertainty that the fit does not contain, in the unit of the key.

        Parameters
        ----------
        key : str
            Key of the quantity, such as ``radius_mm``.

        Returns
        -------
        float
            Standard uncertainty; 0 if the job does not state it. That of a diameter is twice that
            of the radius, unless the job states it.
        """
        stated = self.decision.extra_std
        if key == "diameter_mm" and key not in stated:
            return 2 * stated.get("radius_mm", 0.0)
        return stated.get(key, 0.0)


def _find_ambiguous_parts(parts: tuple[Part, ...]) -> list[tuple[Location, str]]:
    """Return the mistakes of parts that have the same name or select the same cylinder."""
    mistakes: list[tuple[Location, str]] = []
    for (_, first), (number, second) in itertools.combinations(enumerate(parts), 2):
        location = ("part", number)
        if first.name == second.name:
            mistakes.append(
                ((*location, "name"), f"two parts are named {first.name!r}: rename one")
            )
        if first.order is not None and first.order == second.order:
            mistakes.append(
                (
                    (*location, "order"),
                    f"{first.name!r} and {second.name!r} select the same cylinder, order "
                    f"{first.order}: give each part an order of its own",
                )
            )
        if first.windows and second.windows and _overlap(first, second):
            mistakes.append(
                (
                    (*location, f"{next(iter(second.windows))}_mm"),
                    f"{first.name!r} and {second.name!r} select the same cylinder: their windows "
                    "overlap; separate the windows",
                )
            )
    return mistakes


def _overlap(first: Part, second: Part) -> bool:
    """Return whether some position lies in the windows of both parts; common edges do not count."""
    unlimited = (float("-inf"), float("inf"))
    for axis in "xyz":
        low_1, high_1 = first.windows.get(axis, unlimited)
        low_2, high_2 = second.windows.get(axis, unlimited)
        if max(low_1, low_2) >= min(high_1, high_2):
            return False
    return True


def _find_unknown_parts(job: Job) -> list[tuple[Location, str]]:
    """Return the mistakes of relations that name unknown parts."""
    names = [part.name for part in job.parts]
    mistakes: list[tuple[Location, str]] = []
    for number, relation in enumerate(job.relations):
        location = ("relation", number, "between")
        first, second = relation.between
        mistakes += [
            (location, f"no part is named {name!r}: the parts are {', '.join(map(repr, names))}")
            for name in relation.between
            if name not in names
        ]
        if first == second:
            mistakes.append((location, f"expected two parts, got {first!r} twice"))
    return mistakes


def _find_limits_of_known_radius(job: Job) -> list[tuple[Location, str]]:
    """Return the mistakes of limits that would be compared with a known radius, not a measured one.

    They are those of the radius with a known radius of all cylinders. With that of a part, its
    radius is judged as measured without it.
    """
    if job.measure.known_radius_mm is None:
        return []
    places: list[Location] = [
        ("part", number, key)
        for number, part in enumerate(job.parts)
        for key in ("radius_mm", "diameter_mm")
        if key in part.limits
    ]
    if job.golden is not None:
        places.append(("golden", "radius_mm"))
    return [
        (
            place,
            f"{place[-1]} would be compared with known_radius_mm of [measure], whatever the points "
            "say: write known_radius_mm under [[part]] instead",
        )
        for place in places
    ]


def _check_schema(values: dict[str, Any], text: str) -> list[Mistake]:
    """Return the mistake of a schema that is newer than `SCHEMA`; an empty list otherwise."""
    version = values.get("schema", SCHEMA)
    if not isinstance(version, int) or version <= SCHEMA:
        return []
    message = f"expected schema {SCHEMA} or older, got {version}: install a newer lsvision"
    return [Mistake(find_line(("schema",), text), message)]
