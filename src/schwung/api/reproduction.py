"""The figures of the paper, drawn anew."""

from __future__ import annotations

from schwung.report.reproduction import Reproduced, reproduce

__all__ = [
    "Reproduced",
    "reproduce",
]
