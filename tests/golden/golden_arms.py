"""Modules of robot arms: SCHUNK ERB and PRL, ZeroErr eRob. Both count at the output, behind their gear."""

from golden_drive import Golden, Row, Sample, Scale

_ROS = "ros-industrial/ros_canopen, canopen_motor_node/src/handle_layer.cpp, commit 1de23dc1"
_DCF = "ipa320/cob_robots, cob_hardware_config/robots/common/Schunk_0_63.dcf, commit cc76524d"
_STANDARD = "CiA 402-2, table of the statusword"
_STATES = {
    0x0240: "Switch on disabled", 0x0231: "Ready to switch on", 0x0233: "Switched on", 0x0237: "Operation enabled",
    0x0217: "Quick stop active", 0x021F: "Fault reaction active", 0x0218: "Fault",
}  # fmt: skip

SCHUNK_ERB = Golden(
    family="schunk-erb",
    mode="pp",
    modes=("", "2F 60 60 00 01"),
    identified=False,
    rows=(
        Row("40 18 10 01", "43 18 10 01 00 00 00 00", 0, f"{_DCF} tells no vendor: any is taken"),
        Row("40 41 60 00", "4B 41 60 00 37 02", 0x0237, _STANDARD),
        Row("40 64 60 00", "43 64 60 00 90 5F 01 00", 90000, f"{_ROS}: deg2rad(obj6064)/1000: 90 degrees"),
        Row("40 6C 60 00", "43 6C 60 00 C8 AF 00 00", 45000, f"{_ROS}: deg2rad(obj606C)/1000: 45 degrees per second"),
        Row("40 60 60 00", "4F 60 60 00 07", 7, f"{_DCF}: interpolated position"),
        Row("40 02 65 00", "43 02 65 00 43 00 00 00", 0x43, f"{_DCF}: default of 6502: pp, vl, ip"),
        Row("40 81 60 00", "43 81 60 00 00 00 00 00", 0, f"{_DCF}: 6081 is there"),
        Row("40 83 60 00", "43 83 60 00 00 00 00 00", 0, f"{_DCF}: 6083 is there"),
        Row("40 16 10 00", "4F 16 10 00 01", 1, "CiA 301, 7.5.2.19"),
        Row("40 16 10 01", "43 16 10 01 00 00 00 00", 0, f"{_DCF}: default"),
        Row("40 17 10 00", "4B 17 10 00 00 00", 0, f"{_DCF}: default"),
        Row("40 00 14 01", "43 00 14 01 01 02 00 00", 0x00000201, f"{_DCF}: default"),
        Row("40 00 18 01", "43 00 18 01 81 01 00 00", 0x00000181, f"{_DCF}: default"),
        Row("40 01 18 01", "43 01 18 01 81 02 00 00", 0x00000281, f"{_DCF}: default"),
    ),
    scale=Scale(
        position_rad=1.7453292519943296e-05,  # 1 millidegree
        speed_rad_s=1.7453292519943296e-05,
        torque_nm=None,  # ros_canopen has no unit for it either: e2r is 0
        acceleration_rad_s2=1.7453292519943296e-05,
        rated_torque_nm=None,
        source=_ROS,
    ),
    states=_STATES,
    samples=(
        Sample(0.0, 0.0, "0F 00 00 00 00 00 00 00", ("37 02 00 00 00 00 00 00", "00 00 00 00"), 0.0, 0.0, None),
        Sample(
            1.5707963267948966, 0.0, "3F 00 90 5F 01 00 00 00",  # 90 degrees: rint(rad2deg(pos)*1000)
            ("37 12 01 00 00 00 07 00", "C8 AF 00 00"), 1.7453292519943296e-05, 0.7853981633974483, None,
        ),
    ),
    written=(
        "23 16 10 01 2C 01 7F 00", "2B 17 10 00 64 00", "2F 60 60 00 01",
        "23 81 60 00 80 EE 36 00",  # 20 pi rad/s: 3 600 000 millidegrees per second
        "23 00 16 02 20 00 7A 60",
    ),
)  # fmt: skip

_EROB = "ZeroErrControl/eRob_CANopen_Python, eRobControl_PP.py, commit 02418508"
_EDS = "ZeroErrControl/eRob_CANopen_Python, ZeroErr Driver_V1.5.eds, commit fa2f480b"

ZEROERR_EROB = Golden(
    family="zeroerr-erob",
    rows=(
        Row("40 18 10 01", "43 18 10 01 6F 72 65 5A", 0x5A65726F, f'{_EDS}: "Zero", high byte first'),
        Row("40 18 10 02", "43 18 10 02 52 30 48 26", 0x26483052, f"{_EDS}: default of 1018:02"),
        Row("40 41 60 00", "4B 41 60 00 37 06", 0x0637, f"{_EROB}: bit 10 is target reached; {_STANDARD}"),
        Row("40 64 60 00", "43 64 60 00 00 00 02 00", 131072, f"{_EROB}: position_to_angle, 524288 a turn: 90 degrees"),
        Row("40 6C 60 00", "43 6C 60 00 00 00 08 00", 524288, f"{_EROB}: velocity_to_pulse: 60 rpm"),
        Row("40 5E 60 00", "4B 5E 60 00 02 00", 2, f"{_EDS}: default"),
        Row("40 10 10 01", "43 10 10 01 01 00 00 00", 1, "CiA 301, 7.5.2.13: bit 0, saves on command"),
        Row("40 60 60 00", "4F 60 60 00 01", 1, f"{_EROB}: profile position"),
        Row("40 02 65 00", "43 02 65 00 8D 03 00 00", 909, f"{_EDS}: default of 6502: pp, pv, tq, csp, csv, cst"),
        Row("40 06 10 00", "43 06 10 00 E8 03 00 00", 1000, f"{_EROB}: communication cycle of 1000 us"),
        Row("40 16 10 00", "4F 16 10 00 01", 1, "CiA 301, 7.5.2.19"),
        Row("40 16 10 01", "43 16 10 01 00 00 00 00", 0, f"{_EDS}: default"),
        Row("40 17 10 00", "4B 17 10 00 00 00", 0, f"{_EDS}: default"),
        Row("40 C2 60 01", "4F C2 60 01 02", 2, "CiA 402-2, 60C2; composed"),
        Row("40 C2 60 02", "4F C2 60 02 FD", -3, "CiA 402-2, 60C2; composed"),
        Row("40 00 14 01", "43 00 14 01 01 02 00 00", 0x00000201, f"{_EROB}: 0x200 + node"),
        Row("40 00 18 01", "43 00 18 01 81 01 00 00", 0x00000181, f"{_EROB}: 0x180 + node"),
        Row("40 01 18 01", "43 01 18 01 81 02 00 80", 0x80000281, f"{_EDS}: default: off"),
    ),
    scale=Scale(
        position_rad=1.1984224905356571e-05,  # 2 pi / 524288
        speed_rad_s=1.1984224905356571e-05,  # one count per second
        torque_nm=None,
        acceleration_rad_s2=1.1984224905356571e-05,
        rated_torque_nm=None,
        source=f"{_EROB}: encoder_resolution=524288; velocity_to_pulse, acceleration_to_pulse",
    ),
    states=_STATES,
    samples=(
        Sample(0.0, 0.0, "0F 00 00 00 00 00 00 00", ("37 12 00 00 00 00 00 00", "00 00 00 00"), 0.0, 0.0, None),
        Sample(
            0.0030679615757712823, 0.0, "0F 00 00 01 00 00 00 00",  # 256 counts
            ("37 12 80 00 00 00 2A 00", "00 00 04 00"), 0.0015339807878856412, 3.141592653589793, None,
        ),
    ),
    written=(
        "23 16 10 01 2C 01 7F 00", "2B 17 10 00 64 00", "2F 60 60 00 08", "2F C2 60 01 01",
        "23 00 18 01 81 01 00 80", "2F 00 1A 00 00", "23 00 1A 01 10 00 41 60", "23 00 1A 02 20 00 64 60",  # as _EROB
        "23 00 14 01 01 02 00 80", "2F 00 16 00 00", "23 00 16 01 10 00 40 60", "23 00 16 02 20 00 7A 60",  # as _EROB
        "23 00 14 01 01 02 00 00", "23 00 18 01 81 01 00 00", "23 01 18 01 81 02 00 00",
    ),
    wrong={"40 18 10 02": "43 18 10 02 52 30 48 27"},
)  # fmt: skip
