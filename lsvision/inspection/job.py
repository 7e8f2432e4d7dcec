"""Job: settings of a measurement and limits of its parts, read from a TOML file."""

from __future__ import annotations

import hashlib
import json
import os
import tomllib
from functools import cached_property
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator

from lsvision.errors import InvalidJob
from lsvision.files.limited_reading import read_text
from lsvision.inspection.job_contradictions import (
    find_ambiguous_parts,
    find_impossible_limits,
    find_limits_of_known_values,
    find_unknown_parts,
)
from lsvision.inspection.job_mistakes import (
    Mistake,
    MistakesError,
    describe_mistakes,
    find_line,
    parse_syntax_mistake,
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
            *find_ambiguous_parts(self.parts),
            *find_unknown_parts(self.parts, self.relations),
            *find_limits_of_known_values(self.measure, self.parts, self.relations, self.golden),
            *find_impossible_limits(self.measure, self.parts, self.relations),
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
            raise InvalidJob(name, (parse_syntax_mistake(error),)) from None
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


def _check_schema(values: dict[str, Any], text: str) -> list[Mistake]:
    """Return the mistake of a schema that is newer than `SCHEMA`; an empty list otherwise."""
    version = values.get("schema", SCHEMA)
    if not isinstance(version, int) or version <= SCHEMA:
        return []
    message = f"expected schema {SCHEMA} or older, got {version}: install a newer lsvision"
    return [Mistake(find_line(("schema",), text), message)]
