// Four plots over one time axis under one cursor; the tracker's state is a band on top of each.

import uPlot from "uplot";
import { colour, STATE_COLOURS } from "./colours.js";

const PLOTS = [
  { name: "NCC", range: [0, 1], lines: [["with last image", "ncc_previous", "blue", "loss_ncc_previous"], ["with first image", "ncc_anchor", "orange", "loss_ncc_anchor"]] },
  { name: "tip error, mm (truth)", least: 1, lines: [["while tracking", "tip_error_mm", "turquoise"]] },
  { name: "tip off the plane, mm (truth)", around: 1, lines: [["true distance", "plane_offset_mm", "turquoise"]] },
  { name: "contact force, N", least: 2, lines: [["measured", "force_n", "blue", "max_contact_force_n"]] },
];
const EVERY_MS = 100;
const BAND_PX = 5;

export class Plots {
  constructor(root) {
    this.rows = [];
    this.plots = PLOTS.map((spec) => {
      const element = root.appendChild(document.createElement("div"));
      element.className = "plot";
      const head = element.appendChild(document.createElement("div"));
      const body = element.appendChild(document.createElement("div"));
      return { spec, head, body };
    });
    new ResizeObserver(() => this.size()).observe(root);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.setting && this.begin(this.setting, this.rows));
  }

  begin(setting, rows) {
    this.setting = setting;
    this.rows = rows;
    for (const plot of this.plots) {
      plot.chart?.destroy();
      const { spec } = plot;
      plot.head.textContent = spec.name;
      plot.values = spec.lines.map(([label, , of]) => {
        const span = plot.head.appendChild(document.createElement("span"));
        span.style.color = colour(of);
        span.dataset.label = label;
        span.textContent = label;
        return span;
      });
      plot.chart = new uPlot(this.options(plot), [[], ...spec.lines.map(() => [])], plot.body);
    }
    this.dirty = true;
    this.later();
  }

  options({ spec, body, values }) {
    const axis = { stroke: colour("quiet"), grid: { stroke: colour("line"), width: 1 }, ticks: { show: false }, font: "11px system-ui" };
    const range = (_, low, high) => {
      if (spec.range) return [Math.min(spec.range[0], low ?? 0), spec.range[1]];
      if (spec.around) {
        const reach = Math.max(spec.around, Math.abs(low ?? 0), Math.abs(high ?? 0)) * 1.1;
        return [-reach, reach];
      }
      return [Math.min(0, low ?? 0), Math.max(spec.least, high ?? 0) * 1.1];
    };
    return {
      width: Math.max(body.clientWidth, 50),
      height: Math.max(body.clientHeight, 40),
      legend: { show: false },
      padding: [BAND_PX + 3, 14, 0, 0],
      cursor: { sync: { key: "time" }, y: false, drag: { x: false, y: false }, points: { size: 5 } },
      scales: { x: { time: false, range: (_, low, high) => [0, Math.max(4, high ?? 0)] }, y: { range } },
      axes: [{ ...axis, size: 18, gap: 2, values: (_, all) => all.map((s) => `${s} s`) }, { ...axis, size: 44, gap: 3, space: 22 }],
      series: [{}, ...spec.lines.map(([, , of]) => ({ stroke: colour(of), width: 1.5, spanGaps: false, points: { show: false } }))],
      hooks: {
        draw: [(chart) => this.marks(chart, spec)],
        setCursor: [({ cursor: { idx } }) => this.read(spec, values, idx)],
      },
    };
  }

  marks(chart, spec) {
    const { ctx, bbox } = chart;
    const ratio = devicePixelRatio;
    ctx.save();
    for (const [from, to, state] of this.bands()) {
      ctx.fillStyle = colour(STATE_COLOURS[state] ?? "grey");
      const [x, end] = [from, to].map((t) => chart.valToPos(t, "x", true));
      ctx.fillRect(x, bbox.top - (BAND_PX + 1) * ratio, Math.max(end - x, 1), BAND_PX * ratio);
    }
    ctx.setLineDash([4 * ratio, 4 * ratio]);
    ctx.lineWidth = ratio;
    for (const [, , of, level] of spec.lines) {
      const value = this.setting[level];
      if (value === undefined || value === null || value > chart.scales.y.max) continue;
      ctx.strokeStyle = colour(of);
      const y = chart.valToPos(value, "y", true);
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    ctx.restore();
  }

  bands() {
    const bands = [];
    for (const { t_s, state } of this.rows) {
      const last = bands.at(-1);
      if (last) last[1] = t_s;
      if (last?.[2] !== state) bands.push([t_s, t_s, state]);
    }
    return bands;
  }

  /** Values under the cursor, else the newest. */
  read(spec, values, idx) {
    const row = this.rows[idx ?? this.rows.length - 1];
    spec.lines.forEach(([label, key], k) => {
      const value = row?.[key];
      values[k].textContent = `${label} ${value === null || value === undefined ? "–" : value.toFixed(2)}`;
    });
  }

  changed() {
    this.dirty = true;
    this.later();
  }

  later() {
    this.timer ??= setTimeout(() => {
      this.timer = null;
      if (this.dirty) this.draw();
    }, EVERY_MS);
  }

  draw() {
    this.dirty = false;
    const t = this.rows.map((row) => row.t_s);
    for (const { chart, spec, values } of this.plots) {
      chart?.setData([t, ...spec.lines.map(([, key]) => this.rows.map((row) => row[key]))]);
      if (chart) this.read(spec, values, chart.cursor.idx);
    }
  }

  size() {
    for (const { chart, body } of this.plots) chart?.setSize({ width: Math.max(body.clientWidth, 50), height: Math.max(body.clientHeight, 40) });
  }
}
