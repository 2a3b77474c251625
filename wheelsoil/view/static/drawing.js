// Plotly, and how everything looks: colours that the colour-blind can tell apart (Okabe and Ito), and never by colour alone.

import { Refused } from "./api.js";
import { BY_HAND as HAND, MODELS, SPARE } from "./styles.js";

/** A colour of common.css, as it is now: light or dark. */
export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

export const B_COLOUR = "#E69F00";
export const PICKED = "#F0E442";
export const BY_HAND = { name: HAND.label, colour: HAND.colour, dash: HAND.dash, width: 3.5 };
export const BY_HAND_B = { name: "by hand, on the other soil", colour: B_COLOUR, dash: "longdash", width: 3 };
/** A model looks as it does in the report; styles.js is made from the report's table. */
export function modelStyle(key) {
  const { label, colour: own, dash } = MODELS[key] ?? { ...SPARE, label: key };
  return { name: label, colour: own, dash, width: 2 };
}

export const SEGMENTS = {
  drive: { letter: "D", fill: "rgba(0,158,115,0.13)" },
  coast: { letter: "C", fill: "rgba(86,180,233,0.16)" },
  brake: { letter: "B", fill: "rgba(213,94,0,0.13)" },
  standstill: { letter: "S", fill: "rgba(128,128,128,0.22)" },
};

/** Plotly reads some HTML in its texts; a name is shown letter for letter. */
export const words = (text) => String(text).replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");

export const CONFIG = {
  responsive: true, displaylogo: false, doubleClick: false, scrollZoom: false,
  modeBarButtons: [["select2d", "zoom2d", "pan2d", "resetScale2d", "toImage"]],
};

export function layoutOf(xTitle, yTitle, x, y) {
  const ink = colour("ink"), grid = colour("grid");
  const axis = (title, range) => ({
    title: { text: title, standoff: 8 }, range, autorange: false, gridcolor: grid, zerolinecolor: colour("soft"), linecolor: colour("soft"),
    ticks: "outside", tickcolor: colour("soft"), automargin: true, exponentformat: "none", separatethousands: true,
  });
  return {
    height: 270, margin: { l: 56, r: 8, t: 16, b: 42 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: "system-ui, 'DejaVu Sans', sans-serif", size: 12, color: ink },
    hovermode: "closest", dragmode: "select", showlegend: false, shapes: [], annotations: [], separators: ".\u202f",
    modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("soft"), activecolor: ink },
    newselection: { line: { color: ink, width: 1.5, dash: "dot" } },
    xaxis: axis(xTitle, x), yaxis: axis(yTitle, y),
  };
}

/** Load plotly.js once. It brings a stylesheet for maps, which the page's policy refuses and nobody here needs: keep it out. */
let loading;
export function plotly() {
  loading ??= new Promise((done, failed) => {
    const { head } = document, script = document.createElement("script");
    const append = head.appendChild.bind(head);
    const restored = (then) => () => { delete head.appendChild; then(globalThis.Plotly); };
    script.src = "/plotly.js";
    script.onload = restored(done);
    script.onerror = restored(() => { loading = undefined; failed(new Refused([{ what: "plotly.js did not come, so there are no plots", next_step: "reload the page" }])); });
    append(script);
    head.appendChild = (node) => (node.tagName === "STYLE" ? node : append(node));
  });
  return loading;
}
