"""maxon EPOS4 and EPOS2, by what is published of their firmware specifications.

The EPOS4 is the one of the DCF: Module 50/15 with an EC 90 flat and a MILE encoder of 800 pulses. 6076 proves its unit:
it is the nominal current (3001:01, 4760 mA) times the torque constant (3001:05, 107746 µN·m/A), 0.512871 N·m.
"""

from golden_drive import Golden, Row, Sample, Scale

_DCF = "Roboprotos/maxon_epos4_ros1, epos4_50_15_can_ec90flat_gp52c_mile800_node1.dcf, commit 6630475b: ParameterValue"
_UNITS = "Imcab/EposLib, include/epos4/core/UnitConversion.hpp, after EPOS4 Firmware Specification 2026-07 (rel13740)"
_ENUMS = (
    "Imcab/EposLib, include/epos4/signals/Enums.hpp, after EPOS4 Firmware Specification 2026-07 (rel13740)"
)

EPOS4 = Golden(
    family="maxon-epos4",
    rows=(
        Row("40 18 10 01", "43 18 10 01 FB 00 00 00", 0x000000FB, f"{_DCF}; maxon's number at CiA"),
        Row("40 18 10 02", "43 18 10 02 00 00 52 65", 0x65520000, _DCF),
        Row("40 41 60 00", "4B 41 60 00 37 86", 0x8637, f"{_ENUMS}, table 6-148: bit 15 is the home reference"),
        Row("40 64 60 00", "43 64 60 00 C0 F9 FF FF", -1600, "composed: half a turn back, INTEGER32"),
        Row("40 00 30 05", "43 00 30 05 80 0C 00 00", 3200, f"{_DCF}; 4 x 800 pulses: {_UNITS}"),
        Row("40 A8 60 00", "43 A8 60 00 00 00 B5 00", 0x00B50000, f"{_UNITS}: increments, the one legal value"),
        Row("40 A9 60 00", "43 A9 60 00 00 47 B4 00", 0x00B44700, f"{_UNITS}: rpm, the default"),
        Row("40 AA 60 00", "43 AA 60 00 00 03 C0 00", 0x00C00300, f"{_UNITS}: rpm/s, the one legal value"),
        Row("40 76 60 00", "43 76 60 00 67 D3 07 00", 512871, f"{_DCF}; micronewton metres: {_UNITS}"),
        Row("40 01 30 05", "43 01 30 05 E2 A4 01 00", 107746, _DCF),
        Row("40 A1 30 05", "43 A1 30 05 D9 0A 00 00", 2777, _DCF),
        Row("40 5A 60 00", "4B 5A 60 00 06 00", 6, f"{_ENUMS}, table 6-149: 6 to 6, on the quick-stop ramp, and stay"),
        Row("40 07 60 00", "4B 07 60 00 03 00", 3, f"{_ENUMS}, table 6-146: 3, on the quick-stop ramp"),
        Row("40 5E 60 00", "4B 5E 60 00 02 00", 2, f"{_ENUMS}, table 6-153: 2, on the quick-stop ramp"),
        Row("40 02 65 00", "43 02 65 00 A5 03 00 00", 0x3A5, f"{_DCF}: pp, pv, hm, csp, csv, cst"),
        Row("40 65 60 00", "43 65 60 00 20 4E 00 00", 20000, f"{_DCF}; increments"),
        Row("40 66 60 00", "4B 66 60 00 00 00", 0, _DCF),
        Row("40 7D 60 01", "43 7D 60 01 00 00 00 00", 0, f"{_DCF}: both 0, no window"),
        Row("40 7D 60 02", "43 7D 60 02 00 00 00 00", 0, _DCF),
        Row("40 7F 60 00", "43 7F 60 00 14 05 00 00", 1300, f"{_DCF}; rpm, as 60A9"),
        Row("40 80 60 00", "43 80 60 00 14 05 00 00", 1300, f"{_DCF}; rpm: the limit and the range of 607F"),
        Row("40 60 60 00", "4F 60 60 00 01", 1, f"{_ENUMS}, table 6-154: profile position"),
        Row("40 16 10 00", "4F 16 10 00 02", 2, "CiA 301, 7.5.2.19"),
        Row("40 16 10 01", "43 16 10 01 00 00 00 00", 0, _DCF),
        Row("40 16 10 02", "43 16 10 02 00 00 00 00", 0, _DCF),
        Row("40 17 10 00", "4B 17 10 00 00 00", 0, _DCF),
        Row("40 10 10 01", "43 10 10 01 01 00 00 00", 1, f"{_DCF}: saves on command"),
        Row("40 C2 60 01", "4F C2 60 01 00", 0, _DCF),
        Row("40 C2 60 02", "4F C2 60 02 FD", -3, _DCF),
        Row("40 00 14 01", "43 00 14 01 01 02 00 00", 0x00000201, _DCF),
        Row("40 00 18 01", "43 00 18 01 81 01 00 40", 0x40000181, "the same DCF: DefaultValue; no remote request"),
        Row("40 01 18 01", "43 01 18 01 81 02 00 C0", 0xC0000281, "the same DCF: DefaultValue; off, no remote request"),
    ),
    scale=Scale(
        position_rad=1.9634954084936208e-03,  # 2 pi / 3200
        speed_rad_s=0.10471975511965977,  # 1 rpm
        torque_nm=0.000512871,  # per mille of 4.760 A x 0.107746 N m/A
        acceleration_rad_s2=0.10471975511965977,  # 1 rpm/s
        rated_torque_nm=0.512871,
        source=_UNITS,
    ),
    limits={
        "speed_max_rad_s": 136.1356816555577,  # 1300 rpm
        "following_error_rad": 39.269908169872416,  # 20000 / 3200 turns
        "following_error_time_s": 0.0,
    },
    states={  # _ENUMS, table 2-5 (bits 4 and 7 do not count), with remote, home reference and mode's bits
        0x0000: "Not ready to switch on", 0x8240: "Switch on disabled", 0x8231: "Ready to switch on",
        0x8233: "Switched on", 0x9637: "Operation enabled", 0x00B7: "Operation enabled",
        0x8217: "Quick stop active", 0x021F: "Fault reaction active", 0x8208: "Fault",
    },
    samples=(  # controlword, target, torque offset | statusword, position, torque | speed
        Sample(0.0, 0.0, "0F 00 00 00 00 00 00 00", ("37 92 00 00 00 00 00 00", "00 00 00 00"), 0.0, 0.0, 0.0),
        Sample(
            0.009817477042468103, 0.0512871, "0F 00 05 00 00 00 64 00",
            ("37 92 04 00 00 00 9C FF", "2D 00 00 00"), 0.007853981633974483, 4.71238898038469, -0.0512871,
        ),
        Sample(
            -0.007853981633974483, -0.256436, "0F 00 FC FF FF FF 0C FE",
            ("37 92 FF FF FF FF F4 01", "88 FF FF FF"), -0.0019634954084936208, -12.566370614359172, 0.2564355,
        ),
    ),
    written=(
        "23 16 10 01 2C 01 7F 00",  # our node 127 is missed after 300 ms (CiA 301, 7.5.2.19: node, then ms)
        "2B 17 10 00 64 00",  # its own heartbeat every 100 ms
        "2F 60 60 00 08",  # table 6-154: cyclic synchronous position
        "2F C2 60 01 01",  # 1 x 10^-3 s
        "23 00 16 01 10 00 40 60", "23 00 16 02 20 00 7A 60", "23 00 16 03 10 00 B2 60", "2F 00 16 00 03",
        "23 00 1A 01 10 00 41 60", "23 00 1A 02 20 00 64 60", "23 00 1A 03 10 00 77 60", "2F 00 1A 00 03",
        "23 01 1A 01 20 00 6C 60", "2F 01 1A 00 01",
        "2F 00 14 02 01", "2F 00 18 02 01", "2F 01 18 02 01",
        "23 00 18 01 81 01 00 40", "23 01 18 01 81 02 00 40",  # on, and still without remote request
    ),
    wrong={
        "40 18 10 01": "43 18 10 01 9A 00 00 00",  # another manufacturer
        "40 18 10 02": "43 18 10 02 00 00 50 61",  # another EPOS4
    },
)  # fmt: skip

_EPOS2 = "uos/epos2_motor_controller, src/Epos2.h, after EPOS2 Firmware Specification"
_EDS2 = "KITmedical/kacanopen, epos2_347717.eds, commit 38fc1acc"
_STATES2 = "EPOS Firmware Specification, 8.1.1, table 1 (device state bits)"

EPOS2 = Golden(
    family="maxon-epos2",
    mode="pp",
    modes=("", "2F 60 60 00 01"),
    rows=(
        Row("40 18 10 01", "43 18 10 01 FB 00 00 00", 0x000000FB, f"{_EDS2}: VendorNumber"),
        Row("40 18 10 02", "43 18 10 02 00 00 22 63", 0x63220000, f"{_EDS2}: ProductNumber"),
        Row("40 41 60 00", "4B 41 60 00 37 01", 0x0137, f"{_STATES2}: Operation Enable; bit 8: offset measured"),
        Row("40 64 60 00", "43 64 60 00 D0 07 00 00", 2000, "composed: one turn of an encoder of 500 pulses"),
        Row("40 6C 60 00", "43 6C 60 00 1E 00 00 00", 30, f"{_EPOS2}: one quadcount in 1 ms, 500 pulses, is 30 rpm"),
        Row("40 78 60 00", "4B 78 60 00 18 FC", -1000, f"{_EPOS2}: mA"),
        Row("40 10 22 01", "43 10 22 01 F4 01 00 00", 500, f"{_EDS2}: default of 2210:01, pulses"),
        Row("40 8A 60 00", "4F 8A 60 00 AC", 0xAC, f"{_EDS2}: position in increments"),
        Row("40 8B 60 00", "4F 8B 60 00 00", 0, f"{_EDS2}: times 10^0"),
        Row("40 8C 60 00", "4F 8C 60 00 A4", 0xA4, f"{_EDS2}: speed in revolutions per minute"),
        Row("40 07 60 00", "4B 07 60 00 00 00", 0, f"{_EDS2}: 6007 is there"),
        Row("40 5E 60 00", "4B 5E 60 00 02 00", 2, f"{_EDS2}: default"),
        Row("40 10 10 01", "43 10 10 01 01 00 00 00", 1, "CiA 301, 7.5.2.13: bit 0, saves on command"),
        Row("40 60 60 00", "4F 60 60 00 03", 3, f"{_EPOS2}: profile velocity"),
        Row("40 81 60 00", "43 81 60 00 E8 03 00 00", 1000, f"{_EPOS2}: rpm"),
        Row("40 83 60 00", "43 83 60 00 10 27 00 00", 10000, f"{_EPOS2}: rpm/s"),
        Row("40 84 60 00", "43 84 60 00 10 27 00 00", 10000, f"{_EPOS2}: rpm/s"),
        Row("40 16 10 00", "4F 16 10 00 01", 1, "CiA 301, 7.5.2.19"),
        Row("40 16 10 01", "43 16 10 01 00 00 00 00", 0, f"{_EDS2}: default"),
        Row("40 17 10 00", "4B 17 10 00 00 00", 0, f"{_EDS2}: default"),
        Row("40 00 14 01", "43 00 14 01 01 02 00 00", 0x00000201, f"{_EDS2}: default"),
        Row("40 00 18 01", "43 00 18 01 81 01 00 40", 0x40000181, f"{_EDS2}: default"),
        Row("40 01 18 01", "43 01 18 01 81 02 00 C0", 0xC0000281, f"{_EDS2}: default"),
    ),
    scale=Scale(
        position_rad=0.0031415926535897933,  # 2 pi / (4 x 500)
        speed_rad_s=0.10471975511965977,
        torque_nm=None,  # a current is no torque
        acceleration_rad_s2=0.10471975511965977,
        rated_torque_nm=None,
        source=f"{_EPOS2}: quadcounts, rev/min, rev/min/s, mA",
    ),
    states={  # _STATES2; Measure Init (4133) is read as Switched on, though power is applied
        0x0100: "Not ready to switch on", 0x0140: "Switch on disabled", 0x0121: "Ready to switch on",
        0x0123: "Switched on", 0x4123: "Switched on", 0x4133: "Switched on",
        0x0137: "Operation enabled", 0x0117: "Quick stop active",
        0x010F: "Fault reaction active", 0x011F: "Fault reaction active", 0x0108: "Fault",
    },
    samples=(  # controlword, target | statusword, position, current | speed
        Sample(0.0, 0.0, "0F 00 00 00 00 00", ("37 01 00 00 00 00 00 00", "00 00 00 00"), 0.0, 0.0, None),
        Sample(
            3.141592653589793, 0.0, "3F 00 E8 03 00 00",  # half a turn: new set-point, change at once
            ("37 11 01 00 00 00 18 FC", "1E 00 00 00"), 0.0031415926535897933, 3.141592653589793, None,
        ),
    ),
    written=(
        "23 16 10 01 2C 01 7F 00", "2B 17 10 00 64 00", "2F 60 60 00 01", "2B 07 60 00 03 00",
        "23 81 60 00 58 02 00 00",  # 20 pi rad/s: 600 rpm
        "23 83 60 00 70 17 00 00",  # 200 pi rad/s^2: 6000 rpm/s
        "23 84 60 00 70 17 00 00",
        "23 00 16 01 10 00 40 60", "23 00 16 02 20 00 7A 60", "2F 00 16 00 02",
        "23 00 1A 01 10 00 41 60", "23 00 1A 02 20 00 64 60", "23 00 1A 03 10 00 78 60", "2F 00 1A 00 03",
    ),
    wrong={"40 18 10 02": "43 18 10 02 00 00 21 63"},
)  # fmt: skip
