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
    max_jitter_s: _Positive | None = Field(
        None, description="Tolerated SYNC jitter (p99); default: a tenth of the period."
    )
    misses_allowed: Annotated[int, Field(ge=1, le=100, description="Heartbeats that may be missing.")] = 3
    bode_run_id: Id | None = Field(
        None, description="Take frequency, amplitude and fitted machine of this bode run."
    )


class ScanRequest(Request):
    """Who is on a bus. Reads only."""

    kind: Literal["scan"]
    bus: Annotated[str, Field(max_length=80)]
    first: Annotated[int, Field(ge=1, le=127)] = 1
    last: Annotated[int, Field(ge=1, le=127)] = 127


class DoctorRequest(Request):
    """What is missing before a drive can be commissioned, and how to mend it. Reads only."""

    kind: Literal["doctor"]
    drive_id: Id
    eds_file_id: Id | None = Field(None, description="The vendor's EDS, uploaded; default: the profile's.")


class BackupRequest(Request):
    """Read a drive's whole configuration into a file. Reads only."""

    kind: Literal["backup"]
    drive_id: Id
    form: Literal["dcf", "concise", "backup"] = "dcf"


class SecureRequest(Request):
    """Look at a drive and switch it off where it is on; no STOP forbids it."""

    kind: Literal["secure"]
    drive_id: Id


class ResetFaultRequest(Request):
    """Acknowledge a fault; the power stage stays off."""

    kind: Literal["reset_fault"]
    drive_id: Id


class ExplainRequest(Request):
    """Say what a belief leaves out of a stored session: where, which physics, how sure, what to measure next."""

    kind: Literal["explain"]
    session_id: Id
    machine_id: Id | None = Field(
        None, description="Default: the machine that the session was recorded with."
    )
    next_motion: bool = Field(
        False, description="Choose the motion that best tells apart what the session leaves confused."
    )


class ProposeBodeRequest(Request):
    """Propose a measurement of the frequency response at standstill. Moves nothing."""

    kind: Literal["propose_bode"]
    drive_id: Id
    machine_id: Id | None = None
    angles_rad: Annotated[list[_Finite], Field(min_length=1, max_length=32)]
    limits: Limits = Limits()
    waveform: Literal["multisine", "sine"] = "multisine"
    amplitude_nm: _Positive | None = None
    lowest_hz: _Positive | None = None
    highest_hz: _Positive | None = None
    periods: Annotated[int, Field(ge=2, le=100)] = 4
    repeats: Annotated[int, Field(ge=1, le=50)] = 2
    sample_rate_hz: Annotated[float, Field(ge=50, le=4000)] = 1000.0
    distance_rad: _Finite | None = Field(
        None, description="Stroke that the proposal is for; default: the angles'."
    )
    duration_s: _Positive = 0.25


class ProposeExportRequest(Request):
    """Show what writing an inertia table into a drive would change. Writes nothing."""

    kind: Literal["propose_export"]
    drive_id: Id
    estimate_id: Id
    form: Literal["table", "harmonics", "mean", "max", "at"] = "table"
    at_rad: _Finite | None = None
    store: bool = Field(True, description="Save in the drive's memory (1010).")
    verify: bool = Field(
        False, description="Make the session's reference motion before and after: the machine moves."
    )


class ProposeRestoreRequest(Request):
    """Show what putting a configuration back would change. Writes nothing.

    `unsafe_id`: what an interrupted run has left; `file_id`: a *.backup.json, DCF or concise DCF of a run.
    """

    kind: Literal["propose_restore"]
    drive_id: Id
    unsafe_id: Id | None = None
    file_id: Id | None = None
    force: bool = Field(False, description="Also on a drive with another identity.")
    store: bool = Field(False, description="Save in the drive's memory (1010) when all is written.")


class OptimiseRequest(Request):
    """Find the motion that costs the least, within every limit of motor and load, with a measured table."""

    kind: Literal["optimise"]
    estimate_id: Id | None = Field(None, description="Take the machine as measured there.")
    machine_id: Id | None = None
    start_rad: _Finite = 0.0
    distance_rad: _Finite
    duration_s: _Positive | None = Field(None, description="None: as fast as the limits allow.")
    limits: Limits = Limits()
    jerk_max_rad_s3: _Positive | None = None
    weights: dict[Literal["copper", "energy", "peak", "vibration"], Annotated[float, Field(ge=0, lt=1e9)]] = {
        "copper": 1.0
    }
    regeneration: bool = Field(True, description="Whether braking gives energy back.")
    payloads_kgm2: Annotated[list[_Positive], Field(max_length=8)] = []
    robust: bool = False
    rivals: bool = True
    sample_rate_hz: Annotated[float, Field(ge=50, le=8000)] = 1000.0


class OptimiseWithFrontRequest(OptimiseRequest):
    """Find the motion that costs the least, within every limit of motor and load, with a measured table."""

    front: bool = Field(
        False,
        description="The Pareto front, too: over time without a duration, else between two objectives.",
    )


class ProposePlayRequest(OptimiseRequest):
    """Find the best motion from where the axis stands, within the drive's limits, beside a usual one. Moves nothing."""

    kind: Literal["propose_play"]  # type: ignore[assignment]
    drive_id: Id
    against: Literal["third", "poly5", "scurve", "cosine", "cycloid"] = "third"
    repeats: Annotated[int, Field(ge=1, le=50)] = 3


class DiffRequest(Request):
    """Which parameters differ between a file and a drive, or another file. Reads only."""

    kind: Literal["diff"]
    file_id: Id = Field(description="A DCF, EDS, concise DCF or backup: of a run, or uploaded.")
    drive_id: Id | None = None
    second_file_id: Id | None = Field(None, description="Instead of a drive.")
    eds_file_id: Id | None = Field(
        None, description="Names and types; default: a DCF's own, else the profile's."
    )
    profile: Annotated[str | None, Field(max_length=80)] = None


class ImportAsRequest(Request):
    """Make a session of a file that was uploaded, with the columns as somebody has confirmed them."""

    kind: Literal["import_as"]
    file_id: Id
    options: dict[str, Any] = Field({}, description="Keys of a recipe.")
    guess: bool = Field(False, description="Propose what the options leave open; import nothing yet.")
    dbc_file_id: Id | None = None
    drive_id: Id | None = None
    machine_id: Id | None = None


class ConvertRequest(Request):
    """A session in a format of other tools, without loss."""

    kind: Literal["convert"]
    session_id: Id
    form: Literal["mf4", "parquet"]


class CheckProfileRequest(Request):
    """Does an EDS bear out what a device profile says?"""

    kind: Literal["check_profile"]
    family: Annotated[str, Field(max_length=80)]
    eds_file_id: Id | None = Field(None, description="The vendor's, uploaded; default: the profile's.")


class DraftProfileRequest(Request):
    """Draft the device profile of a family from an EDS, and say what could not be found in it."""

    kind: Literal["draft_profile"]
    eds_file_id: Id
    family: Annotated[str | None, Field(pattern=r"^[a-z0-9][a-z0-9-]{0,60}$")] = None


class BatchRequest(Request):
    """Estimate or explain many stored sessions anew, each with its machine; one bad file never ends it."""

    kind: Literal["batch"]
    work: Literal["estimate", "explain"] = "estimate"
    session_ids: Annotated[list[Id], Field(max_length=10_000)] = Field([], description="Empty: all.")
    machine_id: Id | None = Field(
        None, description="Of all sessions; default: the machine that each was recorded with."
    )
    method: Annotated[str, Field(max_length=40)] = "auto"
    inversion: Literal["complex", "magnitude"] = "complex"
    frequency_hz: _Positive | None = None
    points: Annotated[int, Field(ge=4, le=1000)] | None = None
    jobs: Annotated[int, Field(ge=1, le=64)] | None = None


class ReproduceRequest(Request):
    """The paper's figures and Table 2 from its simulated machine, beside what it reports."""

    kind: Literal["reproduce"]
    what: Annotated[list[Annotated[str, Field(max_length=20)]], Field(max_length=20)] = ["all"]


class Confirmed(Request):
    """What moves or writes names the proposal that was shown, and its digest."""

    proposal_id: Id
    digest: Digest


class CommissionRequest(Confirmed):
    """Carry out a confirmed plan: creep, motions without and with injection, estimate, report."""

    kind: Literal["commission"]


class BodeRequest(Confirmed):
    """Carry out a confirmed measurement of the frequency response, and fit it."""

    kind: Literal["bode"]


class PlayRequest(Confirmed):
    """Make the usual motion and the best one in turn, and compare what they cost."""

    kind: Literal["play"]


class ExportRequest(Confirmed):
    """Write what was shown into the drive, read it back, store it; verified by the motion where that was asked for."""

    kind: Literal["export"]


class RestoreRequest(Confirmed):
    """Put back what was shown."""

    kind: Literal["restore"]


AnyRequest = Annotated[
    EstimateRequest
    | PlanRequest
    | ScanRequest
    | DoctorRequest
    | BackupRequest
    | SecureRequest
    | ResetFaultRequest
    | ExplainRequest
    | ProposeBodeRequest
    | ProposeExportRequest
    | ProposeRestoreRequest
    | OptimiseWithFrontRequest
    | ProposePlayRequest
    | CommissionRequest
    | BodeRequest
    | PlayRequest
    | ExportRequest
    | RestoreRequest
    | DiffRequest
    | ImportAsRequest
    | ConvertRequest
    | CheckProfileRequest
    | DraftProfileRequest
    | BatchRequest
    | ReproduceRequest,
    Field(discriminator="kind"),
]


class SalvageRequest(Request):
    """Enter the recording that an interrupted run has left."""

    kind: Literal["salvage"]
    run_id: Id


_adapter: TypeAdapter[Any] = TypeAdapter(AnyRequest)


def parse_request(document: Any) -> Any:
    """A request as stored or sent. Raises pydantic.ValidationError."""
    return _adapter.validate_python(document)
