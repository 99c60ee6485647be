"""The tool against drives made of literal frames: what a wrong fact in a profile cannot pass."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from golden_arms import SCHUNK_ERB, ZEROERR_EROB
from golden_drive import Golden, GoldenDrive, Row, connected, sdo
from golden_elmo import ELMO_GOLD
from golden_files import FOLDERS, told_by_the_file
from golden_maxon import EPOS2, EPOS4
from golden_others import BENCH, FAULHABER_CC, GENERIC, SIMCO, TRINAMIC

from schwung.commissioning import ExportChoice, export_values
from schwung.drivetrain import InertiaTable
from schwung.errors import InputError, SdoError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen import pdo, playback
from schwung.fieldbus.canopen.scan import fitting_profiles
from schwung.fieldbus.drive import Acquisition, Move, OperatingMode, ParameterValue, Setpoints
from schwung.fieldbus.eds import read_eds
from schwung.fieldbus.profile import CanopenProfile, list_profiles, load_canopen_profile

ALL = (EPOS4, EPOS2, ELMO_GOLD, SCHUNK_ERB, ZEROERR_EROB, TRINAMIC, SIMCO, FAULHABER_CC, GENERIC, BENCH)
MOVING = [golden for golden in ALL if golden.mode]
RATE_HZ = 1000.0
#: Scales are compared with decimal literals of 16 digits.
EXACT = 1e-12


def family(golden: Golden) -> str:
    return golden.family


def acquisition(golden: Golden) -> Acquisition:
    """One sample per ms, heartbeats every 100 ms; a stroke of 20 pi rad/s, 200 pi rad/s² where the drive shapes it."""
    if golden.mode == "pp":
        return Acquisition("pp", RATE_HZ, moves=(stroke(golden),))
    return Acquisition("csp", RATE_HZ)


def stroke(golden: Golden) -> Move:
    return Move(2, golden.samples[-1].position_demand_rad, 20 * math.pi, 200 * math.pi)


def in_state(golden: Golden, word: int) -> list[Row]:
    """Its rows, with another statusword."""
    row = Row("40 41 60 00", f"4B 41 60 00 {word & 0xFF:02X} {word >> 8:02X}", word, "states")
    return [row, *(other for other in golden.rows if other.request != row.request)]


def told(value: float | None) -> float:
    """What the tool shall know: NaN where the manual does not tell."""
    return math.nan if value is None else value


def test_every_canopen_family_has_its_golden_drive() -> None:
    assert {g.family for g in ALL} == {p.family for p in list_profiles() if isinstance(p, CanopenProfile)}


@pytest.mark.parametrize("golden", ALL, ids=family)
def test_the_tool_connects_and_knows_whom(golden: Golden) -> None:
    told_by = {row.request: row.value for row in golden.rows}
    with connected(GoldenDrive(golden.rows), load_canopen_profile(golden.family)) as drive:
        assert drive.identity.vendor_id == told_by["40 18 10 01"]
        assert drive.identity.product_code == told_by.get("40 18 10 02", 0)
        fitting = [profile.family for profile in fitting_profiles(drive.identity)]
    assert (golden.family in fitting) == golden.identified


@pytest.mark.parametrize("golden", ALL, ids=family)
def test_the_tool_reads_what_the_frames_say(golden: Golden) -> None:
    with connected(GoldenDrive(golden.rows), load_canopen_profile(golden.family)) as drive:
        for row in golden.rows:
            request = sdo(row.request)
            index, subindex = int.from_bytes(request[1:3], "little"), request[3]
            try:
                parameter = drive.parameter(index, subindex)
            except InputError:
                continue  # not in our dictionary: a fact that the tool does not use
            assert drive.read(parameter).raw == row.value, f"{parameter.label}: {row.source}"


@pytest.mark.parametrize("golden", [g for g in ALL if g.family in FOLDERS], ids=family)
def test_the_manufacturers_file_says_what_we_say_that_it_does(golden: Golden) -> None:
    """Type of every object, and every value whose source is a default or a ParameterValue of that file."""
    told_there = told_by_the_file(golden.family)
    size_of = {0x4F: 1, 0x4B: 2, 0x43: 4}
    for row in golden.rows:
        request, answer = sdo(row.request), sdo(row.answer)
        entry = told_there.get((int.from_bytes(request[1:3], "little"), request[3]))
        if entry is None:
            continue
        assert size_of[answer[0]] == entry.size, row
        if "ParameterValue" in row.source:
            assert row.value == entry.configured, row
        elif "default" in row.source.lower():
            assert row.value == entry.default, row


@pytest.mark.parametrize("golden", ALL, ids=family)
def test_units_are_those_of_the_manual(golden: Golden) -> None:
    with connected(GoldenDrive(golden.rows), load_canopen_profile(golden.family)) as drive:
        scales, wanted = drive.scales, golden.scale
        assert scales.torque_added_nm == pytest.approx(told(wanted.torque_nm), rel=EXACT, nan_ok=True)
        for name in ("position_rad", "speed_rad_s", "torque_nm", "acceleration_rad_s2"):
            value = told(getattr(wanted, name))
            assert getattr(scales, name) == pytest.approx(value, rel=EXACT, nan_ok=True), (
                f"{name}: {wanted.source}"
            )
        for rated in (scales.rated_torque_nm, drive.limits().rated_torque_nm):
            assert told(rated) == pytest.approx(told(wanted.rated_torque_nm), rel=EXACT, nan_ok=True), (
                wanted.source
            )


@pytest.mark.parametrize("golden", ALL, ids=family)
def test_statuswords_and_position_are_understood(golden: Golden) -> None:
    counts = next(row.value for row in golden.rows if row.request == "40 64 60 00")
    for word, name in golden.states.items():
        bench = GoldenDrive(in_state(golden, word))
        with connected(bench, load_canopen_profile(golden.family)) as drive:
            state = drive.state()
            assert state.cia402 == name, hex(word)
            assert state.position_rad == pytest.approx(counts * told(golden.scale.position_rad), rel=EXACT)
            assert cia402.decode(word).value == name


@pytest.mark.parametrize(
    ("golden", "request_", "answer"),
    [(golden, *pair) for golden in ALL for pair in golden.wrong.items()],
    ids=lambda x: x.family if isinstance(x, Golden) else None,
)
def test_a_drive_that_says_otherwise_is_refused(golden: Golden, request_: str, answer: str) -> None:
    rows = [replace(row, answer=answer) if row.request == request_ else row for row in golden.rows]
    assert rows != list(golden.rows)
    with (
        pytest.raises(InputError),
        connected(GoldenDrive(rows), load_canopen_profile(golden.family)) as drive,
    ):
        assert drive.scales.position_rad  # the profile may only find out when it asks for units


@pytest.mark.parametrize("golden", [g for g in MOVING if g.written], ids=family)
def test_setting_up_writes_these_frames(golden: Golden) -> None:
    off = next(word for word, name in golden.states.items() if name == "Switch on disabled")
    bench = GoldenDrive(in_state(golden, off))
    with connected(bench, load_canopen_profile(golden.family)) as drive:
        drive.write(drive.setup(acquisition(golden)))
        assert drive.setup(acquisition(golden)) == []
    wanted = [sdo(text) for text in golden.written]
    assert [frame.hex(" ") for frame in wanted if frame not in bench.downloads] == []
    stops = [frame for frame in bench.downloads if frame[1:3] in (b"\x5a\x60", b"\x5e\x60", b"\x07\x60")]
    assert [frame.hex(" ") for frame in stops if frame not in wanted] == []


@pytest.mark.parametrize("golden", MOVING, ids=family)
def test_modes_are_chosen_by_these_frames(golden: Golden) -> None:
    off = next(word for word, name in golden.states.items() if name == "Switch on disabled")
    rows = [row for row in in_state(golden, off) if row.request != "40 60 60 00"]
    rows.append(Row("40 60 60 00", "4F 60 60 00 00", 0, "CiA 402-2: no mode"))
    modes: tuple[OperatingMode, ...] = ("csp", "pp")
    for mode, frame in zip(modes, golden.modes, strict=True):
        bench = GoldenDrive(rows)
        with connected(bench, load_canopen_profile(golden.family)) as drive:
            if frame:
                drive.write(drive.setup(Acquisition(mode, RATE_HZ)))
                assert sdo(frame) in bench.downloads
            else:
                with pytest.raises(InputError, match=f'has no "{mode}"'):
                    drive.setup(Acquisition(mode, RATE_HZ))


@pytest.mark.parametrize(
    "golden", [g for g in ALL if any(r.request == "40 10 10 01" for r in g.rows)], ids=family
)
def test_saving_is_the_word_save(golden: Golden) -> None:
    """CiA 301, 7.5.2.13: 65766173h, which is "save" in the order of the bytes."""
    bench = GoldenDrive(golden.rows)
    with connected(bench, load_canopen_profile(golden.family)) as drive:
        drive.store()
    assert bench.downloads == [bytes.fromhex("23 10 10 01 73 61 76 65")]


def test_a_value_that_the_drive_does_not_know_is_named() -> None:
    """605A of an EPOS4 takes 6 only, others abort with 06090030 (Imcab/EposLib, signals/Enums.hpp, table 6-149)."""
    refused = Row("2B 5A 60 00 02 00", "80 5A 60 00 30 00 09 06", 2, "table 6-149")
    with connected(GoldenDrive([*EPOS4.rows, refused]), load_canopen_profile(EPOS4.family)) as drive:
        with pytest.raises(SdoError, match="value out of range"):
            drive.write([ParameterValue(drive.parameter(0x605A), 2)])
        assert drive.read(drive.parameter(0x605A)).raw == 6


@pytest.mark.parametrize("golden", MOVING, ids=family)
def test_frames_and_si_values_match_both_ways(golden: Golden) -> None:
    profile = load_canopen_profile(golden.family)
    eds = read_eds(profile.eds_path, 1)
    layouts = pdo.layouts(profile, eds.find, 1)
    with connected(GoldenDrive(golden.rows), profile) as drive:
        scales = drive.scales
    q, last = profile.quantities, golden.samples[-1]
    moves = (stroke(golden),) if golden.mode == "pp" else ()
    count = 60 if moves else len(golden.samples)
    played = [last] * count if moves else golden.samples
    setpoints = Setpoints(
        RATE_HZ,
        np.array([s.position_demand_rad for s in played]),
        np.array([s.torque_added_nm for s in played]),
        moves,
    )
    mode = acquisition(golden).mode
    packed = playback.pack(setpoints, mode, profile, layouts.rpdo, scales, 0).frames
    for number, sample in enumerate(golden.samples):
        if number or not moves:  # a stroke's target goes ahead of its bit
            assert bytes.fromhex(sample.rpdo) == packed[2 if sample is last and moves else number]
        fields = {}
        for layout, text in zip(layouts.tpdos, sample.tpdos, strict=True):
            frame = bytes.fromhex(text)
            assert len(frame) == layout.size
            record = layout.unpack([frame])
            fields.update({name: float(record[name][0]) for name in layout.dtype.names or ()})
        for quantity, scale, wanted in (
            (q.position, scales.position_rad, sample.position_rad),
            (q.speed, scales.speed_rad_s, sample.speed_rad_s),
            (q.torque, scales.torque_nm, sample.torque_nm),
        ):
            assert quantity is not None
            value = fields[str(quantity.object)] * scale
            assert value == pytest.approx(told(wanted), rel=EXACT, nan_ok=True), str(quantity.object)


@pytest.mark.parametrize("golden", MOVING, ids=family)
def test_a_motion_is_played_and_recorded_frame_by_frame(golden: Golden) -> None:
    """Start, enable, play, disable, stop: the tool's whole way, on a bus that carries literal frames only."""
    first, last = golden.samples[0], golden.samples[-1]
    off = next(word for word, name in golden.states.items() if name == "Switch on disabled")
    stands = Row("40 64 60 00", "43 64 60 00", 0, "samples: where it stands before")
    rows = [row for row in in_state(golden, off) if row.request != stands.request]
    bench = GoldenDrive([stands, *rows], golden.samples, golden.states)
    plan = acquisition(golden)
    count = 60 if plan.moves else len(golden.samples)
    played = [first, first] + [last] * (count - 2) if plan.moves else list(golden.samples)
    demand = np.array([s.position_demand_rad for s in played])
    setpoints = Setpoints(RATE_HZ, demand, np.array([s.torque_added_nm for s in played]), plan.moves)
    with connected(bench, load_canopen_profile(golden.family)) as drive:
        drive.write(drive.setup(plan))
        drive.start(plan)
        drive.enable()
        recording = drive.play(setpoints)
        drive.disable()
        drive.stop()
    assert recording.lost.size == 0
    for number, sample in [(2, last)] if plan.moves else enumerate(golden.samples):
        assert bytes.fromhex(sample.rpdo) in bench.rpdos
        assert recording.statusword[number] == int.from_bytes(bytes.fromhex(sample.tpdos[0])[:2], "little")
        for name in ("position_rad", "speed_rad_s", "torque_nm"):
            value = getattr(recording, name)[number]
            assert value == pytest.approx(told(getattr(sample, name)), rel=EXACT, nan_ok=True), name
    assert bench.rpdos[-1][:2] == b"\x00\x00"


def test_the_epos4_takes_an_inertia_as_current_per_acceleration() -> None:
    """J / Kt in A s²/rad (Imcab/EposLib, Control loops, after Firmware Specification 6.2.62); 5554 µA s²/rad times
    0.107746 N m/A (the DCF's 3001:05) are 5.98421284e-4 kg m² of motor and load together."""
    bench = GoldenDrive(EPOS4.rows)
    load = InertiaTable(np.array([0.0, 6.0]), np.full(2, 4.98421284e-4))
    profile = load_canopen_profile(EPOS4.family)
    with connected(bench, profile) as drive:
        mean = ExportChoice("mean")
        drive.write(
            export_values(drive.parameter, profile, load, mean, read=drive.read, motor_inertia_kgm2=1e-4)
        )
    assert bench.downloads == [bytes.fromhex("23 A1 30 05 B2 15 00 00")]
