// Small plots of the last minute: axes with numbers, points that fade with their age or a line, and the newest of them.

import { dots, line, scale, svg, text, tickText, ticks } from "./drawing.js";

const TOP = 26, BOTTOM = 44, RIGHT = 10, LETTER = 9, AGES = 5, LONGEST_STEP_S = 1;

/** Steps of 1, 2 or 5 that give about `count` ticks over the span. */
function stepFor(span, count) {
  const rough = span / count, power = 10 ** Math.floor(Math.log10(rough));
  return power * ([1, 2, 5].find((factor) => factor * power >= rough) ?? 10);
}

/** Bounds around the values that end on a tick and hold zero. */
export function boundsOf(values, least, count = 5) {
  const low = Math.min(0, ...values), high = Math.max(0, ...values), span = Math.max(high - low, least);
  const step = stepFor(span, count);
  const bottom = Math.floor(low / step) * step;
  return { low: bottom, high: Math.max(Math.ceil(high / step) * step, bottom + Math.ceil(least / step) * step), step };
}

const marks = ({ low, high, step }) => ticks([low, high], (high - low) / step).map((value) => [value, tickText(value, step)]);
const columns = (rows) => [0, 1].map((i) => rows.map((row) => row[i]));

export class Plot {
  constructor(figure, xTitle) {
    this.figure = figure;
    this.xTitle = xTitle;
    this.last = null;
    new ResizeObserver(() => this.last && this.draw(this.last)).observe(figure);
  }

  /** Draw { x: bounds, y: bounds, yTitle, rows: [[x, y], ...], joined, current: whether the
   *  last row is of now, empty: text when there are no rows }. */
  draw(content) {
    this.last = content;
    const { x, y, rows } = content, width = this.figure.clientWidth, height = this.figure.clientHeight, up = marks(y);
    if (!width) return;
    const box = { left: 10 + LETTER * Math.max(...up.map(([, words]) => words.length)), right: width - RIGHT, top: TOP, bottom: height - BOTTOM };
    const X = scale([x.low, x.high], [box.left, box.right]), Y = scale([y.low, y.high], [box.bottom, box.top]);
    const curves = !rows.length ? [said(content.empty, box)] : content.joined ? [joined(rows, X, Y)] : aged(rows, X, Y);
    const newest = content.current && rows.length ? [svg("circle", { class: "newest", cx: X(rows.at(-1)[0]), cy: Y(rows.at(-1)[1]), r: 5 })] : [];
    const titles = [text(content.yTitle, 0, 14, { class: "soft" }), text(this.xTitle, width, height - 5, { class: "soft", "text-anchor": "end" })];
    this.figure.replaceChildren(...frame(marks(x), up, box, X, Y), ...titles, ...curves, ...newest);
  }
}

function frame(across, up, { left, right, top, bottom }, X, Y) {
  const kind = (value) => (Math.abs(value) < 1e-9 ? "zero" : "grid");
  return [
    ...up.map(([value]) => svg("path", { class: kind(value), d: `M${left} ${Y(value)}H${right}` })),
    ...across.map(([value]) => svg("path", { class: kind(value), d: `M${X(value)} ${top}V${bottom}` })),
    ...up.map(([value, words]) => text(words, left - 6, Y(value) + 5, { "text-anchor": "end" })),
    ...across.map(([value, words]) => text(words, Math.min(X(value), right + 8 - (LETTER * words.length) / 2), bottom + 19, { "text-anchor": "middle" })),
  ];
}

/** Why there is nothing to draw; a paragraph, so that it wraps. */
function said(words, { left, right, top, bottom }) {
  const paragraph = document.createElement("p");
  paragraph.textContent = words;
  return svg("foreignObject", { x: left, y: top, width: right - left, height: bottom - top }, paragraph);
}

/** Points, older ones paler: a path for each age. */
function aged(rows, X, Y) {
  const [x, y] = columns(rows), size = Math.ceil(rows.length / AGES);
  return Array.from({ length: AGES }, (_, age) => {
    const some = [...rows.keys()].slice(age * size, (age + 1) * size);
    return svg("path", { class: "dot", d: dots(x, y, X, Y, some), opacity: 0.18 + 0.6 * ((age + 1) / AGES) ** 2 });
  });
}

/** A line that is broken where a second or more is missing. */
function joined(rows, X, Y) {
  const broken = rows.flatMap((row, i) => (i && row[0] - rows[i - 1][0] >= LONGEST_STEP_S ? [[null, null], row] : [row]));
  return svg("path", { class: "line", d: line(...columns(broken), X, Y) });
}
