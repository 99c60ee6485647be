"""What is told of what was weighed: the file, its proof on runs kept aside, curves and formulas."""
