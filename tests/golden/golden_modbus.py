"""The Modbus families, frame by frame: Delta ASDA-A2, Schneider Lexium 32, Kollmorgen AKD, and our own bench drive."""

from collections.abc import Mapping
from dataclasses import dataclass

from golden_registers import Exchange


@dataclass(frozen=True)
class GoldenModbus:
    """A family by its manual. Scales in SI per count; None: nobody tells."""

    family: str
    tcp: bool
    read: tuple[Exchange, ...]
    written: tuple[Exchange, ...]
    position_rad: float | None
    speed_rad_s: float | None
    torque_nm: float | None
    state: str
    stands_rad: float | None
    places: Mapping[str, int]  # parts of the profile, and the register that each must be


_ASDA = "ASDA-A2 user manual, February 2017"
_BY_RULE = f"composed: Pg-nn is at 256 g + 2 nn ({_ASDA}, page 9-5: P3-02 is 0304H)"

DELTA = GoldenModbus(
    family="delta-asda-a2",
    tcp=False,
    read=(
        Exchange("01 03 02 00 00 02 C5 B3", "01 03 04 00 B1 1F 40 A3 D4", 0x0200, 0x1F4000B1,
                 f"{_ASDA}, page 9-10 (manualslib.com/manual/2698321, page 555)"),
        Exchange("01 03 00 12 00 02 64 0E", "01 03 04 D4 C0 FF FE 03 8F", 0x0012, -76608, f"{_BY_RULE}: P0-09"),
        Exchange("01 03 01 5A 00 02 E5 E4", "01 03 04 00 0A 00 00 DA 31", 0x015A, 10, f"{_ASDA}, page 6-13: P1-45"),
        Exchange("01 03 03 04 00 02 85 8E", "01 03 04 00 06 00 00 1A 32", 0x0304, 6, f"{_ASDA}, page 9-5: RTU"),
    ),
    written=(
        Exchange("01 10 01 12 00 02 04 0B B8 00 00 FC EB", "01 10 01 12 00 02 E0 31", 0x0112, 3000,
                 f"{_ASDA}, page 9-13 (manualslib.com/manual/2698321, page 558)"),
    ),
    position_rad=None,
    speed_rad_s=None,
    torque_nm=None,
    state="unknown",
    stands_rad=None,
    places={"quantities.position.object": 0x0012},  # P0-09
)  # fmt: skip

_LXM = "LXM32M Modbus-TCP module, 0198441113843, V1.01, 01.2012 (manualsdump.com, schneider_electric-lxm32m/198938)"
_LXM_DRIVER = "a public Python driver (pyModbusTCP, table r_add)"

LEXIUM = GoldenModbus(
    family="schneider-lexium-32",
    tcp=True,
    read=(
        Exchange("03 12 06 00 02", "03 04 00 00 00 C8", 4614, 200, f"{_LXM}, page 21: CTRL1_KPp, 0000h, 00C8h"),
        Exchange("03 1E 1A 00 02", "03 04 00 00 20 00", 7706, 8192, f"{_LXM}, page 24: _p_act; composed"),
        Exchange("03 06 0E 00 02", "03 04 00 00 40 00", 1550, 16384, f"{_LXM_DRIVER}: ScalePOSdenom, STEP_REV"),
        Exchange("03 1B 04 00 02", "03 04 00 00 82 37", 6916, 0x8237, f"{_LXM_DRIVER}: bit 15 is ref_ok"),
        Exchange("03 3C 02 00 02", "03 04 00 00 E2 00", 15362, 0xE200, f"{_LXM}, page 33: _ERR_number; composed"),
    ),
    written=(
        Exchange("10 1B 02 00 02 04 00 00 00 0F", "10 1B 02 00 02", 6914, 15, f"{_LXM_DRIVER}: DCOMcontrol, [0, 15]"),
        Exchange("10 06 08 00 02 04 FF FE 79 60", "10 06 08 00 02", 1544, -100000, f"{_LXM}, page 33: 1544 (608h)"),
    ),
    position_rad=0.0003834951969714103,  # 2 pi / 16384
    speed_rad_s=None,
    torque_nm=None,
    state="Operation enabled",
    stands_rad=3.141592653589793,
    places={
        "quantities.position.object": 7706, "quantities.position.resolution": 1550, "quantities.speed.object": 7744,
        "state.controlword": 6914, "state.statusword": 6916,
    },
)  # fmt: skip

_AKD = "AKD BASIC user guide, March 2012 (easymanua.ls/kollmorgen/akd-basic)"
_NETWORK = (
    "kollmorgen.com/en-us/developer-network, Reading of AKD axes position by Python, comment of 2 April 2021"
)
_POUT = "AKD user guide, May 2014, pages 880 and 882 (manualslib.de/manual/230914)"

AKD = GoldenModbus(
    family="kollmorgen-akd",
    tcp=True,
    read=(
        Exchange("03 02 4C 00 04", "03 08 00 00 00 00 00 00 0D A7", 588, 3495,
                 f"{_POUT}: PL.FB is 36462 * 500000 / 5215189 = 3495; 588 and 64 bits: webhelp.kollmorgen.com/AKD"),
        Exchange("03 03 58 00 02", "03 04 FF FF FF 9C", 856, -100, f"{_AKD}, page 462: VL.FB, low 32-bit word, signed"),
        Exchange("03 03 D2 00 02", "03 04 00 00 00 14", 978, 20, f"{_POUT}: MODBUS.PSCALE, 20 as delivered"),
    ),
    written=(
        Exchange("10 00 E6 00 04 08 00 00 00 00 00 0F 42 40", "10 00 E6 00 04", 230, 1000000,
                 f"{_NETWORK}: DRV.DEC as [0, 0, 15, 16960]"),
    ),
    position_rad=None,
    speed_rad_s=None,
    torque_nm=None,
    state="unknown",
    stands_rad=None,
    places={"quantities.position.object": 588, "quantities.speed.object": 856},
)  # fmt: skip

_BENCH = "the drive is ours: 2^20 counts a turn, 0.001 rpm, 0.01 N m, high word first"

BENCH = GoldenModbus(
    family="schwung-bench-modbus",
    tcp=True,
    read=(
        Exchange("03 00 00 00 02", "03 04 53 57 4E 47", 0, 0x53574E47, f'{_BENCH}; "SWNG"'),
        Exchange("03 00 02 00 02", "03 04 00 00 4D 42", 2, 0x4D42, f'{_BENCH}; "MB"'),
        Exchange("03 00 04 00 02", "03 04 00 00 00 07", 4, 7, f"{_BENCH}; serial number"),
        Exchange("03 00 C8 00 02", "03 04 FF FC 00 00", 200, -262144, f"{_BENCH}; a quarter of a turn back"),
        Exchange("03 00 66 00 02", "03 04 00 00 02 40", 102, 0x0240, "CiA 402-2, table of the statusword"),
        Exchange("03 00 6A 00 02", "03 04 00 00 00 00", 106, 0, "CiA 402-2, 603F: no error"),
    ),
    written=(
        Exchange("10 00 D2 00 02 04 00 04 00 00", "10 00 D2 00 02", 210, 262144, _BENCH),
        Exchange("10 00 70 00 02 04 65 76 61 73", "10 00 70 00 02", 112, 0x65766173, 'CiA 301, 7.5.2.13: "save"'),
    ),
    position_rad=5.992112452678286e-06,
    speed_rad_s=0.00010471975511965977,
    torque_nm=0.01,
    state="Switch on disabled",
    stands_rad=-1.5707963267948966,
    places={
        "state.controlword": 100, "state.statusword": 102, "state.mode": 104, "state.error": 106,
        "quantities.position.object": 200, "quantities.position.demand": 210, "quantities.speed.object": 202,
        "quantities.torque.object": 204, "watchdog.object": 110, "store.object": 112,
    },
)  # fmt: skip
