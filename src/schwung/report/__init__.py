"""What people read afterwards: one HTML file, and its pictures."""

from schwung.report.content import (
    ChangeRow,
    CheckRow,
    Deviation,
    FollowingError,
    ReportContent,
    SyncRow,
    deviation,
)
from schwung.report.html import render, write_report
from schwung.report.pictures import Picture, pictures, save_figures

__all__ = [
    "ChangeRow",
    "CheckRow",
    "Deviation",
    "FollowingError",
    "Picture",
    "ReportContent",
    "SyncRow",
    "deviation",
    "pictures",
    "render",
    "save_figures",
    "write_report",
]
