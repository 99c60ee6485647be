"""Schwung commissions servo drives over their fieldbus: it measures the load inertia over angle."""

__version__ = "0.1.0"
