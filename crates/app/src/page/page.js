"use strict";
(() => {
const root = document.documentElement;
const NUMBER = new Intl.NumberFormat("en", { maximumSignificantDigits: 4, useGrouping: false });
const AXIS_PX = 56;
const PAPER_PX = 680;

const colour = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

function element(tag, parent, properties = {}) {
  const made = Object.assign(document.createElement(tag), properties);
  parent?.append(made);
  return made;
}

/** Index of the place nearest to `at`; `x` ascends. */
function nearest(x, at) {
  let best = 0;
  for (let i = 1; i < x.length; i++) if (Math.abs(x[i] - at) <= Math.abs(x[best] - at)) best = i;
  return best;
}

/** What the value axis shows: all values, widened to `at_least`, cut to `at_most`. */
function range(panel) {
  let [low, high] = panel.at_least;
  for (const { values } of panel.series) {
    for (const value of values) if (value !== null) { low = Math.min(low, value); high = Math.max(high, value); }
  }
  low = Math.max(low, panel.at_most[0]);
  high = Math.min(high, panel.at_most[1]);
  if (!(high > low)) return [low - 1, low + 1];
  const margin = 0.05 * (high - low);
  return [low === 0 ? 0 : low - margin, high + margin];
}

/** The pictures with a slider, a button that plays them, switches for what is drawn over them, and values. */
function player(parent, data, moved) {
  const { pictures, x } = data;
  const box = element("div", parent, { className: "player" });
  const canvas = element("canvas", box);
  const slider = element("input", box, { type: "range", min: 0, max: x.length - 1, value: 0 });
  slider.setAttribute("aria-label", `picture, by ${data.x_label}`);
  slider.oninput = () => moved(Number(slider.value));
  const controls = element("div", box, { className: "controls" });
  const values = element("dl", box);
  const images = new Map();
  let now = 0;

  const switches = pictures.spots.map((spot) => {
    const label = element("label", null);
    const input = element("input", label, { type: "checkbox", checked: !spot.hidden });
    label.append(` ${spot.label}`);
    input.onchange = () => draw();
    return { label, input };
  });
  const readings = pictures.readings.map(({ label }) => {
    const row = element("div", values);
    element("dt", row, { textContent: label });
    return { row, value: element("dd", row) };
  });

  let playing = 0;
  if (pictures.plays_s !== null) {
    const button = element("button", controls, { type: "button", textContent: "Play" });
    const stop = () => { cancelAnimationFrame(playing); playing = 0; button.textContent = "Play"; };
    button.onclick = () => {
      if (playing) return stop();
      if (now === x.length - 1) moved(0);
      const [began, from] = [performance.now(), x[now]];
      button.textContent = "Pause";
      const step = (time) => {
        const at = from + (time - began) / 1000 / pictures.plays_s;
        let next = now;
        while (next + 1 < x.length && x[next + 1] <= at) next++;
        if (next !== now) moved(next);
        if (now === x.length - 1) return stop();
        playing = requestAnimationFrame(step);
      };
      playing = requestAnimationFrame(step);
    };
  }
  switches.forEach(({ label }) => controls.append(label));

  /** The last picture that is not later than the place. */
  function picture() {
    let k = 0;
    while (k + 1 < pictures.places.length && pictures.places[k + 1] <= now) k++;
    if (!images.has(k)) {
      const image = new Image();
      image.onload = () => draw();
      image.src = `data:image/jpeg;base64,${pictures.pictures[k]}`;
      images.set(k, image);
    }
    return images.get(k);
  }

  /** Depth in millimetres along the left edge, a tick every 5 mm. */
  function depthScale(context, scale, ratio) {
    if (pictures.spacing_mm === null) return;
    const [, top, , height] = pictures.shown_px;
    context.font = `${11 * ratio}px system-ui, sans-serif`;
    context.textBaseline = "middle";
    context.lineWidth = ratio;
    context.strokeStyle = context.fillStyle = "#b8b8b8";
    for (let mm = 5; mm / pictures.spacing_mm < top + height; mm += 5) {
      const y = Math.round((mm / pictures.spacing_mm - top) * scale) + 0.5;
      const length = (mm % 10 === 0 ? 9 : 5) * ratio;
      context.beginPath();
      context.moveTo(0, y);
      context.lineTo(length, y);
      context.stroke();
      if (mm % 10) continue;
      const text = mm === 10 ? "10 mm" : String(mm);
      context.fillStyle = "#0009";
      context.fillRect(length + 2 * ratio, y - 7 * ratio, context.measureText(text).width + 4 * ratio, 14 * ratio);
      context.fillStyle = "#d0d0d0";
      context.fillText(text, length + 4 * ratio, y);
    }
  }

  function draw() {
    const [left, top, width, height] = pictures.shown_px;
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * ratio);
    const scale = canvas.width / width;
    canvas.height = Math.round(height * scale);
    canvas.style.aspectRatio = `${width} / ${height}`;
    const context = canvas.getContext("2d");
    const image = picture();
    if (!image.complete || !image.naturalWidth) return;
    const [kx, ky] = [image.naturalWidth / pictures.size_px[0], image.naturalHeight / pictures.size_px[1]];
    context.drawImage(image, left * kx, top * ky, width * kx, height * ky, 0, 0, canvas.width, canvas.height);
    depthScale(context, scale, ratio);
    const band = data.bands.find((band) => band.from <= x[now] && x[now] < band.to) ?? data.bands.at(-1);
    const own = band ? data.band_kinds[band.kind].colour : "green";
    pictures.spots.forEach((spot, k) => {
      const at = spot.at_px[now];
      if (!switches[k].input.checked || at === null) return;
      const [cx, cy] = [(at[0] - left) * scale, (at[1] - top) * scale];
      context.strokeStyle = colour(`over-${spot.colour ?? own}`);
      context.lineWidth = 1.75 * ratio;
      context.beginPath();
      if (spot.shape === "box") {
        const side = spot.side_px * scale;
        context.rect(cx - side / 2, cy - side / 2, side, side);
      } else {
        const [near, far] = [4 * ratio, 11 * ratio];
        for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
          context.moveTo(cx + near * dx, cy + near * dy);
          context.lineTo(cx + far * dx, cy + far * dy);
        }
      }
      context.stroke();
    });
    const shows_hidden = pictures.spots.some((spot, k) => spot.hidden && switches[k].input.checked);
    pictures.readings.forEach((reading, k) => {
      readings[k].row.hidden = reading.hidden && !shows_hidden;
      readings[k].row.style.display = readings[k].row.hidden ? "none" : "";
      readings[k].value.textContent = reading.values[now];
    });
  }

  new ResizeObserver(draw).observe(canvas.parentElement);
  return (index) => { now = index; slider.value = index; draw(); };
}

let charts_made = 0;

function charts(holder) {
  const data = JSON.parse(holder.querySelector("script").textContent);
  if (data.x.length === 0) { holder.textContent = "There is nothing to draw."; return null; }
  const { x } = data;
  const key = `charts-${charts_made++}`;
  holder.classList.toggle("with-player", data.pictures !== null);
  const show = data.pictures ? player(holder, data, place) : () => {};
  const box = element("div", holder);
  const legend = element("div", box, { className: "legend" });
  for (const kind of data.band_kinds) {
    const item = element("span", legend);
    element("i", item).style.background = `var(--${kind.colour})`;
    item.append(kind.label);
  }
  const hint = "Arrow keys go from image to image (with shift by ten), drag to zoom, double click to see all.";
  element("div", box, { className: "hint", textContent: data.pictures ? hint : hint.replace("image to image", "value to value") });

  let [plots, now, placing] = [[], x.length - 1, false];
  const panels = (data.bands.length + data.moments.length ? [null] : []).concat(data.panels);
  const places = panels.map((panel) => {
    const place = element("div", box, { className: "panel" });
    if (panel === null) return { place, values: [] };
    const name = element("div", place, { className: "name", textContent: panel.title });
    const item = (label, shade, style) => {
      if (!label) return null;
      const span = element("span", name);
      Object.assign(element("i", span).style, { borderTopColor: `var(--${shade})`, borderTopStyle: style });
      span.append(label);
      return element("b", span);
    };
    const values = panel.series.map((s) => item(s.label, s.colour, s.dotted ? "dotted" : "solid"));
    panel.levels.forEach((level) => item(`${level.label} ${NUMBER.format(level.value)}`, level.colour, "dashed")?.remove());
    return { place, values };
  });

  /** Bands, moments and levels of one panel; the topmost has bands alone, with words at the moments. */
  function backdrop(u, panel) {
    const { ctx, bbox } = u;
    const ratio = uPlot.pxRatio;
    const px = (at) => u.valToPos(at, "x", true);
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    const top = panel ? bbox.top : bbox.top + bbox.height - 12 * ratio;
    ctx.globalAlpha = panel ? Number(colour("band")) : 1;
    for (const band of data.bands) {
      ctx.fillStyle = colour(data.band_kinds[band.kind].colour);
      ctx.fillRect(px(band.from), top, px(band.to) - px(band.from), bbox.height);
    }
    ctx.globalAlpha = 1;
    ctx.lineWidth = ratio;
    let free = -Infinity;
    for (const moment of data.moments) {
      const at = px(moment.at);
      ctx.strokeStyle = ctx.fillStyle = colour(moment.colour);
      ctx.setLineDash([3 * ratio, 3 * ratio]);
      ctx.beginPath();
      ctx.moveTo(at, bbox.top);
      ctx.lineTo(at, bbox.top + bbox.height);
      ctx.stroke();
      if (panel) continue;
      ctx.font = `${12 * ratio}px system-ui, sans-serif`;
      ctx.textBaseline = "top";
      const text = moment.label.length > 60 ? `${moment.label.slice(0, 59)}…` : moment.label;
      const width = ctx.measureText(text).width;
      const left = clamp(at + 4 * ratio, bbox.left, bbox.left + bbox.width - width);
      if (left < free || at < bbox.left || at > bbox.left + bbox.width) continue;
      ctx.fillText(text, left, bbox.top + 1 * ratio);
      free = left + width + 10 * ratio;
    }
    ctx.setLineDash([6 * ratio, 4 * ratio]);
    for (const level of panel?.levels ?? []) {
      const at = u.valToPos(level.value, "y", true);
      ctx.strokeStyle = colour(level.colour);
      ctx.beginPath();
      ctx.moveTo(bbox.left, at);
      ctx.lineTo(bbox.left + bbox.width, at);
      ctx.stroke();
    }
    ctx.restore();
  }

  function plot(panel, place, is_last, width) {
    const [ink, line, font] = [colour("quiet"), colour("line"), "12px system-ui, sans-serif"];
    const grid = { stroke: line, width: 1 };
    const limits = panel ? range(panel) : [0, 1];
    const x_axis = { stroke: ink, font, grid, ticks: { show: false }, size: 6, values: () => [] };
    if (is_last) Object.assign(x_axis, { size: 24, label: data.x_label, labelFont: font, labelSize: 16, labelGap: 2, values: undefined });
    const series = (panel?.series ?? []).map((s) => ({
      stroke: colour(s.colour), width: 1.5, dash: s.dotted ? [2, 3] : undefined, points: { show: false },
    }));
    return new uPlot({
      width,
      height: (panel ? 122 : 38) + (is_last ? 34 : 0),
      padding: [4, 8, 0, panel ? 0 : AXIS_PX],
      legend: { show: false },
      cursor: { y: false, sync: { key, scales: ["x", null] }, points: { size: 6 }, drag: { x: true, y: false, dist: 4 } },
      scales: {
        x: { time: false, range: (u, low, high) => (high > low ? [low, high] : [low - 0.5, low + 0.5]) },
        y: { range: () => limits },
      },
      axes: panel
        ? [x_axis, { stroke: ink, font, grid, ticks: { show: false }, size: AXIS_PX, gap: 6, space: 26 }]
        : [{ show: false }, { show: false }],
      series: [{}, ...(panel ? series : [{ show: false }])],
      hooks: { drawClear: [(u) => backdrop(u, panel)], setCursor: [moved] },
    }, [x, ...(panel ? panel.series.map((s) => s.values) : [x.map(() => null)])], place);
  }

  /** The pointer moved, in this panel or in another. */
  function moved(u) {
    if (placing || u !== plots[0]) return;
    const { idx } = u.cursor;
    // It left: the line stays where it was last.
    if (idx === null || idx === undefined) requestAnimationFrame(() => place(now)); else tell(idx);
  }

  function tell(index) {
    now = index;
    places.forEach(({ values }, p) => values.forEach((cell, k) => {
      const value = panels[p].series[k].values[index];
      if (cell) cell.textContent = value === null ? "–" : NUMBER.format(value);
    }));
    show(index);
  }

  function place(index) {
    tell(clamp(index, 0, x.length - 1));
    placing = true;
    for (const u of plots) u.setCursor({ left: u.valToPos(x[now], "x"), top: 0 });
    placing = false;
  }

  function build(width = box.clientWidth) {
    plots.forEach((u) => u.destroy());
    plots = panels.map((panel, k) => plot(panel, places[k].place, k === panels.length - 1, width));
    place(now);
  }

  now = 0;
  build();
  let drawn_width = box.clientWidth;
  new ResizeObserver(() => {
    if (root.classList.contains("paper") || box.clientWidth === drawn_width || box.clientWidth === 0) return;
    drawn_width = box.clientWidth;
    build();
  }).observe(box);
  return { x, build, place, step: (by) => place(now + by), end: (last) => place(last ? x.length - 1 : 0) };
}

const all = [...document.querySelectorAll(".charts")].map(charts).filter((made) => made !== null);

for (const row of document.querySelectorAll("tr[data-at]")) {
  const go = () => {
    document.querySelectorAll("tr.now").forEach((other) => other.classList.remove("now"));
    row.classList.add("now");
    all.forEach((made) => made.place(nearest(made.x, Number(row.dataset.at))));
  };
  row.onclick = go;
  row.onkeydown = (event) => { if (event.key === "Enter") go(); };
}

document.addEventListener("keydown", (event) => {
  if (all.length === 0 || event.ctrlKey || event.altKey || event.metaKey) return;
  const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  const is_slider = event.target.type === "range";
  if (by) all.forEach((made) => made.step(event.shiftKey ? 10 * by : by));
  else if (is_slider && (event.key === "Home" || event.key === "End")) all.forEach((made) => made.end(event.key === "End"));
  else return;
  event.preventDefault();
});

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => all.forEach((made) => made.build()));
let folded = [];
addEventListener("beforeprint", () => {
  root.classList.add("paper");
  folded = [...document.querySelectorAll("details:not([open])")];
  folded.forEach((details) => { details.open = true; });
  all.forEach((made) => made.build(PAPER_PX));
});
addEventListener("afterprint", () => {
  root.classList.remove("paper");
  folded.forEach((details) => { details.open = false; });
  all.forEach((made) => made.build());
});
})();
