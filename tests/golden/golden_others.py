"""Trinamic TMCM-1636, WITTENSTEIN simco, FAULHABER CC, and the standard itself.

Of simco and CC nobody publishes more than an EDS: their units are those of the standard's factor group alone, and what
the EDS does not tell must stay untold.
"""

from golden_drive import Golden, Row, Sample, Scale

_STANDARD = "CiA 402-2, table of the statusword"
_STATES = {
    0x0200: "Not ready to switch on", 0x0240: "Switch on disabled", 0x0221: "Ready to switch on",
    0x0223: "Switched on", 0x0227: "Operation enabled", 0x0207: "Quick stop active",
    0x020F: "Fault reaction active", 0x0208: "Fault",
}  # fmt: skip

_PY = "analogdevicesinc/PyTrinamic, examples/modules/TMCM_1636/CANopen"
_TMC_EDS = f"{_PY}/TMCM-1636-CANopen_Hw1.1_Fw1.12.eds, commit 59f78bad"

TRINAMIC = Golden(
    family="trinamic-tmcm1636",
    rows=(
        Row("40 18 10 01", "43 18 10 01 86 02 00 00", 0x00000286, f"{_TMC_EDS}: default of 1018:01"),
        Row("40 18 10 02", "43 18 10 02 64 06 00 00", 0x00000664, f"{_TMC_EDS}: 1636 in decimal"),
        Row("40 41 60 00", "4B 41 60 00 27 02", 0x0227, f"{_PY}, profile velocity by PDO: get_state, mask 006F"),
        Row("40 64 60 00", "43 64 60 00 00 F0 FF FF", -4096, f"{_PY}/encoder_csp_mode.py: 4096 counts are a turn"),
        Row("40 58 20 00", "43 58 20 00 00 10 00 00", 4096, f"{_PY}, profile velocity by PDO: Position Scaler = Steps"),
        Row("40 5A 60 00", "4B 5A 60 00 02 00", 2, f"{_TMC_EDS}: default"),
        Row("40 5E 60 00", "4B 5E 60 00 02 00", 2, f"{_TMC_EDS}: default"),
        Row("40 10 10 01", "43 10 10 01 01 00 00 00", 1, "CiA 301, 7.5.2.13: bit 0, saves on command"),
        Row("40 60 60 00", "4F 60 60 00 03", 3, f"{_PY}: PROFILE_VELOCITY_MODE"),
        Row("40 16 10 00", "4F 16 10 00 01", 1, "CiA 301, 7.5.2.19"),
        Row("40 16 10 01", "43 16 10 01 00 00 00 00", 0, f"{_TMC_EDS}: default"),
        Row("40 17 10 00", "4B 17 10 00 00 00", 0, f"{_TMC_EDS}: default"),
        Row("40 C2 60 01", "4F C2 60 01 00", 0, f"{_TMC_EDS}: default"),
        Row("40 C2 60 02", "4F C2 60 02 00", 0, f"{_TMC_EDS}: default"),
        Row("40 00 14 01", "43 00 14 01 01 02 00 40", 0x40000201, f"{_TMC_EDS}: default"),
        Row("40 00 18 01", "43 00 18 01 81 01 00 00", 0x00000181, f"{_TMC_EDS}: default"),
        Row("40 01 18 01", "43 01 18 01 81 02 00 00", 0x00000281, f"{_TMC_EDS}: default"),
    ),
    scale=Scale(0.0015339807878856412, None, None, None, None, f"{_PY}/encoder_csp_mode.py: 2 pi / 4096"),
    states={0x0200: "Not ready to switch on", 0x0240: "Switch on disabled", 0x0221: "Ready to switch on",
            0x0223: "Switched on", 0x0227: "Operation enabled", 0x0207: "Quick stop active", 0x0208: "Fault"},
    samples=(
        Sample(0.0, 0.0, "0F 00 00 00 00 00", ("27 02 00 00 00 00 00 00", "00 00 00 00"), 0.0, None, None),
        Sample(
            -0.015339807878856412, 0.0, "0F 00 F6 FF FF FF",
            ("27 02 F7 FF FF FF E8 03", "F4 01 00 00"), -0.013805827090970771, None, None,
        ),
    ),
    written=(
        "23 16 10 01 2C 01 7F 00", "2B 17 10 00 64 00",
        "2F 60 60 00 08",  # CYCLIC_SYNCHRONOUS_POSITION_MODE = 8
        "2F C2 60 01 01", "2F C2 60 02 FD",
        "23 00 16 01 10 00 40 60", "23 00 16 02 20 00 7A 60", "2F 00 16 00 02",
        "23 00 14 01 01 02 00 40",
    ),
    wrong={"40 18 10 02": "43 18 10 02 65 06 00 00"},
)  # fmt: skip

_SIMCO = "ITVRoC/kacanopen, master/share/eds_library/Wittenstein/simco.eds, commit e772d9cd"
_FACTORS = "CiA 402-2, 608F, 6091, 6092: position units = feed constant / gear ratio per motor revolution"

SIMCO = Golden(
    family="wittenstein-simco",
    rows=(
        Row("40 18 10 01", "43 18 10 01 0A 01 00 00", 0x0000010A, f"{_SIMCO}: default of 1018:01"),
        Row("40 41 60 00", "4B 41 60 00 27 02", 0x0227, _STANDARD),
        Row("40 64 60 00", "43 64 60 00 A0 8C 00 00", 36000, f"{_FACTORS}: a turn of the shaft behind the gear"),
        Row("40 8F 60 01", "43 8F 60 01 00 00 01 00", 65536, f"{_FACTORS}; composed"),
        Row("40 8F 60 02", "43 8F 60 02 01 00 00 00", 1, f"{_FACTORS}; composed"),
        Row("40 91 60 01", "43 91 60 01 0A 00 00 00", 10, f"{_FACTORS}; motor revolutions, a gear of 10"),
        Row("40 91 60 02", "43 91 60 02 01 00 00 00", 1, f"{_FACTORS}; shaft revolutions"),
        Row("40 92 60 01", "43 92 60 01 A0 8C 00 00", 36000, f"{_FACTORS}; feed"),
        Row("40 92 60 02", "43 92 60 02 01 00 00 00", 1, f"{_FACTORS}; shaft revolutions"),
        Row("40 76 60 00", "43 76 60 00 20 03 00 00", 800, "CiA 402-2, 6076: mN m"),
        Row("40 07 60 00", "4B 07 60 00 00 00", 0, f"{_SIMCO}: default: it does nothing when we are gone"),
        Row("40 5A 60 00", "4B 5A 60 00 00 00", 0, f"{_SIMCO}: default: drive function off, the motor coasts"),
        Row("40 60 60 00", "4F 60 60 00 00", 0, "CiA 402-2: no mode"),
        Row("40 02 65 00", "43 02 65 00 ED 03 00 00", 0x3ED, f"{_SIMCO}: default: pp, pv, tq, hm, ip, csp, csv, cst"),
        Row("40 06 10 00", "43 06 10 00 00 00 00 00", 0, "CiA 301, 7.5.2.6"),
        Row("40 19 10 00", "4F 19 10 00 00", 0, f"{_SIMCO}: 1019 is there"),
        Row("40 16 10 00", "4F 16 10 00 02", 2, f"{_SIMCO}: default of 1016:00"),
        Row("40 16 10 01", "43 16 10 01 00 00 00 00", 0, f"{_SIMCO}: default"),
        Row("40 16 10 02", "43 16 10 02 00 00 00 00", 0, f"{_SIMCO}: default"),
        Row("40 17 10 00", "4B 17 10 00 00 00", 0, f"{_SIMCO}: default"),
        Row("40 C2 60 01", "4F C2 60 01 01", 1, "CiA 402-2, 60C2; composed"),
        Row("40 C2 60 02", "4F C2 60 02 FD", -3, "CiA 402-2, 60C2; composed"),
        Row("40 00 14 01", "43 00 14 01 01 02 00 80", 0x80000201, f"{_SIMCO}: default: off"),
        Row("40 00 18 01", "43 00 18 01 81 01 00 80", 0x80000181, f"{_SIMCO}: default: off"),
        Row("40 01 18 01", "43 01 18 01 81 02 00 80", 0x80000281, f"{_SIMCO}: default: off"),
    ),
    scale=Scale(
        position_rad=0.0017453292519943296,  # 2 pi / (36000 / 10)
        speed_rad_s=None,
        torque_nm=0.0008,
        acceleration_rad_s2=None,
        rated_torque_nm=0.8,
        source=_FACTORS,
    ),
    states=_STATES,
    samples=(
        Sample(0.0, 0.0, "0F 00 00 00 00 00 00 00", ("27 12 00 00 00 00 00 00", "00 00 00 00"), 0.0, None, 0.0),
        Sample(
            0.008726646259971648, 0.2, "0F 00 05 00 00 00 FA 00",
            ("27 12 05 00 00 00 06 FF", "11 00 00 00"), 0.008726646259971648, None, -0.2,
        ),
    ),
    written=(
        "23 00 14 01 01 02 00 00", "23 00 18 01 81 01 00 00", "23 01 18 01 81 02 00 00",  # on
        "23 16 10 01 2C 01 7F 00", "2F 60 60 00 08", "2B 07 60 00 03 00",
        "23 06 10 00 E8 03 00 00",  # 1000 us
    ),
    wrong={"40 18 10 01": "43 18 10 01 0B 01 00 00"},
)  # fmt: skip

_CC = "KITmedical/kacanopen, master/share/eds_library/Faulhaber/605.3150.51-V-EK-2-60.eds, commit 38fc1acc"

FAULHABER_CC = Golden(
    family="faulhaber-cc",
    mode="",
    modes=("", ""),
    rows=(
        Row("40 18 10 01", "43 18 10 01 47 01 00 00", 327, f"{_CC}: default of 1018:01"),
        Row("40 18 10 02", "43 18 10 02 4E 0C 00 00", 3150, f"{_CC}: default of 1018:02"),
        Row("40 41 60 00", "4B 41 60 00 27 02", 0x0227, _STANDARD),
        Row("40 64 60 00", "43 64 60 00 00 08 00 00", 2048, f"{_CC}: a turn, by 608F"),
        Row("40 8F 60 01", "43 8F 60 01 00 08 00 00", 2048, f"{_CC}: default of 608F:01"),
        Row("40 8F 60 02", "43 8F 60 02 01 00 00 00", 1, f"{_CC}: default of 608F:02"),
        Row("40 93 60 01", "43 93 60 01 01 00 00 00", 1, f"{_CC}: default of 6093:01"),
        Row("40 10 10 01", "43 10 10 01 01 00 00 00", 1, "CiA 301, 7.5.2.13: bit 0, saves on command"),
        Row("40 93 60 02", "43 93 60 02 01 00 00 00", 1, f"{_CC}: default of 6093:02"),
    ),
    scale=Scale(0.0030679615757712823, None, None, None, None, f"{_CC}: 2 pi / 2048; the rest has no unit"),
    states=_STATES,
    wrong={"40 18 10 02": "43 18 10 02 4F 0C 00 00"},
)  # fmt: skip

_NANOTEC = (
    "Nanotec PD4-C manual FIR-v1626, page 209 (manualshive.com/en/manual/nanotec/pd4-c5918m4204-e-01/3241520)"
)
_BECKHOFF = "Beckhoff AX8000, object 6077 (infosys.beckhoff.com/content/1033/ax8xxx_object/18798585483.html)"
_SYNAPTICON = "Synapticon, object 6076 (doc-legacy.synapticon.com/software/42, 0x6076 Motor rated torque)"
_STOP = "Beckhoff AX8000, object 605A (infosys.beckhoff.com/content/1033/ax8xxx_object/11604658955.html)"

_CANDUMP = (
    "canopen-python/canopen, issue 167: 201 02 00, then 181 17 16, 40 06 and 40 02 of a drive with 605A = 2"
)

GENERIC = Golden(
    family="generic-cia402",
    identified=False,
    rows=(
        Row("40 18 10 01", "43 18 10 01 02 00 00 00", 2, "CiA 301, 7.5.2.21: any manufacturer"),
        Row("40 41 60 00", "4B 41 60 00 27 02", 0x0227, _STANDARD),
        Row("40 64 60 00", "43 64 60 00 00 00 04 00", 262144, "composed: a quarter of 2^20"),
        Row("40 8F 60 01", "43 8F 60 01 00 00 10 00", 1048576, f"{_NANOTEC}: encoder increments"),
        Row("40 8F 60 02", "43 8F 60 02 01 00 00 00", 1, f"{_NANOTEC}: motor revolutions"),
        Row("40 A9 60 00", "43 A9 60 00 00 47 B4 FD", 0xFDB44700, "CiA 303-2: 10^-3, revolutions, per minute"),
        Row("40 AA 60 00", "43 AA 60 00 00 03 C0 00", 0x00C00300, "CiA 303-2: revolutions per minute, per second"),
        Row("40 76 60 00", "43 76 60 00 C4 09 00 00", 2500, f"{_SYNAPTICON}: mN m"),
        Row("40 77 60 00", "4B 77 60 00 F4 01", 500, f"{_BECKHOFF}: per thousand of 6076"),
        Row("40 5A 60 00", "4B 5A 60 00 02 00", 2, f"{_STOP}: on the quick-stop ramp, then switch on disabled"),
        Row("40 07 60 00", "4B 07 60 00 01 00", 1, "CiA 402-2, 6007: fault"),
        Row("40 72 60 00", "4B 72 60 00 B8 0B", 3000, "CiA 402-2, 6072: per thousand of 6076"),
        Row("40 60 60 00", "4F 60 60 00 00", 0, "CiA 402-2: no mode"),
        Row("40 06 10 00", "43 06 10 00 00 00 00 00", 0, "CiA 301, 7.5.2.6: us"),
        Row("40 16 10 00", "4F 16 10 00 01", 1, "CiA 301, 7.5.2.19"),
        Row("40 16 10 01", "43 16 10 01 32 00 20 00", 0x00200032, "CiA 301, 7.5.2.19: it watches node 32, for 50 ms"),
        Row("40 17 10 00", "4B 17 10 00 00 00", 0, "CiA 301, 7.5.2.20"),
        Row("40 C2 60 01", "4F C2 60 01 02", 2, "CiA 402-2, 60C2: 2 ms"),
        Row("40 C2 60 02", "4F C2 60 02 FD", -3, "CiA 402-2, 60C2"),
        Row("40 00 14 01", "43 00 14 01 01 02 00 00", 0x00000201, "CiA 301, 7.3.5: predefined connection set"),
        Row("40 00 18 01", "43 00 18 01 81 01 00 00", 0x00000181, "CiA 301, 7.3.5"),
        Row("40 01 18 01", "43 01 18 01 81 02 00 00", 0x00000281, "CiA 301, 7.3.5"),
    ),
    scale=Scale(
        position_rad=5.992112452678286e-06,  # 2 pi / 2^20
        speed_rad_s=0.00010471975511965977,  # 0.001 rpm
        torque_nm=0.0025,
        acceleration_rad_s2=0.10471975511965977,
        rated_torque_nm=2.5,
        source=f"{_NANOTEC}; {_SYNAPTICON}; {_BECKHOFF}",
    ),
    limits={"torque_max_nm": 7.5},
    states=_STATES | {0x1617: "Quick stop active", 0x0640: "Switch on disabled"},  # _CANDUMP
    samples=(
        Sample(0.0, 0.0, "0F 00 00 00 00 00 00 00", ("27 12 00 00 00 00 00 00", "00 00 00 00"), 0.0, 0.0, 0.0),
        Sample(
            0.0015339807878856412, 1.25, "0F 00 00 01 00 00 F4 01",
            ("27 12 80 00 00 00 06 FF", "60 EA 00 00"), 0.0007669903939428206, 6.283185307179586, -0.625,
        ),
    ),
    written=("2B 17 10 00 64 00", "2F 60 60 00 08", "2F C2 60 01 01", "2B 07 60 00 03 00"),
)  # fmt: skip

_BENCH = "docs/bench.md, table: 70 N m, 2^20 a turn, 10^-3 rpm"

BENCH = Golden(
    family="schwung-bench",
    rows=(
        Row("40 18 10 01", "43 18 10 01 47 4E 57 53", 0x53574E47, 'sim/schwung_sim: "SWNG", high byte first'),
        Row("40 18 10 02", "43 18 10 02 02 04 00 00", 0x00000402, "sim/schwung_sim: 402"),
        Row("40 41 60 00", "4B 41 60 00 37 06", 0x0637, _STANDARD),
        Row("40 64 60 00", "43 64 60 00 00 00 F8 FF", -524288, f"{_BENCH}; composed: half a turn back"),
        Row("40 8F 60 01", "43 8F 60 01 00 00 10 00", 1048576, _BENCH),
        Row("40 8F 60 02", "43 8F 60 02 01 00 00 00", 1, _BENCH),
        Row("40 A9 60 00", "43 A9 60 00 00 47 B4 FD", 0xFDB44700, _BENCH),
        Row("40 AA 60 00", "43 AA 60 00 00 03 C0 FD", 0xFDC00300, "schwung-bench.eds: 10^-3 rpm per second"),
        Row("40 76 60 00", "43 76 60 00 70 11 01 00", 70000, _BENCH),
        Row("40 5A 60 00", "4B 5A 60 00 02 00", 2, "docs/bench.md, table: the standard's default"),
        Row("40 07 60 00", "4B 07 60 00 01 00", 1, "docs/bench.md, table: the standard's default"),
        Row("40 5E 60 00", "4B 5E 60 00 01 00", 1, "CiA 402-2, 605E: 1, on the slow-down ramp"),
        Row("40 60 60 00", "4F 60 60 00 00", 0, "CiA 402-2: no mode"),
        Row("40 06 10 00", "43 06 10 00 00 00 00 00", 0, "CiA 301, 7.5.2.6: us"),
        Row("40 19 10 00", "4F 19 10 00 00", 0, "CiA 301, 7.5.2.22: no counter"),
        Row("40 16 10 00", "4F 16 10 00 01", 1, "CiA 301, 7.5.2.19"),
        Row("40 16 10 01", "43 16 10 01 00 00 00 00", 0, "CiA 301, 7.5.2.19"),
        Row("40 17 10 00", "4B 17 10 00 00 00", 0, "CiA 301, 7.5.2.20"),
        Row("40 C2 60 01", "4F C2 60 01 01", 1, "CiA 402-2, 60C2"),
        Row("40 C2 60 02", "4F C2 60 02 FD", -3, "CiA 402-2, 60C2"),
        Row("40 00 14 01", "43 00 14 01 01 02 00 00", 0x00000201, "CiA 301, 7.3.5: predefined connection set"),
        Row("40 00 18 01", "43 00 18 01 81 01 00 00", 0x00000181, "CiA 301, 7.3.5"),
        Row("40 01 18 01", "43 01 18 01 81 02 00 00", 0x00000281, "CiA 301, 7.3.5"),
    ),
    scale=Scale(5.992112452678286e-06, 0.00010471975511965977, 0.07, 0.00010471975511965977, 70.0, _BENCH),
    states=_STATES,
    samples=(
        Sample(0.0, 0.0, "0F 00 00 00 00 00 00 00", ("37 12 00 00 00 00 00 00", "00 00 00 00"), 0.0, 0.0, 0.0),
        Sample(
            0.0015339807878856412, -7.0, "0F 00 00 01 00 00 9C FF",
            ("37 12 FF 00 00 00 64 00", "60 EA 00 00"), 0.001527988675432963, 6.283185307179586, 7.0,
        ),
    ),
    written=("2B 07 60 00 03 00", "2B 5E 60 00 02 00", "2F 60 60 00 08"),
    wrong={"40 18 10 01": "43 18 10 01 47 4E 57 54"},
)  # fmt: skip
