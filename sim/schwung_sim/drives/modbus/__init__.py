"""A servo drive on Modbus, its registers made of a profile.toml."""
