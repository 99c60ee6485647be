"""What is commanded: rest-to-rest motions and the injected torque."""

from schwung.motion.excitation import Excitation
from schwung.motion.profiles import Array, Demand, Motion, MotionKind

__all__ = ["Array", "Demand", "Excitation", "Motion", "MotionKind"]
