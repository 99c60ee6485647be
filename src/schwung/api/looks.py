"""How the report looks, for who draws the same elsewhere: colours, thinned curves."""

from __future__ import annotations

from schwung.report.colours import PALETTE, thin

__all__ = ["PALETTE", "thin"]
