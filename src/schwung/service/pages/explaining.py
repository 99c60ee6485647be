"""An explanation: what the belief left out, where, how sure, and the proof on runs that were kept aside."""

from __future__ import annotations

from schwung.service.pages.desk import Desk, html, panel
from schwung.service.pages.markup import verdict
from schwung.service.pages.words import VERDICTS
from schwung.service.records import ResultRecord


def show_explanation(desk: Desk, found: ResultRecord) -> None:
    """Everything about an explanation."""
    document = found.document
    tone, word = VERDICTS.get(document["verdict"], ("", document["verdict"]))
    with panel("What was left out"):
        html(verdict(tone, word, [finding["text"] for finding in document["findings"]]))
