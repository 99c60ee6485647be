"""What is seen of a drive while it moves: samples as they come, frames and SYNC; and the clock that it keeps."""

from __future__ import annotations

from schwung.clock import SteppedClock
from schwung.fieldbus.canopen.traffic import JITTER_EDGES_S, Counted, Traffic
from schwung.fieldbus.drive import LiveSamples, Watched
from schwung.motion import Array

__all__ = ["JITTER_EDGES_S", "Array", "Counted", "LiveSamples", "SteppedClock", "Traffic", "Watched"]
