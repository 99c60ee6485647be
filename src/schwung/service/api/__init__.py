"""HTTP: one router per subject; problems.py says how errors look (RFC 9457). Every handler that may wait runs in a
thread."""
