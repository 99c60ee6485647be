"""Object dictionaries: EDS and DCF files of whatever quality, repaired and read through canopen.

Objects are addressed by index only: vendors spell one name in many ways.
"""

from schwung.fieldbus.eds.lines import EdsWarning
from schwung.fieldbus.eds.load import EdsFile, find_parameter, load_dictionary, read_eds
from schwung.fieldbus.eds.types import TYPE_CODES, TYPE_NAMES, byte_size, decode, encode, integer_range

__all__ = [
    "TYPE_CODES",
    "TYPE_NAMES",
    "EdsFile",
    "EdsWarning",
    "byte_size",
    "decode",
    "encode",
    "find_parameter",
    "integer_range",
    "load_dictionary",
    "read_eds",
]
