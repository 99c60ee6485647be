"""The innovations model of a recorded machine: what estimating and explaining share.

Two masses in exact steps, the white error of the measured torque as process noise, measured angle and speed, Kalman's
filter. Its innovations are white, and sensitivities filtered alike are their Jacobian: innovation = X·β + white noise.
"""
