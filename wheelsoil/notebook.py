"""Runs, fits and diagnoses as a notebook shows them: small HTML tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from math import isfinite

from daq import OUTPUTS, ROLES, number
from daq.runs import Run
from model.diagnosis import Cause, Diagnosis, Gain
from model.fit import CampaignFit
from processing import ProcessedRun
from wheelsoil.wording.fit_text import coefficients, criteria_table, remarks
from wheelsoil.wording.names import chance, place_text, plain_name
from wheelsoil.wording.notes import odds_text, step_text, texts_of
from wheelsoil.wording.run_summary import summary_table
from wheelsoil.wording.verdict import refusal_words, sentence_of

_LEAST_SHOWN = 0.01
_MOST_FINDINGS = 6


def run_html(run: Run) -> str:
    """Return what is known of a run without reading its frames."""
    info = run.info
    pressure = f", {info.inflation_kpa:g} kPa" if info.inflation_kpa else ""
    rows = [
        ("run", run.id),
        ("file", ", ".join(file.name for file in run.files)),
        ("driven", f"{info.direction}, pass {info.pass_number}, {info.added_load_kg:g} kg added{pressure}"),
        ("vehicle", run.vehicle.vehicle.name),
        ("terrain", run.terrain.soil.name if run.terrain else "-"),
        ("roles", ", ".join(run.vehicle.signals) or "-"),
    ]
    counts = run.recording.frame_counts if run.recording else {}
    return html_table((), rows + [(f"bus {bus}", f"{count:,} frames") for bus, count in counts.items()], left=2)


def processed_run_html(run: ProcessedRun) -> str:
    """Return the summary of a processed run and its notes."""
    return html_table((), summary_table(run), left=2) + "".join(map(html_paragraph, texts_of(run.quality.notes)))


def fit_html(fit: CampaignFit) -> str:
    """Return the tables of a fit and its remarks."""
    tables = [coefficients(fit), *(criteria_table(fit, channel) for channel in OUTPUTS)]
    shown = [html_table(head, rows, left=2 if i == 0 else 1) for i, (head, rows) in enumerate(tables) if rows]
    return "".join([*shown, *map(html_paragraph, remarks(fit))])


def diagnosis_html(found: Diagnosis) -> str:
    """Return the verdict, the causes and the residuals of the simulation."""
    shown = [html_paragraph(sentence_of(found))]
    causes = [row for cause in found.causes for row in _cause_rows(cause)]
    if causes:
        head = ["cause", "parameter", "probability", "value", "95 % interval", "unit"]
        shown.append(html_table(head, causes, left=2, caption=f"verdict: {plain_name(found.verdict)}"))
    likely = [[plain_name(c.name), chance(c.probability)] for c in found.candidates if c.probability >= _LEAST_SHOWN]
    if refused := refusal_words(found):
        shown.append(html_paragraph(refused))
    elif likely:
        shown.append(html_table(["candidate", "probability"], likely))
    wrong = [
        [
            ROLES[w.channel].name,
            place_text(w.place),
            f"{number(w.size, 3)} {ROLES[w.channel].unit_text}",
            number(w.statistic, 3),
        ]
        for w in found.what_is_wrong[:_MOST_FINDINGS]
    ]
    if wrong:
        caption = "Residuals of the simulation, largest first"
        shown.append(html_table(["channel", "where", "by", "sigmas"], wrong, left=2, caption=caption))
    if found.gain is not None:
        rows = _gain_rows(found.gain)
        head = ["on held-out runs", "R0 base", "R0 extended", "unit"]
        shown.append(html_table(head, rows, caption=f"gain: {number(found.gain.log_likelihood_gain, 4)} nats"))
    if found.next_run:
        runs = [
            [step_text(run), odds_text(run.expected_log_bayes_factor), number(run.cost_runs)] for run in found.next_run
        ]
        shown.append(html_table(["next run, best first", "expected odds", "cost, runs"], runs))
    return "".join(shown)


def _gain_rows(gain: Gain) -> list[list[str]]:
    return [
        [channel.name, number(gain.base[key].R0), number(gain.extended[key].R0), channel.unit_text]
        for key, channel in OUTPUTS.items()
        if key in gain.base and key in gain.extended
    ]


def _cause_rows(cause: Cause) -> list[list[str]]:
    name, sure = plain_name(cause.name), chance(cause.probability)
    if not cause.parameters:
        return [[name, "", sure, "", "", ""]]
    rows = []
    for p in cause.parameters:
        low, high = p.interval95
        interval = f"{number(low, 3)} .. {number(high, 3)}" if isfinite(low) and isfinite(high) else "-"
        rows.append([name, p.name, sure, number(p.value, 3), interval, "" if p.unit == "1" else p.unit])
    return rows


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]], *, left: int = 1, caption: str = "") -> str:
    """Return a small HTML table; texts are escaped. Aligned as in `daq.table_lines`; no head where `head` is empty."""
    parts = ["<table>"]
    if caption:
        parts.append(f'<caption style="text-align:left">{escape(caption)}</caption>')
    if head:
        parts.append(f"<thead><tr>{_html_cells('th', head, left)}</tr></thead>")
    parts += ["<tbody>", *(f"<tr>{_html_cells('td', row, left)}</tr>" for row in rows), "</tbody></table>"]
    return "".join(parts)


def html_paragraph(text: str) -> str:
    """Return an escaped text as a paragraph, or nothing of an empty one."""
    return f"<p>{escape(text)}</p>" if text else ""


def _html_cells(tag: str, texts: Sequence[str], left: int) -> str:
    sides = ("left" if i < left else "right" for i in range(len(texts)))
    return "".join(
        f'<{tag} style="text-align:{side};padding:.1em .7em .1em 0">{escape(text)}</{tag}>'
        for text, side in zip(texts, sides, strict=True)
    )
