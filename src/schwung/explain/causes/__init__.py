"""What may be missing: laws and curves, and the equations in which they act along a run."""
