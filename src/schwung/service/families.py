"""Families of drives, by their names: no path is taken for one."""

from __future__ import annotations

from schwung.api.profiles import list_profiles
from schwung.errors import InputError


def require_family(profile: str) -> None:
    """Raise InputError where there is no device profile of that name."""
    families = [found.family for found in list_profiles()]
    if profile not in families:
        raise InputError("profile", "there is no such family", f"There are: {', '.join(families)}.")
