"use strict";
// Histories over time: one chart per quantity, all with the same time axis and the same cursor.
const STATES = [
  { index: 3, title: "u, ahead [m/s]", factor: 1 },
  { index: 4, title: "v, to starboard [m/s]", factor: 1 },
  { index: 5, title: "r, yaw rate [deg/s]", factor: DEGREES },
  { index: 2, title: "psi, heading [deg]", factor: DEGREES },
];
const CHANNELS = ["X, ahead [N]", "Y, to starboard [N]", "N, yaw moment [N m]"];

const Charts = {
  all: [],
  onTime: () => {},
  onRange: () => {},
  quiet: false,

  build(onTime, onRange, onChannel) {
    this.onTime = onTime;
    this.onRange = onRange;
    const place = document.getElementById("charts");
    if (VIEW.runs.some((run) => run.position)) {
      this.add(place, "distance from the measured position [m]", VIEW.models.map((m, i) => ({ label: m.label, look: MODEL_LOOKS[i] })), "error");
    }
    for (const state of STATES) {
      const series = [{ label: "measured", look: MEASURED }];
      const bands = [];
      VIEW.models.forEach((m, i) => {
        series.push({ label: m.label, look: MODEL_LOOKS[i], model: i });
        if (m.band) {
          series.push({ label: "", look: null, model: i }, { label: "", look: null, model: i });
          bands.push({ series: [series.length, series.length - 1], fill: MODEL_LOOKS[i].color + "2e" });
        }
      });
      this.add(place, state.title, series, "state", { state, bands });
    }
    for (const [unit, shown] of [["rad", "deg"], ["rps", "1/s"], ["m/s", "m/s"]]) {
      const own = VIEW.inputs.map((input, i) => ({ ...input, i })).filter((input) => input.unit === unit);
      if (own.length) {
        const series = own.map((input, k) => ({ label: input.name, look: ROLE_LOOKS[k], words: input.words }));
        const title = { rad: "rudder", rps: "revolutions", "m/s": "wind, towards north and east" }[unit];
        this.add(place, `${title} [${shown}]`, series, "input", { own });
      }
    }
    const most = Math.max(0, ...VIEW.models.map((m) => m.roles.length));
    if (most) {
      const chart = this.add(place, "force by component", ROLE_LOOKS.slice(0, most).map((look) => ({ label: "", look })), "force");
      const choice = element("select", "", { id: "channel", title: "component of the force (x)" });
      CHANNELS.forEach((words, i) => choice.append(element("option", words, { value: i })));
      choice.value = 1;
      choice.addEventListener("change", onChannel);
      chart.head.prepend(choice);
      chart.channel = choice;
    }
  },

  add(place, title, series, kind, extra = {}) {
    const box = element("div", "", { class: "chart" }), head = element("h3", title);
    if (kind === "input" || kind === "error") {
      for (const one of series) {
        const item = element("span", one.label, one.words ? { title: one.words } : {});
        item.prepend(sample(one.look, 26, 10));
        head.append(item);
      }
    }
    box.append(head);
    place.append(box);
    const chart = { box, head, series, kind, ...extra };
    const small = { size: 18, font: "11px system-ui", gap: 2, stroke: "#545e68", grid: { stroke: "#e4e4e4", width: 1 }, ticks: { show: false } };
    const options = {
      width: Math.max(200, box.clientWidth), height: kind === "force" ? 150 : 112, padding: [6, 8, 0, 0],
      legend: { show: false }, pxAlign: 1,
      scales: { x: { time: false }, y: { range: (u, low, high) => this.range(low, high) } },
      axes: [{ ...small }, { ...small, size: 52, values: (u, ticks) => ticks.map((v) => this.tick(v)) }],
      cursor: { y: false, drag: { x: true, y: false }, points: { size: 5 } },
      bands: (extra.bands || []).map((band) => ({ series: band.series, fill: band.fill })),
      series: [{}, ...series.map((one) => ({
        stroke: one.look ? one.look.color : "transparent", width: one.look ? one.look.width : 0,
        dash: one.look && one.look.dash.length ? one.look.dash : undefined, points: { show: false },
        gaps: (u, seriesIdx, i0, i1, gaps) => this.restarts(u, chart, gaps),
      }))],
      hooks: {
        setScale: [(u, key) => {
          if (key === "x" && !this.quiet && u.status === 1) this.onRange(u.scales.x.min, u.scales.x.max);
        }],
      },
    };
    chart.plot = new uPlot(options, [[0, 1], ...series.map(() => [null, null])], box);
    chart.plot.over.addEventListener("mousemove", (event) => this.onTime(chart.plot.posToIdx(event.offsetX)));
    chart.plot.over.addEventListener("mouseleave", () => this.mark(this.time));
    new ResizeObserver(() => {
      const width = Math.max(200, box.clientWidth);
      if (width !== chart.plot.width) chart.plot.setSize({ width, height: chart.plot.height });
    }).observe(box);
    this.all.push(chart);
    return chart;
  },

  tick(value) {
    return Math.abs(value) >= 1e5 || (value !== 0 && Math.abs(value) < 1e-3) ? value.toExponential(0) : String(Number(value.toPrecision(6))).replace("-", "−");
  },

  range(low, high) {
    if (low === null || high === null) return [0, 1];
    const room = 0.06 * (high - low) || 0.05 * Math.abs(high) || 1;
    return [low - room, high + room];
  },

  // No line runs from the end of a window to the start of the next one.
  restarts(u, chart, gaps) {
    if (!chart.starts) return gaps;
    const t = u.data[0], own = chart.starts.filter((row) => row > 0).map((row) => [u.valToPos(t[row - 1], "x", true), u.valToPos(t[row], "x", true)]);
    return [...gaps, ...own].sort((a, b) => a[0] - b[0]);
  },

  // Predictions that run away must not flatten what is measured.
  near(values, measured) {
    let low = Infinity, high = -Infinity;
    for (const value of measured) if (value !== null) { low = Math.min(low, value); high = Math.max(high, value); }
    const span = 1.5 * Math.max(high - low, 1e-9);
    return values.map((value) => (value === null || value < low - span || value > high + span ? null : value));
  },

  show(run, length, forceModel, visible, bands) {
    const windows = windowsOf(run, length);
    const starts = windows.length ? windows[0].starts : [];
    this.quiet = true;
    for (const chart of this.all) {
      chart.starts = chart.kind === "state" || chart.kind === "error" ? starts : null;
      chart.plot.setData([run.t, ...this.data(chart, run, windows, forceModel)], false);
      chart.series.forEach((one, i) => {
        const model = chart.kind === "error" ? i : one.model;
        const on = model === undefined || (visible[model] && (one.look !== null || bands));
        if (chart.plot.series[i + 1].show !== on) chart.plot.setSeries(i + 1, { show: on });
      });
    }
    this.quiet = false;
  },

  data(chart, run, windows, forceModel) {
    if (chart.kind === "error") {
      return windows.map((w) => w.states[0].map((x, i) => {
        const north = run.states[0][i], east = run.states[1][i];
        return x === null || north === null || east === null ? null : Math.hypot(x - north, w.states[1][i] - east);
      }));
    }
    if (chart.kind === "input") return chart.own.map((input) => run.inputs[input.i]);
    if (chart.kind === "force") {
      const own = forcesOf(run, forceModel), channel = Number(chart.channel ? chart.channel.value : 1);
      return chart.series.map((_, i) => (own[i] ? own[i][channel] : run.t.map(() => null)));
    }
    const { index, factor } = chart.state, scaled = (values) => values.map((v) => (v === null ? null : factor * v));
    const measured = scaled(run.states[index]), rows = [measured];
    VIEW.models.forEach((model, k) => {
      const w = windows[k], line = scaled(w.states[index]);
      rows.push(this.near(line, measured));
      if (model.band) {
        const std = w.std ? scaled(w.std[index]) : run.t.map(() => null);
        for (const side of [-BAND, BAND]) rows.push(this.near(line.map((v, i) => (v === null || std[i] === null ? null : v + side * std[i])), measured));
      }
    });
    return rows;
  },

  nameForces(model) {
    const chart = this.all.find((one) => one.kind === "force");
    if (!chart) return;
    for (const item of chart.head.querySelectorAll("span")) item.remove();
    (VIEW.models[model] ? VIEW.models[model].roles : []).forEach((role, i) => {
      const item = element("span", role.replace("_", " "));
      item.prepend(sample(ROLE_LOOKS[i % ROLE_LOOKS.length], 26, 10));
      chart.head.append(item);
    });
  },

  zoom(low, high) {
    this.quiet = true;
    for (const chart of this.all) chart.plot.setScale("x", { min: low, max: high });
    this.quiet = false;
  },

  mark(time) {
    this.time = time;
    for (const { plot } of this.all) {
      const left = plot.valToPos(time, "x");
      plot.setCursor({ left: left >= 0 && left <= plot.over.clientWidth ? left : -10, top: 0 }, false);
    }
  },
};
