"""Device profiles: what a drive family offers and in which units. Data in device_profiles/, no code.

A profile is a folder with `profile.toml` and, for CANopen, the EDS that it names beside it. docs/profiles.md
documents the file field by field. `DeviceProfile` is what all protocols share, and all that commissioning sees.
"""

from schwung.fieldbus.profile.acquire import (
    DisturbanceBuffer,
    Generator,
    GeneratorControl,
    Trace,
    TraceColumn,
    TraceControl,
    TracedQuantity,
    TraceStatus,
)
from schwung.fieldbus.profile.files import (
    list_profiles,
    load_canopen_profile,
    load_profile,
    profile_folders,
)
from schwung.fieldbus.profile.modbus import Limits, Modbus, RegisterIdentity, State, Strokes
from schwung.fieldbus.profile.model import (
    CAPABILITIES,
    CanopenProfile,
    CapabilityName,
    DeviceProfile,
    Identity,
    ModbusProfile,
    Pdo,
    Sync,
)
from schwung.fieldbus.profile.parts import (
    InjectedQuantity,
    ObjectRef,
    PositionQuantity,
    Quantities,
    Quantity,
    Ref,
    ScaledObject,
    Setting,
)
from schwung.fieldbus.profile.targets import (
    Control,
    Export,
    HarmonicExport,
    ScalarExport,
    Stop,
    TableExport,
)

__all__ = [
    "CAPABILITIES",
    "CanopenProfile",
    "CapabilityName",
    "Control",
    "DeviceProfile",
    "DisturbanceBuffer",
    "Export",
    "Generator",
    "GeneratorControl",
    "HarmonicExport",
    "Identity",
    "InjectedQuantity",
    "Limits",
    "Modbus",
    "ModbusProfile",
    "ObjectRef",
    "Pdo",
    "PositionQuantity",
    "Quantities",
    "Quantity",
    "Ref",
    "RegisterIdentity",
    "ScalarExport",
    "ScaledObject",
    "Setting",
    "State",
    "Stop",
    "Strokes",
    "Sync",
    "TableExport",
    "Trace",
    "TraceColumn",
    "TraceControl",
    "TraceStatus",
    "TracedQuantity",
    "list_profiles",
    "load_canopen_profile",
    "load_profile",
    "profile_folders",
]
