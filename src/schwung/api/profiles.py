"""Device profiles: what a family of drives offers, listed, checked and drafted."""

from __future__ import annotations

from schwung.fieldbus.profile import (
    CAPABILITIES,
    CanopenProfile,
    DeviceProfile,
    list_profiles,
    load_canopen_profile,
    load_profile,
)
from schwung.fieldbus.profile.check import check_profile
from schwung.fieldbus.profile.draft import draft_profile

__all__ = [
    "CAPABILITIES",
    "CanopenProfile",
    "DeviceProfile",
    "check_profile",
    "draft_profile",
    "left_to_you",
    "list_profiles",
    "load_canopen_profile",
    "load_profile",
]


def left_to_you(profile: DeviceProfile) -> dict[str, str]:
    """Quantities without a unit, and what it takes to give one."""
    q = profile.quantities
    named = {name: getattr(q, name) for name in type(q).model_fields}
    return {
        f"quantities.{name}": quantity.hint or "give its scale"
        for name, quantity in named.items()
        if quantity is not None and quantity.unit == "user"
    }
