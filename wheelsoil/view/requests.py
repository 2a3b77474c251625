"""Requests of the page, validated."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal, NoReturn, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from daq import ConfigError, Fault, parse_mapping

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Key = Annotated[str, Field(strict=True, max_length=64)]
Channel = Literal[
    "drawbar_pull_n",
    "driving_torque_nm",
    "sinkage_m",
    "vertical_load_n",
    "ground_speed_mps",
    "rim_speed_mps",
]
Asked = TypeVar("Asked", bound="_Asked")


class _Asked(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    campaign: Key


class CampaignAsked(_Asked):
    """A request about a campaign."""


class CurveAsked(_Asked):
    """A model's curve; missing values are those of the run, of the campaign (without a run), or neutral."""

    run: Key | None = None
    sinkage: Literal["balanced", "literal"] | None = None
    effects: Annotated[tuple[Key, ...], Field(max_length=32)] = ()
    values: dict[Key, Finite] = {}
    soil: dict[Key, Finite] = {}
    load_n: Annotated[Finite, Field(gt=0, le=1e7)] | None = None


class SelectedAsked(_Asked):
    """Summarise a selection of a run: an interval of time, a box over slip, or the samples of one exclusion reason.

    `low` and `high` are seconds or slips; `bottom` and `top` are limits of `channel`, for a box. `left_out`: whether
    excluded samples are displayed, and so selected, too.
    """

    run: Key
    kind: Literal["time", "slip", "reason"]
    low: Finite = 0.0
    high: Finite = 0.0
    channel: Channel | None = None
    bottom: Finite = 0.0
    top: Finite = 0.0
    code: Key = ""
    left_out: Annotated[bool, Field(strict=True)] = True


class ChoiceAsked(_Asked):
    """A choice with the keys of choice.toml; `wheelsoil.workflows.choice` checks it."""

    choice: dict[str, Any]


class SaveAsked(_Asked):
    """Write the choice beside the runs, under a file name without a folder."""

    name: Annotated[str, Field(strict=True, min_length=1, max_length=120)]
    replace: Annotated[bool, Field(strict=True)] = False


def asked_of(body: bytes, kind: type[Asked]) -> Asked:
    """Return the request in a body.

    Raises
    ------
    ConfigError
        The body is not a JSON object, or lists every error in it.
    """
    try:
        raw = json.loads(body, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise ConfigError(Fault("the body is not valid JSON", found=str(error)[:200])) from None
    if not isinstance(raw, dict):
        raise ConfigError(Fault("the body is not a JSON object", found=type(raw).__name__))
    return parse_mapping(raw, kind, "request")


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number in JSON")
