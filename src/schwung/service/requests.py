"""What can be asked for: one model per kind of run. Strict: what a model does not know is refused.

Units are SI and in the names. Ids are the store's; there is no path among the fields.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

Id = Annotated[str, Field(pattern=r"^[0-9a-f]{16}$", description="An id as the service gave it.")]
Digest = Annotated[
    str, Field(pattern=r"^[0-9a-f]{64}$", description="SHA-256 of the proposal that is confirmed.")
]
_Positive = Annotated[float, Field(gt=0, lt=1e9)]
_Finite = Annotated[float, Field(gt=-1e9, lt=1e9)]


class Request(BaseModel):
    """What all have in common."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


class Limits(Request):
    """Limits that the motion shall keep; what is left out is the drive's and the machine's."""

    position_min_rad: _Finite | None = None
    position_max_rad: _Finite | None = None
    speed_max_rad_s: _Positive | None = None
    torque_max_nm: _Positive | None = None
    following_error_rad: _Positive | None = None


class EstimateRequest(Request):
    """Estimate the load inertia over angle from a stored session."""

    kind: Literal["estimate"]
    session_id: Id
    machine_id: Id | None = Field(
        None, description="Default: the machine that the session was recorded with."
    )
    method: Annotated[str, Field(max_length=40)] = "auto"
    inversion: Literal["complex", "magnitude"] = "complex"
    frequency_hz: _Positive | None = None
    points: Annotated[int, Field(ge=4, le=1000)] | None = None


class PlanRequest(Request):
    """Propose a commissioning: plan and preflight, with predicted travel, speed and torque. Moves nothing."""

    kind: Literal["plan"]
    drive_id: Id
    machine_id: Id | None = Field(None, description="Default: the machine of the drive.")
    distance_rad: _Finite
    duration_s: _Positive
    limits: Limits = Limits()
    profile_kind: Annotated[str, Field(max_length=20)] = "third"
    returns: bool = True
    mode: Literal["auto", "csp", "pp"] = "auto"
    sampling: Literal["auto", "sync", "trace"] = "auto"
    injecting: Literal["auto", "setpoints", "generator"] = "auto"
    sample_rate_hz: Annotated[float, Field(ge=50, le=4000)] = 1000.0
    trace_rate_hz: _Positive | None = None
    frequency_hz: _Positive | None = None
    amplitude_nm: _Positive | None = None
    repeats: Annotated[int, Field(ge=1, le=50)] = 2
    phases: Annotated[int, Field(ge=1, le=64)] = 1
    also_s: Annotated[list[_Positive], Field(max_length=8)] = []
    bode_run_id: Id | None = Field(
        None, description="Take frequency, amplitude and fitted machine of this bode run."
    )


class Confirmed(Request):
    """What moves or writes names the proposal that was shown, and its digest."""

    proposal_id: Id
    digest: Digest


class CommissionRequest(Confirmed):
    """Carry out a confirmed plan: creep, motions without and with injection, estimate, report."""

    kind: Literal["commission"]


AnyRequest = Annotated[EstimateRequest | PlanRequest | CommissionRequest, Field(discriminator="kind")]

_adapter: TypeAdapter[Any] = TypeAdapter(AnyRequest)


def parse_request(document: Any) -> Any:
    """A request as stored or sent. Raises pydantic.ValidationError."""
    return _adapter.validate_python(document)
