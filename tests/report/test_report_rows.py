"""Nested JSON as rows that people read."""

from dataclasses import replace

from report_samples import bare, session

from schwung.report.html import render
from schwung.report.rows import rows_of


def test_names_carry_their_units_and_identities_are_hexadecimal() -> None:
    rows = dict(
        rows_of(
            {
                "identity": {"vendor_id": 0x53574E47, "serial": 7, "name": "servo"},
                "units": {"speed_rad_s": 1e-4},
                "motor": {"inertia_kgm2": 0.012, "viscous_friction_nms": 0.2},
                "coupling": {"stiffness_nm_rad": 24963.0},
                "control": {
                    "position_gain_per_s": 40.0,
                    "sample_rate_hz": 8000.0,
                    "speed_integral_time_s": 0.1,
                },
                "known": True,
                "nothing": None,
                "none": [],
            }
        )
    )
    assert rows == {
        "identity vendor id": "0x53574E47",
        "identity serial": "7",
        "identity name": "servo",
        "one count of speed, rad/s": "0.0001",
        "motor inertia, kg·m²": "0.012",
        "motor viscous friction, N·m·s/rad": "0.2",
        "coupling stiffness, N·m/rad": "24963",
        "control position gain, 1/s": "40",
        "control sample rate, Hz": "8000",
        "control speed integral time, s": "0.1",
        "known": "yes",
    }


def test_a_linear_axis_has_its_own_units() -> None:
    rows = list(rows_of({"inertia_kgm2": 3.0, "stiffness_nm_rad": 2.0, "speed_rad_s": 1.0}, linear=True))
    assert [label for label, _ in rows] == ["inertia, kg", "stiffness, N/m", "speed, m/s"]


def test_settings_and_drive_say_nothing_twice() -> None:
    drive = {
        "identity": {"serial": 4711},
        "settings": {"limits": {"torque_max_nm": 12.5}, "reasons": ["because of the paper"]},
    }
    page = render(replace(bare(), session=replace(session(), drive=drive)))
    assert page.count(">4711<") == 1
    assert page.count("limits torque max, N·m") == 1
    assert page.index("<h2>Settings") < page.index("limits torque max") < page.index("<h2>Drive")
    assert "because of the paper" not in page  # it is among the plan's notes
    assert "Lost samples" not in page
