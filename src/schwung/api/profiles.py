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
    "list_profiles",
    "load_canopen_profile",
    "load_profile",
]
