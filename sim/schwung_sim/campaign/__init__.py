"""The fault campaign's half of the machine room: what befalls a session, and who watches."""
