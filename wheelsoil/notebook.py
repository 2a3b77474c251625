"""Runs, fits and diagnoses as a notebook shows them: small HTML tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from daq import OUTPUTS, ROLES, number
from daq.runs import Run
from model.diagnosis import Cause, Diagnosis, Gain
from model.fit import CampaignFit
from processing import ProcessedRun
from wheelsoil.web.bidi import in_texts, isolated
from wheelsoil.wording.figures import figure_html, figure_interval
from wheelsoil.wording.fit_text import coefficients, criteria_table, remarks
from wheelsoil.wording.names import chance, place_text, plain_name
from wheelsoil.wording.notes import naming_text, odds_text, step_text, texts_of
from wheelsoil.wording.numbers import typeset
from wheelsoil.wording.run_summary import summary_table
from wheelsoil.wording.verdict import deciding_runs, refusal_words, sentence_of
from wheelsoil.workflows.key_figures import (
    CALIBRATED_SOIL,
    WITH_CAUSES,
    KeyFigure,
    errors_of,
    figures_of_diagnosis,
    sizes_of,
)

Cell = str | KeyFigure
"""A cell of a table: a text, or a key figure, which its renderer writes."""
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
    shown, figures = [html_paragraph(sentence_of(found))], figures_of_diagnosis(found)
    causes = [row for cause in found.causes for row in _cause_rows(cause)]
    if causes:
        head = ["cause", "parameter", "probability", "value", "95 % interval", "unit"]
        shown.append(html_table(head, causes, left=2, caption=f"verdict: {plain_name(found.verdict)}"))
    likely: list[list[Cell]] = [
        [plain_name(c.name), figures[f"candidate.{c.name}"]]
        for c in found.candidates
        if c.probability >= _LEAST_SHOWN and f"candidate.{c.name}" in figures
    ]
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
        rows = _gain_rows(found.gain, found.verdict)
        head = ["R0 on held-out runs", "calibrated soil", "with the causes", "unit"]
        shown.append(html_table(head, rows, caption=f"gain: {number(found.gain.log_likelihood_gain, 4)} nats"))
    if next_runs := deciding_runs(found):
        runs = [
            [
                step_text(run),
                naming_text(run) or "-",
                odds_text(run.expected_log_bayes_factor),
                number(run.cost_runs),
            ]
            for run in next_runs
        ]
        shown.append(html_table(["next run, best first", "right name", "expected odds", "cost, runs"], runs))
    return "".join(shown)


def _gain_rows(gain: Gain, verdict: str) -> list[list[Cell]]:
    errors = errors_of(gain, verdict)
    return [
        [
            channel.name,
            errors[key, CALIBRATED_SOIL],
            errors.get((key, WITH_CAUSES), "–"),
            channel.unit_text,
        ]
        for key, channel in OUTPUTS.items()
        if key in gain.base and key in gain.extended
    ]


def _cause_rows(cause: Cause) -> list[list[Cell]]:
    name, sure = plain_name(cause.name), chance(cause.probability)
    if not cause.parameters:
        return [[name, "", sure, "", "", ""]]
    return [
        [name, p.name, sure, figure, figure_interval(figure), figure.unit]
        for figure, p in zip(sizes_of(cause), cause.parameters, strict=True)
    ]


def html_table(head: Sequence[str], rows: Iterable[Sequence[Cell]], *, left: int = 1, caption: str = "") -> str:
    """Return a small HTML table; texts are escaped. Aligned as in `daq.table_lines`; no head where `head` is empty."""
    parts = ["<table>"]
    if caption:
        parts.append(f'<caption style="text-align:left">{escape(caption)}</caption>')
    if head:
        parts.append(f"<thead><tr>{_html_cells('th', head, left)}</tr></thead>")
    parts += ["<tbody>", *(f"<tr>{_html_cells('td', row, left)}</tr>" for row in rows), "</tbody></table>"]
    return isolated(in_texts("".join(parts), typeset))


def html_paragraph(text: str) -> str:
    """Return an escaped text as a paragraph, or nothing of an empty one."""
    return isolated(f"<p>{escape(typeset(text))}</p>") if text else ""


def _html_cells(tag: str, cells: Sequence[Cell], left: int) -> str:
    sides = ("left" if i < left else "right" for i in range(len(cells)))
    return "".join(
        f'<{tag} style="text-align:{side};padding:.1em .7em .1em 0">{_html_of(cell)}</{tag}>'
        for cell, side in zip(cells, sides, strict=True)
    )


def _html_of(cell: Cell) -> str:
    return escape(cell) if isinstance(cell, str) else figure_html(cell)
