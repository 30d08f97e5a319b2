"""Composes the page of a report."""

from __future__ import annotations

from hoap3.tools.html.document import POLICY, document, figure
from hoap3.tools.html.drawing import Drawing
from hoap3.tools.html.markup import Markup, element, join, link
from hoap3.tools.report.content import Content
from hoap3.tools.report.facts import facts_section, tiles
from hoap3.tools.report.tables import (
    certificates_section,
    conditions_section,
    events_section,
    stalls_section,
    ticks_section,
)
from hoap3.tools.report.words import WORDS
from hoap3.tools.show.verdicts import NAMES, NOT_JUDGED, in_words

__all__ = ["POLICY", "SECTIONS", "page"]

SECTIONS = {
    "motion": "Motion",
    "certificates": "Certificates",
    "conditions": "Conditions",
    "time": "Deadlines and time",
    "ticks": "Worst ticks",
    "events": "Events",
    "stalls": "Stalls of the host",
    "machine": "Machine and settings",
    "words": "Words",
}


def page(content: Content) -> str:
    """The whole file."""
    title = f"{content.robot} · {content.controller}"
    return document(
        f"{title} · report",
        _header(content, title),
        element(
            "main",
            _figures("motion", content.motion_drawings, "No motion can be shown, see above."),
            certificates_section(
                content.certificates,
                SECTIONS["certificates"],
                *map(figure, content.certificate_drawings),
            ),
            conditions_section(content.conditions, SECTIONS["conditions"]),
            _figures("time", content.timing_drawings, _no_times(content)),
            ticks_section(content.timing, SECTIONS["ticks"]),
            events_section(content, SECTIONS["events"]),
            stalls_section(content.timing, SECTIONS["stalls"]),
            facts_section(content, SECTIONS["machine"]),
            _words(),
        ),
        element(
            "footer",
            "Made by hoap3 report from ",
            element("span", content.sources.path),
            ". This page loads nothing and runs nothing.",
        ),
    )


def _header(content: Content, title: str) -> Markup:
    seconds = f"{content.duration_s:.1f} s of motion" if content.duration_s is not None else ""
    facts = [seconds, content.transport, content.date, str(content.sources.path)]
    return element(
        "header",
        element("h1", title),
        _verdicts(content),
        element("p", " · ".join(filter(None, facts)), class_="sub"),
        element("nav", *(link(anchor, name) for anchor, name in SECTIONS.items())),
        element("ul", *(_tile(*tile) for tile in tiles(content)), class_="tiles"),
        _gaps(content),
    )


def _verdicts(content: Content) -> Markup:
    """A badge for each verdict, with what it rests on."""
    words = in_words(content.judged)
    lines = []
    for key, name in NAMES.items():
        verdict = content.judged["verdicts"][key]
        badge = element("span", verdict or NOT_JUDGED, class_=f"badge {verdict or 'unknown'}")
        lines.append(element("p", badge, " ", link("word-verdict", name), " ", words.get(key, "")))
    return element("div", *lines, class_="verdicts")


def _tile(anchor: str, name: str, value: str, notes: tuple[str, ...]) -> Markup:
    return element(
        "li",
        element("span", link(anchor, name), class_="name"),
        element("b", value),
        *(element("span", note) for note in notes),
        class_="tile",
    )


def _gaps(content: Content) -> Markup:
    if not content.gaps:
        return Markup("")
    return element("div", *(element("p", gap) for gap in content.gaps), class_="gaps")


def _figures(anchor: str, drawings: tuple[Drawing, ...], otherwise: str) -> Markup:
    inside = element("div", *map(figure, drawings), class_="grid")
    return element(
        "section",
        element("h2", SECTIONS[anchor]),
        inside if drawings else element("p", otherwise, class_="sub"),
        id=anchor,
    )


def _no_times(content: Content) -> str:
    if content.sources.lockstep:
        return "All time is virtual in lockstep: durations would say nothing, so none are drawn."
    return "No durations can be shown, see above."


def _words() -> Markup:
    entries = join(
        join([element("dt", word, id=f"word-{anchor}"), element("dd", meaning)])
        for anchor, (word, meaning) in WORDS.items()
    )
    return element(
        "section",
        element("h2", SECTIONS["words"]),
        element("dl", entries),
        id="words",
    )
