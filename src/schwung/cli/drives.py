"""Opening the drive that the options name."""

from __future__ import annotations

from schwung.fieldbus.connecting import Connected as OpenDrive
from schwung.fieldbus.connecting import connected as open_drive

__all__ = ["OpenDrive", "open_drive"]
