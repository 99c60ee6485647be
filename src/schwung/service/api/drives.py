"""Drives, the machines on them, and the buses that the service was started with."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Request
from fastapi import Path as PathField
from fastapi.responses import PlainTextResponse
from pydantic import BaseModel, Field

from schwung.api.profiles import CAPABILITIES, DeviceProfile, left_to_you, list_profiles, load_profile
from schwung.errors import InputError
from schwung.service.api.models import DriveModel, MachineModel
from schwung.service.families import require_family
from schwung.service.requests import Id
from schwung.service.requests import Request as Asked
from schwung.service.service import Service

_Name = Annotated[str, Field(min_length=1, max_length=80)]


class NewDrive(Asked):
    """A drive on one of the service's buses."""

    name: _Name
    bus: Annotated[str, Field(max_length=80)]
    node_id: Annotated[int, Field(ge=1, le=247)]
    profile: Annotated[
        str | None, Field(max_length=80, description="A family's name; default: by identity.")
    ] = None
    machine_id: Id | None = None


class DriveChanges(Asked):
    """What shall be different; what is left out stays."""

    name: _Name | None = None
    profile: Annotated[str | None, Field(max_length=80)] = None
    machine_id: Id | None = None


class NewMachine(Asked):
    """A belief: machine.toml as text, and the tables that its [load] names."""

    name: Annotated[str, Field(max_length=80)] = ""
    toml: Annotated[str, Field(max_length=262_144)]
    inertia_table: Annotated[str | None, Field(max_length=2_000_000, description="CSV")] = None
    torque_table: Annotated[str | None, Field(max_length=2_000_000, description="CSV")] = None


class ProfileModel(BaseModel):
    """A family of drives; `verified`: on hardware, or on the bench only."""

    family: str
    name: str
    protocol: str
    verified: str

    @classmethod
    def of(cls, profile: DeviceProfile) -> ProfileModel:
        """As told."""
        return cls(
            family=profile.family, name=profile.name, protocol=profile.protocol, verified=profile.verified
        )


class CapabilityModel(BaseModel):
    """What a family offers, or why not."""

    name: str
    offered: bool
    reason: str


class FamilyModel(BaseModel):
    """A family in full: its profile.toml as JSON, its capabilities, and the units that are left to the user."""

    profile: dict[str, Any]
    capabilities: list[CapabilityModel]
    left_to_you: dict[str, str]

    @classmethod
    def of(cls, profile: DeviceProfile) -> FamilyModel:
        """As told."""
        offered = {name: profile.offers(name) for name in CAPABILITIES}
        return cls(
            profile=profile.model_dump(mode="json"),
            capabilities=[
                CapabilityModel(name=name, offered=yes, reason="" if yes else profile.reason(name))
                for name, yes in offered.items()
            ],
            left_to_you=left_to_you(profile),
        )


class BusModel(BaseModel):
    """A bus that the service was started with."""

    name: str
    text: str


def router(service: Service, who: Any) -> APIRouter:
    """The routes; `who(request)` tells who asks."""
    routes = APIRouter(prefix="/api", tags=["drives"])

    def told(drive_id: str) -> DriveModel:
        drive = service.store.drive(drive_id)
        return DriveModel.of(drive, service.status(drive_id), service.store.unsettled(drive_id))

    @routes.get("/buses", summary="The buses that the service was started with")
    def buses() -> list[BusModel]:
        return [BusModel(name=entry.name, text=entry.text) for entry in service.settings.buses]

    @routes.get("/drives", summary="All drives, and what is known of them now")
    def listing() -> list[DriveModel]:
        return [told(drive.id) for drive in service.store.drives()]

    @routes.get("/drives/{drive_id}", summary="One drive")
    def one(drive_id: Id) -> DriveModel:
        return told(drive_id)

    @routes.post("/drives", status_code=201, summary="Add a drive")
    def add(request: Request, drive: NewDrive) -> DriveModel:
        added = service.add_drive(
            drive.name, drive.bus, drive.node_id, drive.profile, drive.machine_id, who(request)
        )
        return told(added.id)

    @routes.patch("/drives/{drive_id}", summary="Change a drive's name, profile or machine")
    def change(request: Request, drive_id: Id, changes: DriveChanges) -> DriveModel:
        given = changes.model_dump(exclude_unset=True)
        if given.get("name", "") is None:
            raise InputError("name", "is null", "Give a name, or leave it out.")
        service.change_drive(drive_id, who(request), **given)
        return told(drive_id)

    @routes.delete("/drives/{drive_id}", status_code=204, summary="Take a drive from the list; its runs stay")
    def archive(request: Request, drive_id: Id) -> None:
        service.archive_drive(drive_id, who(request))

    @routes.get("/profiles", summary="Device profiles: families of drives")
    def profiles() -> list[ProfileModel]:
        return [ProfileModel.of(one) for one in list_profiles()]

    @routes.get(
        "/profiles/{family}", summary="One family: what it can, in which units, and where each fact is from"
    )
    def profile(family: Annotated[str, PathField(max_length=80)]) -> FamilyModel:
        require_family(family)
        return FamilyModel.of(load_profile(family))

    @routes.get("/machines", summary="All machines")
    def machines() -> list[MachineModel]:
        return [MachineModel.of(machine) for machine in service.store.machines()]

    @routes.post("/machines", status_code=201, summary="Add a machine")
    def add_machine(request: Request, machine: NewMachine) -> MachineModel:
        tables = {"inertia_table": machine.inertia_table, "torque_table": machine.torque_table}
        given = {key: text for key, text in tables.items() if text is not None}
        return MachineModel.of(service.add_machine(machine.name, machine.toml, given, who(request)))

    @routes.get("/machines/{machine_id}", summary="One machine")
    def machine(machine_id: Id) -> MachineModel:
        return MachineModel.of(service.store.machine(machine_id))

    @routes.get("/machines/{machine_id}/toml", summary="Its machine.toml", response_class=PlainTextResponse)
    def toml(machine_id: Id) -> PlainTextResponse:
        return PlainTextResponse(service.store.machine_path(machine_id).read_text(encoding="utf-8"))

    return routes
