"""Session and belief -> what the belief leaves out: where, which physics, how sure, and the proof on held-out runs."""
