"use strict";
// Figures are drawn when they come near the window, and all of them before the page is printed.
const A4 = { alone: { width: 680, lower: 0.82 }, many: { width: 336, lower: 1 }, least: 320 };
const narrow = window.matchMedia("(max-width: 600px)").matches;
const options = {
  responsive: true,
  displaylogo: false,
  displayModeBar: narrow ? false : "hover",
  modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
};
const figures = new Map();

function specOf(div) {
  const spec = JSON.parse(document.getElementById(div.id.replace(/^plot-/, "data-")).textContent);
  if (narrow) {
    spec.layout.margin = { ...spec.layout.margin, l: 52, r: 6 };
    spec.layout.font.size = 11;
    spec.layout.legend.font.size = 10.5;
    for (const axis of ["xaxis", "yaxis"]) spec.layout[axis].title.font = { size: 11 };
  }
  return spec;
}

class Shown {
  constructor(div) {
    this.div = div;
    this.block = div.closest(".figures");
    this.select = this.block.querySelector("select");
    this.spec = null;
  }
  data() {
    const { data, groups } = this.spec;
    const chosen = this.select ? this.select.value : groups.find((group) => group !== "");
    return data.filter((_, i) => ["", undefined, chosen].includes(groups[i]));
  }
  draw(size = {}) {
    this.spec ??= specOf(this.div);
    Plotly.newPlot(this.div, this.data(), { ...structuredClone(this.spec.layout), ...size }, options);
    this.div.style.minHeight = "";
  }
  choose() {
    if (this.spec) Plotly.react(this.div, this.data(), this.div.layout, options);
  }
  print() {
    const many = this.block.querySelector(".panels.many") && !this.div.closest(".wide");
    const { width, lower } = many ? A4.many : A4.alone;
    this.spec ??= specOf(this.div);
    const { height } = this.spec.layout;
    this.draw({ width, height: Math.max(lower * height, Math.min(height, A4.least)) });
  }
}

const near = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    if (!entry.isIntersecting) continue;
    near.unobserve(entry.target);
    figures.get(entry.target).draw();
  }
}, { rootMargin: "500px 0px" });

for (const div of document.querySelectorAll(".plot")) {
  figures.set(div, new Shown(div));
  near.observe(div);
}
for (const select of document.querySelectorAll(".figures select")) {
  const block = select.closest(".figures");
  select.addEventListener("change", () => {
    block.querySelector(".chosen").textContent = `Shown: ${select.value}`;
    for (const div of block.querySelectorAll(".plot")) figures.get(div).choose();
  });
}
window.addEventListener("beforeprint", () => figures.forEach((shown) => shown.print()));
window.addEventListener("afterprint", () => figures.forEach((shown) => shown.draw()));
