"""Profile files: where they lie, how they are read, how one extends another."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

import schwung
from schwung.errors import InputError
from schwung.fieldbus.profile.model import CanopenProfile, DeviceProfile, ModbusProfile

_DEPTH = 4  # of profiles that extend each other


def profile_folders() -> tuple[Path, ...]:
    """Where profiles are looked for: inside the installed package, then the repository's own folder."""
    package = Path(schwung.__file__).parent
    candidates = (package / "device_profiles", package.parent.parent / "device_profiles")
    return tuple(folder for folder in candidates if folder.is_dir())


def load_profile(name_or_path: str | Path) -> DeviceProfile:
    """Load a profile by family name ("schwung-bench") or by path of its folder or file.

    Raises InputError naming file, key and remedy.
    """
    return _read(_find(name_or_path))


def load_canopen_profile(name_or_path: str | Path) -> CanopenProfile:
    """The same, for who needs a CANopen drive. Raises InputError for a family of another protocol too."""
    profile = load_profile(name_or_path)
    if not isinstance(profile, CanopenProfile):
        raise InputError(
            f"profile {profile.family}", "is not for CANopen", "Name a CANopen family, or connect by its bus."
        )
    return profile


def list_profiles() -> tuple[DeviceProfile, ...]:
    """Every profile that comes with Schwung, by family name."""
    return tuple(load_profile(family) for family in _families())


def _find(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    candidates = [path / "profile.toml" if path.is_dir() else path]
    if len(path.parts) == 1:
        candidates = [folder / path / "profile.toml" for folder in profile_folders()] + candidates
    for file in candidates:
        if file.is_file():
            return file
    known = ", ".join(_families())
    raise InputError(f'profile "{name_or_path}"', "is neither a known family nor a file", f"Known: {known}.")


def _families() -> list[str]:
    return sorted(
        {file.parent.name for folder in profile_folders() for file in folder.glob("*/profile.toml")}
    )


def _content(file: Path, depth: int = _DEPTH) -> tuple[dict[str, Any], Path]:
    """What a file says, with what it extends below it, and the folder in which its EDS lies."""
    try:
        content = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(file), f"cannot be read ({error})", "Give a readable UTF-8 file.") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(str(file), f"is no TOML: {error}", "Mend the line that it names.") from error
    base = content.pop("extends", None)
    if base is None:
        return content, file.parent
    if not isinstance(base, str) or depth == 0:
        raise InputError(
            f"{file}, extends", f"{base!r} leads nowhere", "Name one family that stands by itself."
        )
    beside = file.parent / base
    below, folder = _content(_find(beside if beside.exists() else base), depth - 1)
    return _merged(below, content), file.parent if "eds" in content else folder


def _merged(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """Tables are merged key by key; everything else is replaced. A quantity whose unit changes is a new one."""
    merged = dict(below)
    for key, value in above.items():
        old = merged.get(key)
        if isinstance(old, dict) and isinstance(value, dict):
            kept = old if "unit" not in value else {k: v for k, v in old.items() if k in ("object", "demand")}
            merged[key] = _merged(kept, value)
        else:
            merged[key] = value
    return merged


def _read(file: Path) -> DeviceProfile:
    content, folder = _content(file)
    kind = ModbusProfile if content.get("protocol") == "modbus" else CanopenProfile
    try:
        profile: DeviceProfile = kind.model_validate({**content, "folder": folder})
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "file"
        problem = first["msg"].removeprefix("Value error, ")
        raise InputError(
            f"{file}, {key}", problem, "Compare with docs/profiles.md and device_profiles/schwung-bench."
        ) from error
    if isinstance(profile, CanopenProfile) and not profile.eds_path.is_file():
        raise InputError(f"{file}, eds", f'"{profile.eds}" does not lie beside it', "Put the EDS there.")
    return profile
