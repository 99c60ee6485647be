"""Causes weighed by their evidence under one likelihood: `weigh` (weigh.py) is the door."""
