// Figures of the appendix, drawn from the JSON beside them (wheelsoil/report/figures.py, docs/decisions/plotting.md).
// In the page drawing.js stands before this file and page.js after it; all three are one script.

const JOURNAL_MM = 174, RIGHT = 14, BOTTOM = 42, LINE = 24, SAMPLE = 24, TURNED = 90, LETTERING = 12, NEAR = 40, DRAG_PX = 6, SHADES = 5;
const LINKED_LEFT = 66; // of figures on one time axis
/** The token of each colour; others are the same in a light and a dark theme. */
const TOKENS = { "rgba(90,90,90,0.35)": "--d-dens-4", "#111111": "--d-measured", "rgba(0,0,0,0.13)": "--d-noise", "#dcebf7": "--ph-drive", "#fbe5d3": "--ph-brake", "#eeeeee": "--ph-still",
  "#0b62c4": "--d-model", "#0072B2": "--d-model", "#D55E00": "--d-base", "#CC79A7": "--d-alt", "#009E73": "--d-second", "#6b5a00": "--d-third",
  "#882255": "--d-wine", "#661100": "--d-brown" };
const paint = (colour) => (colour in TOKENS ? `var(${TOKENS[colour]})` : colour);
const DASHES = { solid: "none", dash: "7 4", dot: "2 3", dashdot: "9 3 2 3", longdash: "13 4", longdashdot: "14 4 2 4" };
const SYMBOLS = {
  circle: (r) => `m${-r} 0a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0z`,
  square: (r) => `m${-r} ${-r}h${2 * r}v${2 * r}h${-2 * r}z`,
  diamond: (r) => `m0 ${-1.3 * r}l${1.3 * r} ${1.3 * r}l${-1.3 * r} ${1.3 * r}l${-1.3 * r} ${-1.3 * r}z`,
  "triangle-up": (r) => `m0 ${-1.1 * r}l${1.1 * r} ${2 * r}h${-2.2 * r}z`,
  "triangle-down": (r) => `m0 ${1.1 * r}l${1.1 * r} ${-2 * r}h${-2.2 * r}z`,
  star: (r) => `m0 ${-1.6 * r}l${0.5 * r} ${1.1 * r}l${1.1 * r} ${0.5 * r}l${-1.1 * r} ${0.5 * r}l${-0.5 * r} ${1.1 * r}l${-0.5 * r} ${-1.1 * r}l${-1.1 * r} ${-0.5 * r}l${1.1 * r} ${-0.5 * r}z`,
  hexagon: (r) => `m${-r} 0l${r / 2} ${-r}h${r}l${r / 2} ${r}l${-r / 2} ${r}h${-r}z`,
  x: (r) => `m${-r} ${-r}l${2 * r} ${2 * r}m0 ${-2 * r}l${-2 * r} ${2 * r}`,
};
const HATCHES = { "/": "M-2 2L2 -2M0 8L8 0M6 10L10 6", "\\": "M-2 6L2 10M0 0L8 8M6 -2L10 2", "-": "M0 4H8", "|": "M4 0V8", "+": "M0 4H8M4 0V8", ".": "M4 4h.1", x: "M0 8L8 0M0 0L8 8" };

const pen = document.createElement("canvas").getContext("2d");
function widthOf(words) {
  pen.font = `${LETTERING}px ${getComputedStyle(document.body).fontFamily}`;
  return pen.measureText(words).width;
}

/** A text that fits into some pixels; who points at a shortened one reads all of it. */
function fitted(words, room, x, y, attributes) {
  if (widthOf(words) <= room) return text(words, x, y, attributes);
  let short = words;
  while (short && widthOf(`${short}…`) > room) short = short.slice(0, -1);
  return svg("text", { x, y, ...attributes }, `${short}…`, svg("title", {}, words));
}

/** A value as it is written at an axis. */
const written = (value) => (typeof value === "number" ? String(value).replace("-", "−") : value);

/** The title of an axis, as its name and its unit. */
function partsOf(title = "") {
  const found = /^(.*) \((%|N m|[^\s()]+)( of [^()]*)?\)$/.exec(title);
  return found ? [found[1], `\u00a0${found[2]}`] : [title, ""];
}

/** A value at the pointer, with its unit: as fine as 1/250 of the step of the ticks asks for, with at most five digits. */
function told(value, { title, order, log }, marks) {
  if (order || typeof value !== "number") return value;
  const power = (size) => Math.floor(Math.log10(size)), five = power(Math.abs(value) || 1) - 4;
  const finest = 10 ** (log ? five + 2 : marks.length < 2 ? five : Math.max(five, power((marks[1][0] - marks[0][0]) / 250)));
  return `${tickText(Math.round(value / finest) * finest, finest)}${partsOf(title)[1]}`;
}

/** What an axis needs: `units` turns a value into a place on its linear scale, `marks` are the ticks as [place, text]. */
function axisOf({ title, range, order, log, zero }) {
  const units = order ? (name) => order.indexOf(name) : log ? (value) => value && Math.log10(value) : (value) => value;
  const marks = (limits, most) => {
    if (order) return order.map((name, i) => [i, name]);
    const found = ticks(limits, most), step = found[1] - found[0] || 1;
    if (log) return found.filter(Number.isInteger).map((value) => [value, written(10 ** value)]);
    return found.map((value) => [value, tickText(value, step)]);
  };
  return { title, range, order, log, zero, units, marks };
}

/** The least and the greatest of some places with a margin; [0, 1] where there is none. */
function reachOf(places, zero) {
  let low = zero ? 0 : Infinity, high = zero ? 0 : -Infinity;
  for (const place of places) if (place !== null) [low, high] = [Math.min(low, place), Math.max(high, place)];
  if (!(low <= high)) return [0, 1];
  const pad = 0.04 * (high - low) || 1;
  return [zero && low === 0 ? 0 : low - pad, high + pad];
}

/** The places that a trace takes along an axis; the background takes none. */
function placesOf(trace, key, { units }) {
  if (trace.kind === "stripes" || trace.kind === "flags") return [];
  if (trace.kind === "cells") return [0, key === "x" ? trace.z[0].length : trace.z.length].map((count) => trace[`${key}0`] + (count - 0.5) * trace[`d${key}`]);
  if (trace.kind === "column" && key === "y") return [trace.base, ...trace.y.map((value) => trace.base + value)];
  if (trace.error_y && key === "y") return trace.y.flatMap((value, i) => (value === null ? [] : [value - trace.error_y.arrayminus[i], value + trace.error_y.array[i]]));
  return trace[key].map(units);
}

const stroked = ({ colour, width = 1.6, dash = "solid" }, d) => svg("path", { class: "curve", d, stroke: paint(colour), "stroke-width": width, "stroke-dasharray": DASHES[dash] });

/** The symbols of a trace at some places, in pixels. */
function symbols({ symbol, size, colour }, places) {
  const shape = SYMBOLS[symbol.replace("-open", "")](size / 2), isHollow = symbol.endsWith("-open") || symbol === "x";
  const look = isHollow ? { fill: "none", stroke: paint(colour), "stroke-width": 1.6 } : { fill: paint(colour) };
  return svg("path", { class: "symbols", d: places.map(([x, y]) => `M${x} ${y}${shape}`).join(""), ...look });
}

function points(trace, { X, Y, x, y }) {
  const made = [], { array, arrayminus } = trace.error_y ?? {};
  if (trace.dash) made.push(stroked(trace, line(x, y, X, Y)));
  if (array) made.push(stroked({ colour: trace.colour }, y.map((value, i) => (value === null ? "" : `M${X(x[i])} ${Y(value - arrayminus[i])}V${Y(value + array[i])}`)).join("")));
  if (trace.quiet) made.push(svg("path", { class: "cloud", d: dots(x, y, X, Y, x.keys()), stroke: paint(trace.colour), "stroke-width": trace.size }));
  else if (trace.symbol) made.push(symbols(trace, x.flatMap((value, i) => (value === null || y[i] === null ? [] : [[X(value), Y(y[i])]]))));
  return made;
}

/** What fills an area: its colour, hatched where it has a pattern. */
function fillOf({ colour, pattern, kind }, { key, defs }) {
  if (!pattern) return paint(colour);
  const id = `hatch-${key}-${defs.childElementCount}`, hatch = svg("path", { class: `hatch ${kind}`, d: HATCHES[pattern] });
  defs.append(svg("pattern", { id, width: 8, height: 8, patternUnits: "userSpaceOnUse" }, svg("rect", { width: 8, height: 8, fill: paint(colour) }), hatch));
  return `url(#${id})`;
}

const spanned = ([x0, x1], [y0, y1]) => ({ x: Math.min(x0, x1), y: Math.min(y0, y1), width: Math.abs(x1 - x0), height: Math.abs(y1 - y0) });
const rectangle = (across, up, fill, ...children) => svg("rect", { ...spanned(across, up), fill }, ...children);

/** How each kind of trace is drawn, of itself and its surroundings: scales, places, the trace before it, the figure. */
const DRAWN = {
  points,
  line: points,
  edge: () => [],
  band: (trace, { X, Y, x, y, before }) => [svg("path", { d: area(x, before.y, y, X, Y), fill: paint(trace.colour), opacity: trace.opacity })],
  stripes: (trace, around) => [svg("path", { d: line(around.x, around.y, around.X, around.Y), fill: fillOf(trace, around) })],
  cells({ x0, dx, y0, dy, z, most }, { X, Y }) {
    const paths = Array(SHADES).fill(""), edge = (at) => at.toFixed(1);
    z.forEach((row, j) => row.forEach((count, i) => {
      const [left, right, low, high] = [X(x0 + (i - 0.5) * dx), X(x0 + (i + 0.5) * dx), Y(y0 + (j - 0.5) * dy), Y(y0 + (j + 0.5) * dy)].map(edge);
      if (count) paths[Math.min(SHADES - 1, Math.floor((SHADES * count) / most))] += `M${left} ${low}H${right}V${high}H${left}z`;
    }));
    return paths.map((d, i) => svg("path", { class: `dens-${i + 1}`, d, "shape-rendering": "crispEdges" }));
  },
  bar(trace, around) {
    const { X, Y, y, stacked, beside } = around, high = 0.7 * Math.abs(Y(1) - Y(0)), each = beside ? high / beside.count : high, fill = fillOf(trace, around);
    return trace.x.map((value, i) => {
      const from = beside ? 0 : stacked.get(y[i]) ?? 0, top = Y(y[i]) - high / 2 + (beside ? beside.turn * each : 0);
      stacked.set(y[i], from + value);
      return rectangle([X(from), X(from + value)], [top, top + each], fill, svg("title", {}, `${trace.name}, ${trace.y[i]}: ${around.tell("x", value)}`));
    });
  },
  column: (trace, { X, Y, x, y }) => y.map((value, i) => rectangle([X(x[i] - 0.25), X(x[i] + 0.25)], [Y(trace.base), Y(trace.base + value)], paint(trace.colour))),
  flags: (trace, { X, box, x }) => trace.texts.flatMap((words, i) => {
    const at = X(x[3 * i]), isLate = at + widthOf(words) + 24 > box.right;
    return [svg("path", { class: "flag", d: `M${at} ${box.top}V${box.bottom}` }), text(`\u2691 ${words}`, at + (isLate ? -4 : 4), box.top + 12, { class: "flag-text", "text-anchor": isLate ? "end" : "start" })];
  }),
};

const swatch = (trace, { x, y, ...around }) => [svg("g", { opacity: trace.opacity ?? 1 }, rectangle([x, x + SAMPLE], [y - 10, y + 2], fillOf(trace, around)))];
/** How each kind is shown beside its name in the legend; an area as a small rectangle. */
const SAMPLES = {
  line: (trace, { x, y }) => [stroked(trace, `M${x} ${y - 4}h${SAMPLE}`), ...(trace.symbol ? [symbols(trace, [[x + SAMPLE / 2, y - 4]])] : [])],
  points: (trace, { x, y }) => [symbols({ ...trace, size: Math.min(trace.size, 10) }, [[x + SAMPLE / 2, y - 4]])],
  cells: (_, at) => swatch({ colour: "var(--d-dens-3)" }, at),
  flags: (_, { x, y }) => [svg("path", { class: "flag", d: `M${x} ${y - 4}h${SAMPLE}` })],
};

class Figure {
  constructor(div) {
    Object.assign(this, { div, key: div.id.replace(/^plot-/, ""), block: div.closest(".figures"), hidden: new Set(), zoom: {}, whole: false });
    this.select = this.block.querySelector("select");
    this.linked = this.block.hasAttribute("data-linked");
    div.figure = this;
  }

  get spec() {
    return (this.read ??= dataOf(`data-${this.key}`));
  }

  /** The traces of the chosen group. */
  get traces() {
    const { data, groups } = this.spec, chosen = this.select ? this.select.value : groups.find((group) => group !== "");
    return data.filter((_, i) => ["", undefined, chosen].includes(groups[i]));
  }

  get siblings() {
    return this.linked ? [...this.block.querySelectorAll(".plot")].map(({ figure }) => figure) : [this];
  }

  draw() {
    const { layout } = this.spec, all = this.traces;
    this.width = this.div.clientWidth;
    this.shown = all.filter(({ name }) => !this.hidden.has(name));
    this.axes = { x: axisOf(layout.xaxis), y: axisOf(layout.yaxis) };
    const legend = this.legend(all);
    this.layOut(layout, legend.height);
    const { left, right, top, bottom } = this.box, across = { x: left, width: right - left }, up = { y: top, height: bottom - top };
    const defs = svg("defs"), inside = svg("svg", { ...across, ...up, viewBox: `${left} ${top} ${right - left} ${bottom - top}` }); // what lies beyond it is not seen
    const upright = (look, x, visibility = "visible") => svg("path", { class: look, d: `M${x} ${top}V${bottom}`, visibility });
    this.cursor = upright("cursor", 0, "hidden");
    this.here = svg("circle", { class: "here", r: 5, visibility: "hidden" });
    this.drag = svg("rect", { class: "zoom" });
    inside.append(...this.groups(defs, layout.grouped), ...(layout.dotted ?? []).map((at) => upright("dotted", this.X(this.axes.x.units(at)))), this.cursor, this.here, this.drag);
    this.svg = svg("svg", { class: "plotted", viewBox: `0 0 ${this.width} ${layout.height}` }, defs, ...this.frame(layout.height), inside, ...legend.parts);
    this.tip = Object.assign(document.createElement("div"), { className: "tip", hidden: true });
    this.div.replaceChildren(this.svg, this.tip);
    this.div.style.minHeight = "";
  }

  redraw() {
    if (this.svg) this.draw();
  }

  /** Where the axes lie, and their scales and ticks. */
  layOut({ height, one_scale: isEven }, legend) {
    const { x, y } = this.axes, limits = { x: this.limitsOf("x"), y: this.limitsOf("y") }, top = legend + (y.title ? 24 : 8);
    this.up = y.marks(limits.y, (height - top - BOTTOM) / 40);
    const widest = Math.max(0, ...this.up.map(([, words]) => widthOf(words))), left = this.linked ? LINKED_LEFT : Math.min(widest, 0.42 * this.width) + 14;
    this.box = { left, right: this.width - RIGHT, top, bottom: height - BOTTOM };
    const room = this.box.right - left, longest = Math.max(0, ...(x.order ?? []).map(widthOf));
    this.slot = x.order ? room / x.order.length : room;
    this.turned = longest > this.slot - 6 ? Math.min(longest, TURNED) : 0;
    if (this.turned) this.box.bottom -= this.turned - LETTERING;
    if (isEven) evened(limits, this.box);
    this.X = scale(limits.x, [left, this.box.right]);
    this.Y = scale(y.order ? limits.y.toReversed() : limits.y, [this.box.bottom, top]);
    this.across = x.marks(limits.x, Math.max(3, room / 80));
  }

  /** The part that is zoomed into; else the first range of an axis, or all that is drawn after a double-click and where there is none. */
  limitsOf(key) {
    const axis = this.axes[key], traces = key === "x" ? this.siblings.flatMap((figure) => figure.traces) : this.shown; // of one time axis
    if (axis.order) return [-0.5, axis.order.length - 0.5];
    return this.zoom[key] ?? ((!this.whole && axis.range) || reachOf(traces.flatMap((trace) => placesOf(trace, key, axis)), axis.zero));
  }

  groups(defs, isGrouped) {
    const { X, Y, box, key, shown, axes } = this, stacked = new Map(), bars = shown.filter(({ kind }) => kind === "bar");
    return shown.map((trace, i) => {
      const around = { X, Y, box, key, defs, stacked, tell: (along, value) => this.told(along, value), before: shown[i - 1], x: trace.x?.map(axes.x.units), y: trace.y?.map(axes.y.units) };
      const beside = isGrouped ? { count: bars.length, turn: bars.indexOf(trace) } : null;
      const group = svg("g", { class: "trace", "data-name": trace.name }, ...DRAWN[trace.kind](trace, { ...around, beside }));
      group.trace = trace;
      return group;
    });
  }

  /** Grid, ticks and titles. */
  frame(height) {
    const { X, Y, box, axes, turned } = this, every = turned ? Math.ceil(16 / this.slot) : 1, isCrossed = !axes.y.order && Y.limits[0] < 0 && Y.limits[1] > 0;
    const upright = axes.x.order ? [] : this.across.map(([at]) => `M${X(at)} ${box.top}V${box.bottom}`), level = axes.y.order ? [] : this.up.map(([at]) => `M${box.left} ${Y(at)}H${box.right}`);
    return [
      svg("path", { class: "grid", d: [...upright, ...level].join("") }),
      svg("path", { class: "zero", d: isCrossed ? `M${box.left} ${Y(0)}H${box.right}` : "" }),
      svg("path", { class: "axis", d: `M${box.left} ${box.bottom}H${box.right}` }),
      ...this.across.filter((_, i) => i % every === 0).map(([at, words]) => this.tickAcross(X(at), words)),
      ...this.up.map(([at, words]) => fitted(words, box.left - 12, box.left - 8, Y(at) + 4, { class: "tick y", "text-anchor": "end" })),
      text(axes.y.title, 0, box.top - 12, { class: "title" }),
      text(axes.x.title, box.right, height - 6, { class: "title", "text-anchor": "end" }),
    ];
  }

  tickAcross(at, words) {
    const { turned, box: { right, bottom } } = this;
    if (!turned) return fitted(words, this.slot, Math.min(at, right + RIGHT - widthOf(words) / 2), bottom + 17, { class: "tick x", "text-anchor": "middle" });
    return fitted(words, turned, at + 4, bottom + 8, { class: "tick x", "text-anchor": "end", transform: `rotate(-90 ${at + 4} ${bottom + 8})` });
  }

  /** The names of the traces, each a button that hides its trace; none where there is one name only. */
  legend(all) {
    const looks = new Map(), parts = [], defs = svg("defs"), most = this.width - SAMPLE - 8;
    for (const trace of all) if (!trace.quiet || !looks.has(trace.name)) looks.set(trace.name, trace);
    if (looks.size < 2) return { height: 0, parts };
    let x = 0, y = 14;
    for (const [name, trace] of looks) {
      const room = SAMPLE + 8 + Math.min(widthOf(name), most);
      if (x && x + room > this.width) [x, y] = [0, y + LINE];
      parts.push(this.entry(trace, { x, y, defs }, most));
      x += room + 14;
    }
    return { height: y + 8, parts: [defs, ...parts] };
  }

  entry(trace, at, most) {
    const isHidden = this.hidden.has(trace.name), look = (SAMPLES[trace.kind] ?? swatch)(trace, { ...at, key: `${this.key}-legend` });
    const words = fitted(trace.name, most, at.x + SAMPLE + 6, at.y, { class: "tick" });
    const made = svg("g", { class: isHidden ? "entry off" : "entry", role: "button", tabindex: 0, "aria-pressed": !isHidden, "aria-label": `${trace.name}: shown` }, ...look, words);
    made.name = trace.name;
    return made;
  }

  /** Hide or show the traces of a name in the legend. */
  toggle(entry) {
    if (!entry) return;
    if (!this.hidden.delete(entry.name)) this.hidden.add(entry.name);
    this.draw();
    [...this.svg.querySelectorAll(".entry")].find(({ name }) => name === entry.name).focus();
  }

  /** Show a part of the axes; the figures on one time axis show the same time. */
  zoomTo({ x, y }) {
    for (const figure of this.siblings) {
      if (x) figure.zoom.x = x;
      if (figure === this && y) figure.zoom.y = y;
      figure.redraw();
    }
  }

  /** The first view again; from there all there is. */
  zoomOut() {
    for (const figure of this.siblings) {
      figure.whole = !figure.zoom.x && !figure.zoom.y && !figure.whole;
      figure.zoom = {};
      figure.redraw();
    }
  }

  showCursor(at) {
    set(this.cursor, { visibility: "visible", transform: `translate(${this.X(at)} 0)` });
  }

  holds({ x, y }) {
    const { left, right, top, bottom } = this.box;
    return x >= left && x <= right && y >= top && y <= bottom;
  }

  /** The point of each line that is nearest to the pointer: { trace, i, x, y, away } in pixels. */
  nearest(pointer) {
    const { x: across, y: up } = this.axes, answering = this.shown.filter(({ kind, quiet }) => !quiet && (kind === "line" || kind === "points"));
    return answering.map((trace) => {
      let best = { away: NEAR };
      trace.x.forEach((value, i) => {
        if (value === null || trace.y[i] === null) return;
        const x = this.X(across.units(value)), y = this.Y(up.units(trace.y[i])), away = Math.hypot(x - pointer.x, this.linked ? 0 : y - pointer.y);
        if (away < best.away) best = { trace, i, x, y, away };
      });
      return best;
    }).filter(({ trace }) => trace);
  }

  /** Tell the values at the pointer: of every line at a time, else of the nearest point. */
  point(pointer) {
    if (!this.holds(pointer)) return this.leave();
    if (this.linked) moveCursor(this.block, this.X.back(pointer.x));
    const found = this.nearest(pointer), [best] = found.toSorted((a, b) => a.away - b.away);
    if (!best) return this.leave();
    const { trace, i, x, y } = best, where = trace.texts?.[i] ?? `${partsOf(this.axes.x.title)[0]} ${this.told("x", trace.x[i])}`;
    this.tip.textContent = [where, ...(this.linked ? found : [best]).map((each) => `${each.trace.name}: ${this.told("y", each.trace.y[each.i])}`)].join("\n");
    this.tip.hidden = false;
    const left = x > this.width / 2 ? x - this.tip.offsetWidth - 12 : x + 12, top = Math.min(y - 12, this.box.bottom - this.tip.offsetHeight);
    Object.assign(this.tip.style, { left: `${left}px`, top: `${Math.max(0, top)}px` });
    return set(this.here, { cx: x, cy: y, visibility: "visible" });
  }

  told(along, value) {
    return told(value, this.axes[along], along === "x" ? this.across : this.up);
  }

  leave() {
    this.tip.hidden = true;
    this.here.setAttribute("visibility", "hidden");
  }

  /** A part of the figure between two places, in pixels: an axis that the pointer hardly moved along is whole. */
  part(from, to) {
    const { left, right, top, bottom } = this.box, within = (value, low, high) => Math.max(low, Math.min(value, high));
    const across = [from.x, within(to.x, left, right)], up = [from.y, within(to.y, top, bottom)], isMoved = ([a, b]) => Math.abs(b - a) > DRAG_PX;
    return { x: isMoved(across) ? across : null, y: isMoved(up) ? up : null, whole: [[left, right], [top, bottom]] };
  }

  listen() {
    let start = null;
    const at = ({ clientX, clientY }) => {
      const { left, top } = this.svg.getBoundingClientRect();
      return { x: clientX - left, y: clientY - top };
    };
    const on = (kind, act) => this.div.addEventListener(kind, act);
    on("pointerdown", (event) => {
      const from = at(event), isMouse = event.pointerType === "mouse" && !event.button;
      if (!this.holds(from) || !isMouse) return this.point(from);
      start = from;
      return this.div.setPointerCapture(event.pointerId);
    });
    on("pointermove", (event) => {
      if (!start) return this.point(at(event));
      const { x, y, whole } = this.part(start, at(event));
      return set(this.drag, x || y ? spanned(x ?? whole[0], y ?? whole[1]) : { width: 0, height: 0 });
    });
    on("pointerup", (event) => {
      const { x, y } = start ? this.part(start, at(event)) : {}, values = (pixels, axis) => pixels?.map(axis.back).toSorted((a, b) => a - b);
      start = null;
      if (x || y) this.zoomTo({ x: values(x, this.X), y: this.axes.y.order ? null : values(y, this.Y) });
    });
    on("pointerleave", ({ pointerType }) => { if (pointerType === "mouse") this.leave(); });
    on("dblclick", (event) => { if (this.holds(at(event))) this.zoomOut(); });
    on("click", ({ target }) => this.toggle(target.closest(".entry")));
    on("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      this.toggle(event.target.closest(".entry"));
    });
  }
}

/** Stretch the range of one axis so that both have one scale. */
function evened(limits, { left, right, top, bottom }) {
  const spans = { x: (limits.x[1] - limits.x[0]) / (right - left), y: (limits.y[1] - limits.y[0]) / (bottom - top) }, most = Math.max(spans.x, spans.y);
  for (const key of ["x", "y"]) {
    const [low, high] = limits[key], more = ((most / spans[key] - 1) * (high - low)) / 2;
    limits[key] = [low - more, high + more];
  }
}
