"""Elmo Gold, by its DCF, the manual of the drives before it, and two public drivers."""

from golden_drive import Golden, Row, Sample, Scale

_DCF = "ipa320/cob_robots, cob_hardware_config/robots/common/Elmo.dcf, commit cc76524d"
_MANUAL = "Elmo CANopen DSP 402 Implementation Guide MAN-CAN402IG 1.2 (manualsdir.com/manuals/558390)"
_SDK = (
    "RCPRG-ros-pkg/velmwheel, gold_dc_whistle, conversions.hpp; leggedrobotics/elmo_ethercat_sdk, Reading.cpp"
)
_STATES = "leggedrobotics/elmo_ethercat_sdk, src/elmo_ethercat_sdk/Statusword.cpp: MAN-G-DS402, page 47"
_READ = "OpenEtherCATsociety/SOEM, issue 245: read from a Gold Twitter"
_STOP = "nasa-jpl/jsd, pull requests 66 (605A = 2) and 93 (after Gold: 5 and 6 stay in quick stop active)"

ELMO_GOLD = Golden(
    family="elmo-gold",
    rows=(
        Row("40 18 10 01", "43 18 10 01 9A 00 00 00", 0x0000009A, f"{_DCF}: default; Elmo's number at CiA"),
        Row("40 18 10 02", "43 18 10 02 23 09 03 00", 0x00030923, f"{_DCF}: ProductNumber"),
        Row("40 41 60 00", "4B 41 60 00 37 06", 0x0637, f"{_READ}; {_STATES}"),
        Row("40 02 65 00", "43 02 65 00 ED 03 00 00", 0x3ED, _READ),
        Row("40 64 60 00", "43 64 60 00 00 20 00 00", 8192, f"{_MANUAL}, page 65: position units; composed"),
        Row("40 6C 60 00", "43 6C 60 00 00 F0 FF FF", -4096, f"{_SDK}: counts per second; composed"),
        Row("40 8F 60 01", "43 8F 60 01 00 10 00 00", 4096, f"{_MANUAL}, page 44: increments, here of 1024 lines"),
        Row("40 8F 60 02", "43 8F 60 02 01 00 00 00", 1, f"{_MANUAL}, page 44: motor revolutions"),
        Row("40 91 60 01", "43 91 60 01 01 00 00 00", 1, f"{_DCF}: default"),
        Row("40 91 60 02", "43 91 60 02 01 00 00 00", 1, f"{_DCF}: default"),
        Row("40 92 60 01", "43 92 60 01 00 10 00 00", 4096, "CiA 402-2, 6092: position units per shaft revolution"),
        Row("40 92 60 02", "43 92 60 02 01 00 00 00", 1, f"{_DCF}: default"),
        Row("40 76 60 00", "43 76 60 00 F6 04 00 00", 1270, f"{_MANUAL}, page 106: a multiple of mN m"),
        Row("40 72 60 00", "4B 72 60 00 B8 0B", 3000, f"{_SDK}: per mille of the rated value; composed"),
        Row("40 5A 60 00", "4B 5A 60 00 02 00", 2, f"{_DCF}: default; {_STOP}"),
        Row("40 07 60 00", "4B 07 60 00 01 00", 1, f"{_DCF}: default: fault"),
        Row("40 5E 60 00", "4B 5E 60 00 02 00", 2, f"{_DCF}: default"),
        Row("40 10 10 01", "43 10 10 01 01 00 00 00", 1, "CiA 301, 7.5.2.13: bit 0, saves on command"),
        Row("40 60 60 00", "4F 60 60 00 00", 0, "CiA 402-2: no mode"),
        Row("40 16 10 00", "4F 16 10 00 01", 1, "CiA 301, 7.5.2.19"),
        Row("40 16 10 01", "43 16 10 01 00 00 00 00", 0, f"{_DCF}: default"),
        Row("40 17 10 00", "4B 17 10 00 00 00", 0, f"{_DCF}: default"),
        Row("40 06 10 00", "43 06 10 00 00 00 00 00", 0, f"{_DCF}: default"),
        Row("40 C2 60 01", "4F C2 60 01 0A", 10, f"{_DCF}: ParameterValue"),
        Row("40 C2 60 02", "4F C2 60 02 FD", -3, f"{_DCF}: default"),
        Row("40 00 14 01", "43 00 14 01 01 02 00 00", 0x00000201, f"{_DCF}: default"),
        Row("40 00 18 01", "43 00 18 01 81 01 00 00", 0x00000181, f"{_DCF}: default"),
        Row("40 01 18 01", "43 01 18 01 81 02 00 00", 0x00000281, f"{_DCF}: default"),
    ),
    scale=Scale(
        position_rad=0.0015339807878856412,  # 2 pi / 4096
        speed_rad_s=0.0015339807878856412,  # one count per second
        torque_nm=0.00127,  # per mille of 1.27 N m
        acceleration_rad_s2=0.0015339807878856412,  # one count per second and second
        rated_torque_nm=1.27,
        source=f"{_SDK}: 2 pi over the encoder's resolution, for position and speed; torque per mille",
    ),
    limits={"torque_max_nm": 3.81},  # 3000 per mille of 1.27 N m
    states={  # _READ up to Operation enabled; the rest _STATES
        0x0250: "Switch on disabled", 0x0231: "Ready to switch on", 0x0233: "Switched on",
        0x0637: "Operation enabled", 0x0217: "Quick stop active", 0x021F: "Fault reaction active", 0x0208: "Fault",
    },
    samples=(
        Sample(0.0, 0.0, "0F 00 00 00 00 00 00 00", ("37 12 00 00 00 00 00 00", "00 00 00 00"), 0.0, 0.0, 0.0),
        Sample(
            0.015339807878856412, -0.127, "0F 00 0A 00 00 00 9C FF",
            ("37 12 09 00 00 00 F4 01", "00 10 00 00"), 0.013805827090970771, 6.283185307179586, 0.635,
        ),
    ),
    written=(
        "23 16 10 01 2C 01 7F 00", "2B 17 10 00 64 00", "2F 60 60 00 08", "2F C2 60 01 01",
        "2B 07 60 00 03 00",  # quick stop when we are gone
        "23 00 16 01 10 00 40 60", "23 00 16 02 20 00 7A 60", "23 00 16 03 10 00 B2 60", "2F 00 16 00 03",
        "2F 00 14 02 01", "2F 00 18 02 01", "2F 01 18 02 01",
    ),
    wrong={
        "40 18 10 01": "43 18 10 01 FB 00 00 00",
        "40 92 60 01": "43 92 60 01 01 00 00 00",  # as delivered: one position unit a turn (DCF)
    },
)  # fmt: skip
