"""The settings that benchmarks archive with: a bound on an error, and named changes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

from rate_curves import Bound

from motifold.pipeline.plan import Settings

MEAN_SETTING = "mean_tolerance"
MAX_PER_MEAN = 100.0  # the largest error is all but free where the mean one is bounded


def bounds_mean() -> bool:
    """Return whether this version of motifold can be asked for a mean error."""
    return MEAN_SETTING in {field.name for field in fields(Settings)}


def settings_for(
    bound: Bound, centimetres: float, changes: Mapping[str, Any] | None = None
) -> Settings:
    """Return settings that bound the largest error, or the mean error where there is that.

    ``changes``: as for `with_overrides`.
    """
    values: dict[str, Any] = {"tolerance": centimetres}
    if bound == "mean" and bounds_mean():
        values = {"tolerance": MAX_PER_MEAN * centimetres, MEAN_SETTING: centimetres}
    settings: Settings = with_overrides(Settings(**values), changes or {})
    return settings


def with_overrides(settings: Any, overrides: Mapping[str, Any]) -> Any:
    """Return a settings value with fields changed, in nested ones where a name has dots.

    Raises ValueError for a name that is no field.
    """
    for name, value in overrides.items():
        field, _, inner = name.partition(".")
        if not is_dataclass(settings) or field not in {entry.name for entry in fields(settings)}:
            raise ValueError(f"{type(settings).__name__} has no field {field!r}")
        if inner:
            value = with_overrides(getattr(settings, field), {inner: value})
        settings = replace(settings, **{field: value})  # type: ignore[type-var]
    return settings


def parse_changes(texts: Sequence[str]) -> dict[str, Any]:
    """Return the changes that texts such as ``codec=learned`` or ``seed=3`` ask for.

    A value is JSON where it can be read so, else a string. SystemExit for what is no change.
    """
    changes = {}
    for text in texts:
        name, sign, value = text.partition("=")
        if not sign:
            raise SystemExit(f"{text!r} changes nothing: write NAME=VALUE")
        try:
            changes[name] = json.loads(value)
        except ValueError:
            changes[name] = value
    try:
        with_overrides(Settings(), changes)
    except ValueError as problem:
        raise SystemExit(str(problem)) from problem
    return changes
