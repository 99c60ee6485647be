"""What people read afterwards: one HTML file, and its pictures."""

from schwung.report.content import (
    ChangeRow,
    CheckRow,
    FollowingError,
    ReportContent,
    SyncRow,
)
from schwung.report.html import render, write_report
from schwung.report.pictures import Picture, pictures, save_figures

__all__ = [
    "ChangeRow",
    "CheckRow",
    "FollowingError",
    "Picture",
    "ReportContent",
    "SyncRow",
    "pictures",
    "render",
    "save_figures",
    "write_report",
]
