// Small plots on a canvas: axes with numbers, sharp on any screen.

const TOKENS = { soft: "ink-2", grid: "d-grid", paper: "surface", dot: "d-model", now: "d-base" };
/** A colour of tokens.css, as it is now: light or dark. */
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${TOKENS[name] ?? name}`);
const FONT = "15px system-ui, 'DejaVu Sans', sans-serif";

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

function text(number, step) {
  const shown = number.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
  return Number(shown) === 0 ? shown.replace("-", "") : shown.replace("-", "−");
}

export class Plot {
  constructor(canvas, xTitle) {
    this.canvas = canvas;
    this.xTitle = xTitle;
    this.last = null;
    new ResizeObserver(() => this.last && this.draw(this.last)).observe(canvas);
  }

  /** Draw { x: bounds, y: bounds, yTitle, rows: [[x, y], ...], joined, current: whether the
   *  last row is of now, empty: text when there are no rows }. */
  draw(content) {
    this.last = content;
    const ratio = window.devicePixelRatio || 1;
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    if (!width) return;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    const pen = this.canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.font = FONT;
    const labels = ticks(content.y).map((tick) => text(tick, content.y.step));
    const left = 10 + Math.max(...labels.map((label) => pen.measureText(label).width));
    const frame = { left, right: width - 10, top: 26, bottom: height - 44 };
    const at = (bounds, low, high) => (v) => low + ((v - bounds.low) / (bounds.high - bounds.low)) * (high - low);
    const place = { x: at(content.x, frame.left, frame.right), y: at(content.y, frame.bottom, frame.top) };
    this.axes(pen, content, frame, place);
    if (!content.rows.length) return this.say(pen, content.empty, frame);
    pen.save();
    pen.beginPath();
    pen.rect(frame.left - 6, frame.top - 6, frame.right - frame.left + 12, frame.bottom - frame.top + 12);
    pen.clip();
    (content.joined ? line : dots)(pen, content.rows, place);
    if (content.current) newest(pen, content.rows.at(-1), place);
    pen.restore();
  }

  axes(pen, content, frame, place) {
    pen.lineWidth = 1;
    pen.fillStyle = colour("ink");
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    for (const tick of ticks(content.y)) {
      rule(pen, frame.left, place.y(tick), frame.right, place.y(tick), Math.abs(tick) < 1e-9);
      pen.fillText(text(tick, content.y.step), frame.left - 6, place.y(tick));
    }
    pen.textBaseline = "top";
    for (const tick of ticks(content.x)) {
      const x = place.x(tick), label = text(tick, content.x.step), half = pen.measureText(label).width / 2;
      rule(pen, x, frame.top, x, frame.bottom, Math.abs(tick) < 1e-9);
      pen.textAlign = "center";
      pen.fillText(label, Math.min(x, frame.right + 8 - half), frame.bottom + 6);
    }
    pen.fillStyle = colour("soft");
    pen.textAlign = "left";
    pen.fillText(content.yTitle, 0, 2);
    pen.textAlign = "right";
    pen.textBaseline = "bottom";
    pen.fillText(this.xTitle, frame.right + 8, this.canvas.clientHeight);
  }

  say(pen, words, frame) {
    pen.font = `600 ${FONT}`;
    pen.fillStyle = colour("ink");
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    const lines = wrapped(pen, words, frame.right - frame.left - 16), middle = (frame.left + frame.right) / 2;
    const top = (frame.top + frame.bottom) / 2 - (lines.length - 1) * 10;
    lines.forEach((each, i) => {
      const half = pen.measureText(each).width / 2 + 6;
      pen.fillStyle = colour("paper");
      pen.fillRect(middle - half, top + i * 20 - 11, 2 * half, 22);
      pen.fillStyle = colour("ink");
      pen.fillText(each, middle, top + i * 20);
    });
  }
}

function ticks({ low, high, step }) {
  return Array.from({ length: Math.round((high - low) / step) + 1 }, (_, i) => low + i * step);
}

function rule(pen, x0, y0, x1, y1, strong) {
  pen.strokeStyle = strong ? colour("soft") : colour("grid");
  pen.lineWidth = strong ? 1.5 : 1;
  pen.beginPath();
  pen.moveTo(x0, y0);
  pen.lineTo(x1, y1);
  pen.stroke();
}

function wrapped(pen, words, width) {
  const lines = [""];
  for (const word of words.split(" ")) {
    const longer = `${lines.at(-1)} ${word}`.trim();
    if (pen.measureText(longer).width <= width || !lines.at(-1)) lines[lines.length - 1] = longer;
    else lines.push(word);
  }
  return lines;
}

/** Older dots are paler. */
function dots(pen, rows, place) {
  pen.fillStyle = colour("dot");
  rows.forEach(([x, y], i) => {
    pen.globalAlpha = 0.18 + 0.6 * ((i + 1) / rows.length) ** 2;
    pen.beginPath();
    pen.arc(place.x(x), place.y(y), 3.2, 0, 7);
    pen.fill();
  });
  pen.globalAlpha = 1;
}

/** A line that is broken where a second or more is missing. */
function line(pen, rows, place) {
  pen.strokeStyle = colour("dot");
  pen.lineWidth = 2;
  pen.lineJoin = "round";
  pen.beginPath();
  rows.forEach(([x, y], i) => {
    if (i && x - rows[i - 1][0] < 1) pen.lineTo(place.x(x), place.y(y));
    else pen.moveTo(place.x(x), place.y(y));
  });
  pen.stroke();
}

function newest(pen, [x, y], place) {
  pen.fillStyle = colour("now");
  pen.strokeStyle = colour("paper");
  pen.lineWidth = 1.5;
  pen.beginPath();
  pen.arc(place.x(x), place.y(y), 5, 0, 7);
  pen.fill();
  pen.stroke();
}
