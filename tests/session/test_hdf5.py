"""The session file: what is written comes back, what is wrong is named, a crash loses nothing recorded."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from schwung.errors import InputError, SchwungError
from schwung.motion import Excitation, Motion
from schwung.session import PartialRun, Run, SessionWriter, read_session
from schwung.session.imports import motion_identity

RATE = 1000.0
MOTION = Motion(distance_rad=3.0, duration_s=0.25)
SINE = Excitation(frequency_hz=50.0, amplitude_nm=40.0, ramp_s=0.05, end_s=0.6)


def make_run(role="reference", repeat=0, n=200, **extra):
    rng = np.random.default_rng(repeat)
    return Run(
        role=role,
        repeat=repeat,
        sample_rate_hz=RATE,
        time_s=np.arange(n) / RATE,
        position_rad=rng.normal(size=n),
        speed_rad_s=rng.normal(size=n),
        torque_nm=rng.normal(size=n),
        position_demand_rad=rng.normal(size=n),
        motion=MOTION,
        excitation=SINE if role == "excited" else None,
        **extra,
    )


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "session.h5"
    with SessionWriter(file, source="test", drive={"node": 3, "name": "Antrieb Ä"}) as writer:
        writer.append(make_run())
        writer.append(make_run("excited"))
    return file


def test_everything_written_comes_back(tmp_path):
    extra = {"sync": {"p99_s": 1e-4}, "count": 7, "note": "[not json", "statusword": np.arange(5)}
    run = make_run("excited", repeat=2, extra=extra)
    with SessionWriter(tmp_path / "a.h5", source="bench", drive={"node": 3}, axis="linear") as writer:
        writer.append(run)
    session = read_session(tmp_path / "a.h5")
    assert (session.source, session.axis, session.drive) == ("bench", "linear", {"node": 3})
    (back,) = session.runs
    assert (back.role, back.repeat, back.sample_rate_hz) == ("excited", 2, RATE)
    assert back.motion == MOTION
    assert back.excitation == SINE
    for name, values in run.datasets().items():
        np.testing.assert_array_equal(back.datasets()[name], values)
    assert back.torque_added_nm is None
    np.testing.assert_array_equal(back.extra["statusword"], np.arange(5))
    assert {k: v for k, v in back.extra.items() if k != "statusword"} == {
        "sync": {"p99_s": 1e-4}, "count": 7, "note": "[not json"}  # fmt: skip


def test_layout_is_the_contract(path):
    """Names, attributes and units exactly as files.md fixes them, seen with h5py alone."""
    with h5py.File(path) as file:
        assert file.attrs["format"] == "schwung-session"
        assert file.attrs["version"] == 1
        assert json.loads(file.attrs["drive"])["name"] == "Antrieb Ä"
        assert list(file["run"]) == ["0000", "0001"]
        group = file["run/0001"]
        assert json.loads(group.attrs["excitation"])["frequency_hz"] == 50
        assert json.loads(group.attrs["motion"])["kind"] == "third"
        units = {name: item.attrs["unit"] for name, item in group.items()}
        assert units.pop("position_demand") == "rad"
        assert units == {"time": "s", "position": "rad", "speed": "rad/s", "torque": "N·m"}
        assert all(item.dtype == np.float64 and item.ndim == 1 for item in group.values())


def test_linear_units(tmp_path):
    with SessionWriter(tmp_path / "a.h5", source="t", axis="linear") as writer:
        writer.append(make_run())
    with h5py.File(tmp_path / "a.h5") as file:
        units = {name: item.attrs["unit"] for name, item in file["run/0000"].items()}
    assert units == {"time": "s", "position": "m", "position_demand": "m", "speed": "m/s", "torque": "N"}


def _attr(where, name, value):
    def spoil(file):
        file[where].attrs[name] = value

    return spoil


def _drop(where):
    def spoil(file):
        del file[where]

    return spoil


def _sample(where, index, value):
    def spoil(file):
        file[where][index] = value

    return spoil


def _replace(where, data, unit):
    def spoil(file):
        del file[where]
        file.create_dataset(where, data=data).attrs["unit"] = unit

    return spoil


def _no_attr(where, name):
    def spoil(file):
        del file[where].attrs[name]

    return spoil


SPOILED = {
    "version": (_attr("/", "version", 2), "version"),
    "version text": (_attr("/", "version", "one"), "version"),
    "format": (_attr("/", "format", "csv"), "format"),
    "created": (_attr("/", "created", "yesterday"), "created"),
    "no source": (_no_attr("/", "source"), "source"),
    "axis": (_attr("/", "axis", "spherical"), "axis"),
    "drive": (_attr("/", "drive", "{no"), "drive"),
    "drive list": (_attr("/", "drive", "[]"), "drive"),
    "no runs": (_drop("run"), "/run"),
    "no torque": (_drop("run/0001/torque"), "/run/0001/torque"),
    "no role": (_no_attr("run/0001", "role"), "/run/0001@role"),
    "role": (_attr("run/0000", "role", "warm-up"), "/run/0000@role"),
    "repeat": (_attr("run/0000", "repeat", -1), "/run/0000@repeat"),
    "half repeat": (_attr("run/0000", "repeat", 0.5), "/run/0000@repeat"),
    "rate": (_attr("run/0000", "sample_rate_hz", np.nan), "sample_rate_hz"),
    "wrong rate": (_attr("run/0000", "sample_rate_hz", 999.0), "/run/0000/time"),
    "zero rate": (_attr("run/0000", "sample_rate_hz", 0.0), "sample_rate_hz"),
    "nan": (_sample("run/0001/speed", 17, np.nan), "/run/0001/speed: sample 17"),
    "inf": (_sample("run/0001/torque", 3, np.inf), "/run/0001/torque: sample 3"),
    "counts": (_sample("run/0001/position", 5, 4e9), "/run/0001/position: sample 5"),
    "time back": (_sample("run/0000/time", 9, 0.0), "/run/0000/time"),
    "time jitter": (_sample("run/0000/time", 9, 0.0091), "/run/0000/time"),
    "unit": (_attr("run/0000/position", "unit", "deg"), "/run/0000/position: unit"),
    "no unit": (_no_attr("run/0000/speed", "unit"), "/run/0000/speed: has no unit"),
    "length": (_replace("run/0000/speed", np.zeros(7), "rad/s"), "/run/0000/speed: has 7 samples"),
    "float32": (_replace("run/0000/speed", np.zeros(200, "f4"), "rad/s"), "/run/0000/speed: is float32"),
    "two dimensions": (_replace("run/0000/speed", np.zeros((200, 2)), "rad/s"), "/run/0000/speed"),
    "motion": (
        _attr("run/0000", "motion", '{"kind":"third","distance_rad":1,"duration_s":-1}'),
        "duration_s",
    ),
    "motion kind": (_attr("run/0000", "motion", '{"kind":3,"distance_rad":1,"duration_s":1}'), "kind"),
    "motion text": (_attr("run/0000", "motion", "fast"), "/run/0000@motion"),
    "excitation": (_attr("run/0001", "excitation", '{"frequency_hz":0,"amplitude_nm":1}'), "frequency_hz"),
    "nyquist": (_attr("run/0001", "excitation", '{"frequency_hz":600,"amplitude_nm":1}'), "600 Hz"),
    "no excitation": (_no_attr("run/0001", "excitation"), "/run/0001"),
    "excited reference": (_attr("run/0001", "role", "reference"), "/run/0001@excitation"),
}


@pytest.mark.parametrize("case", SPOILED)
def test_a_broken_contract_is_named(path, case):
    spoil, said = SPOILED[case]
    with h5py.File(path, "r+") as file:
        spoil(file)
    with pytest.raises(InputError) as caught:
        read_session(path)
    assert said in str(caught.value)
    assert str(path) in caught.value.place
    assert caught.value.remedy


def test_what_later_versions_add_is_ignored(path):
    with h5py.File(path, "r+") as file:
        file.attrs["weather"] = "sunny"
        file["run/0000"].create_dataset("current", data=np.ones(3))
        file["run/0000"].create_group("spectra")
        file["run"].create_group("notes")
        file.create_group("analysis")
    session = read_session(path)
    assert len(session.runs) == 2
    assert session.extra["weather"] == "sunny"
    np.testing.assert_array_equal(session.runs[0].extra["current"], np.ones(3))


def test_a_motion_of_another_kind_is_kept_as_it_is(path, tmp_path):
    """files.md leaves the kinds open: the recording says how the axis moved, its commands are not needed for that."""
    told = {"kind": "trapezoid", "distance_rad": 1.0, "duration_s": 0.2}
    with h5py.File(path, "r+") as file:
        for name in ("0000", "0001"):
            file[f"run/{name}"].attrs["motion"] = json.dumps(told)
    session = read_session(path)
    assert [run.motion for run in session.runs] == [None, None]
    identities = {motion_identity(run) for run in session.runs}
    assert len(identities) == 2  # one of them has an injection
    with SessionWriter(tmp_path / "again.h5", source="t") as writer:
        writer.append(session.runs[0])
    with h5py.File(tmp_path / "again.h5") as file:
        assert json.loads(file["run/0000"].attrs["motion"]) == told
    assert motion_identity(read_session(tmp_path / "again.h5").runs[0]) in identities


def test_fixed_length_strings_and_big_endian_numbers_are_read(path):
    """As other HDF5 writers (MATLAB, LabVIEW) leave them."""
    with h5py.File(path, "r+") as file:
        file.attrs["source"] = np.bytes_(b"imported")
        speed = file["run/0000/speed"][()]
        _replace("run/0000/speed", speed.astype(">f8"), "rad/s")(file)
    session = read_session(path)
    assert session.source == "imported"
    np.testing.assert_array_equal(session.runs[0].speed_rad_s, speed)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.1, 0.3, 0.5, 0.8, 0.99])
def test_truncated_file(path, share):
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    with pytest.raises(InputError, match=r"truncated"):
        read_session(path)


def test_garbled_bytes_never_leak_a_library_error(path):
    """Whatever is garbled, the session is read or refused; h5py's own errors stay inside."""
    whole, rng, refused = path.read_bytes(), np.random.default_rng(1), 0
    for _ in range(60):
        spoiled = bytearray(whole)
        at = int(rng.integers(0, 4000))  # metadata lives at the front
        spoiled[at : at + 8] = rng.bytes(8)
        path.write_bytes(spoiled)
        try:
            read_session(path)
        except InputError:
            refused += 1
    assert refused > 5


def test_no_file(tmp_path):
    with pytest.raises(InputError, match="no such session"):
        read_session(tmp_path / "none.h5")
    with pytest.raises(InputError):
        read_session(tmp_path)


def test_existing_session_is_kept_unless_asked(path):
    before = path.read_bytes()
    with pytest.raises(InputError, match="exists already"):
        SessionWriter(path, source="again")
    assert path.read_bytes() == before
    with SessionWriter(path, source="again", overwrite=True):
        pass
    assert read_session(path).runs == ()


def test_unwritable_path(tmp_path):
    with (
        pytest.raises(InputError, match="cannot be written"),
        SessionWriter(tmp_path / "no" / "s.h5", source="t"),
    ):
        pass


def test_partial_recordings_are_no_runs(tmp_path):
    file = tmp_path / "s.h5"
    lost = np.array([0.0, np.nan, 2.0])
    partial = PartialRun("excited", 0, RATE, np.arange(3) / RATE, lost, lost, lost, excitation=SINE)
    with SessionWriter(file, source="t") as writer:
        writer.append(make_run())
        writer.append_partial(partial, "node 3 lost its heartbeat")
        writer.append(make_run("excited"))
    session = read_session(file)
    assert [run.role for run in session.runs] == ["reference", "excited"]
    assert session.partial_reasons == ("node 3 lost its heartbeat",)
    with h5py.File(file) as opened:
        np.testing.assert_array_equal(opened["partial/0000/speed"][()], lost)


def test_a_run_that_cannot_be_stored_leaves_no_trace(tmp_path):
    file = tmp_path / "s.h5"
    with SessionWriter(file, source="t") as writer:
        writer.append(make_run())
        with pytest.raises(ValueError, match="unserialisable"):
            writer.append(make_run(extra={"bad": _Unserialisable()}))
        writer.append(make_run(repeat=1))
    assert [run.repeat for run in read_session(file).runs] == [0, 1]


class _Unserialisable:
    def __str__(self):
        raise ValueError("unserialisable")


def test_disk_full_keeps_the_old_file(path, monkeypatch):
    file = path.with_name("other.h5")
    with SessionWriter(file, source="t") as writer:
        writer.append(make_run())

        def full(_handle):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(SchwungError, match="no space left"):
            writer.append(make_run(repeat=1))
        monkeypatch.undo()
        assert len(read_session(file).runs) == 1
        writer.append(make_run(repeat=2))
        assert len(read_session(file).runs) == 3, "the run that did not fit then is stored with the next"
    assert [entry.name for entry in path.parent.iterdir()].count("other.h5") == 1
    assert not list(path.parent.glob(".*"))


WRITER = """
import sys
sys.path.insert(0, {here!r})
from test_hdf5 import make_run
from schwung.session import SessionWriter
with SessionWriter({path!r}, source="doomed") as writer:
    for repeat in range(100_000):
        writer.append(make_run(repeat=repeat, n=20_000))
        print(repeat, flush=True)
"""


@pytest.mark.posix
@pytest.mark.parametrize("delay_s", [0.0, 0.003, 0.011])
def test_kill_9_leaves_every_run_that_append_returned(tmp_path, delay_s):
    """The writer appends without pause and is killed inside; what it had announced must be there."""
    path = tmp_path / "s.h5"
    script = WRITER.format(here=str(Path(__file__).parent), path=str(path))
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as process:
        announced = [int(process.stdout.readline()) for _ in range(3)]
        if delay_s:
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(delay_s)
        process.send_signal(signal.SIGKILL)
        announced += [int(line) for line in process.stdout if line.endswith("\n")]
    assert process.returncode == -signal.SIGKILL
    session = read_session(path)
    assert len(session.runs) >= len(announced) == announced[-1] + 1
    np.testing.assert_array_equal(session.runs[-1].speed_rad_s,
                                  make_run(repeat=len(session.runs) - 1, n=20_000).speed_rad_s)  # fmt: skip
