"use strict";
// The track, north up: measured and predicted lines, outlines of the ship, missing force, and what moves with time.
const Track = {
  middle: [0, 0], // north, east [m]
  scale: 1, // pixels per metre
  size: [1, 1],

  build(redraw) {
    this.canvas = document.getElementById("track");
    this.now = document.getElementById("track-now");
    let last = null;
    this.now.addEventListener("pointerdown", (event) => { last = [event.clientX, event.clientY]; this.now.setPointerCapture(event.pointerId); });
    this.now.addEventListener("pointermove", (event) => {
      if (!last) return;
      this.middle = [this.middle[0] + (event.clientY - last[1]) / this.scale, this.middle[1] - (event.clientX - last[0]) / this.scale];
      last = [event.clientX, event.clientY];
      redraw();
    });
    for (const name of ["pointerup", "pointercancel"]) this.now.addEventListener(name, () => { last = null; });
    this.now.addEventListener("wheel", (event) => {
      event.preventDefault();
      const box = this.now.getBoundingClientRect();
      this.zoom(Math.exp(-0.0015 * event.deltaY), event.clientX - box.left, event.clientY - box.top);
      redraw();
    }, { passive: false });
    new ResizeObserver(redraw).observe(document.getElementById("track-box"));
  },

  zoom(factor, x = this.size[0] / 2, y = this.size[1] / 2) {
    const [north, east] = this.place(x, y);
    this.scale *= factor;
    this.middle = [north + (y - this.size[1] / 2) / this.scale, east - (x - this.size[0] / 2) / this.scale];
  },

  place(x, y) {
    return [this.middle[0] - (y - this.size[1] / 2) / this.scale, this.middle[1] + (x - this.size[0] / 2) / this.scale];
  },

  pixel(north, east) {
    return [this.size[0] / 2 + (east - this.middle[1]) * this.scale, this.size[1] / 2 - (north - this.middle[0]) * this.scale];
  },

  // All of the measured track within rows, and of predictions that stay near it, in the panel.
  fit(run, windows, visible, rows) {
    const box = this.now.getBoundingClientRect();
    this.size = [Math.max(1, box.width), Math.max(1, box.height)];
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    const add = (states, near) => {
      for (let i = rows[0]; i <= rows[1]; i++) {
        const at = [states[0][i], states[1][i]];
        if (at[0] === null || at[1] === null) continue;
        if (near && at.some((value, k) => value < near[0][k] || value > near[1][k])) continue;
        at.forEach((value, k) => { low[k] = Math.min(low[k], value); high[k] = Math.max(high[k], value); });
      }
    };
    add(run.states, null);
    const room = 0.4 * Math.max(high[0] - low[0], high[1] - low[1], 2 * VIEW.length);
    const near = Number.isFinite(room) ? [low.map((v) => v - room), high.map((v) => v + room)] : null;
    windows.forEach((w, i) => { if (visible[i]) add(w.states, near); });
    if (!Number.isFinite(low[0])) { low.fill(-VIEW.length); high.fill(VIEW.length); }
    const span = [high[0] - low[0] + 1.6 * VIEW.length, high[1] - low[1] + 1.6 * VIEW.length];
    this.middle = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
    this.scale = Math.min((this.size[1] - 50) / span[0], (this.size[0] - 60) / span[1]);
  },

  grid(c, width, height) {
    const step = roundStep(width / this.scale, 7);
    const [top, left] = this.place(0, 0), [bottom, right] = this.place(width, height);
    c.font = "11px system-ui";
    c.fillStyle = "#545e68";
    c.strokeStyle = "#e7e7e7";
    c.lineWidth = 1;
    c.textAlign = "center";
    for (let east = Math.ceil(left / step) * step; east <= right; east += step) {
      const [x] = this.pixel(0, east);
      c.beginPath(); c.moveTo(x, 0); c.lineTo(x, height - 16); c.stroke();
      if (x > 45 && x < width - 75) c.fillText(Charts.tick(Number(east.toPrecision(10))), x, height - 4);
    }
    c.textAlign = "left";
    for (let north = Math.ceil(bottom / step) * step; north <= top; north += step) {
      const [, y] = this.pixel(north, 0);
      c.beginPath(); c.moveTo(38, y); c.lineTo(width, y); c.stroke();
      if (y > 22 && y < height - 22) c.fillText(Charts.tick(Number(north.toPrecision(10))), 3, y + 4);
    }
    c.fillText("y, east [m]", width - 68, height - 4);
    c.fillText("x, north [m]", 3, 13);
  },

  line(c, states, rows, starts, look) {
    stroke(c, look);
    c.beginPath();
    const fresh = new Set(starts);
    let down = false;
    for (let i = rows[0]; i <= rows[1]; i++) {
      const north = states[0][i], east = states[1][i];
      if (north === null || east === null) { down = false; continue; }
      const [x, y] = this.pixel(north, east);
      if (!down || fresh.has(i)) c.moveTo(x, y); else if (Math.abs(x) < 1e5 && Math.abs(y) < 1e5) c.lineTo(x, y);
      down = true;
    }
    c.stroke();
  },

  outline(c, north, east, psi, look, fill) {
    const L = VIEW.length, b = VIEW.breadth / 2;
    const body = [[0.5 * L, 0], [0.32 * L, b], [-0.5 * L, b], [-0.5 * L, -b], [0.32 * L, -b]];
    stroke(c, look);
    c.beginPath();
    body.forEach(([ahead, right], i) => {
      const [x, y] = this.pixel(north + ahead * Math.cos(psi) - right * Math.sin(psi), east + ahead * Math.sin(psi) + right * Math.cos(psi));
      if (i) c.lineTo(x, y); else c.moveTo(x, y);
    });
    c.closePath();
    if (fill) { c.fillStyle = fill; c.fill(); }
    c.stroke();
  },

  // Everything that does not move with time. rows: first and last row shown; pale: whether rows outside are drawn too.
  draw(run, windows, visible, rows, showMissing) {
    const { c, width, height } = prepared(this.canvas);
    this.size = [width, height];
    this.grid(c, width, height);
    const every = [0, run.t.length - 1], part = rows[0] > 0 || rows[1] < every[1];
    if (part) this.line(c, run.states, every, [], { color: "#c4c9ce", dash: [], width: 1 });
    const starts = windows.length ? windows[0].starts : [];
    this.line(c, run.states, rows, [], MEASURED);
    windows.forEach((w, i) => { if (visible[i]) this.line(c, w.states, rows, w.starts, MODEL_LOOKS[i]); });
    for (const row of starts) {
      if (row < rows[0] || row > rows[1]) continue;
      const [north, east, psi] = [0, 1, 2].map((k) => run.states[k][row]);
      if (north === null || east === null || psi === null) continue;
      this.outline(c, north, east, psi, { color: "#77808a", dash: [], width: 0.9 }, null);
    }
    this.mooring(c, run, showMissing);
  },

  // Missing force of a diagnosis: arrows of one scale along the measured track; a ring is a moment, filled: to starboard.
  mooring(c, run, shown) {
    if (!run.missing || !shown) return;
    const { t, force } = run.missing, size = force[0].map((X, i) => Math.hypot(X, force[1][i]));
    const largest = [...size].sort((a, b) => a - b)[Math.floor(0.97 * (size.length - 1))] || 1;
    const turns = force[2].map(Math.abs), turn = [...turns].sort((a, b) => a - b)[Math.floor(0.97 * (turns.length - 1))] || 1;
    const every = Math.max(1, Math.round(t.length / 60));
    for (let i = 0; i < t.length; i += every) {
      const row = nearestRow(run.t, t[i]), [north, east, psi] = [0, 1, 2].map((k) => run.states[k][row]);
      if (north === null || east === null || psi === null) continue;
      const [x, y] = this.pixel(north, east), reach = 46 / largest;
      const [X, Y] = [force[0][i], force[1][i]];
      c.strokeStyle = "#c0305a";
      c.lineWidth = 1.6;
      arrow(c, x, y, reach * (X * Math.sin(psi) + Y * Math.cos(psi)), -reach * (X * Math.cos(psi) - Y * Math.sin(psi)));
      c.beginPath();
      c.arc(x, y, 5 * Math.sqrt(Math.min(1, turns[i] / turn)), 0, 2 * Math.PI);
      c.fillStyle = force[2][i] > 0 ? "#c0305a" : "#ffffff";
      c.fill();
      c.lineWidth = 1;
      c.stroke();
    }
  },

  // What moves with time: ships, the 90 % region, arrows of the forces.
  drawNow(run, windows, visible, row, forces, bands) {
    const { c } = prepared(this.now);
    windows.forEach((w, i) => {
      if (!visible[i]) return;
      const [north, east, psi] = [0, 1, 2].map((k) => w.states[k][row]);
      if (north === null) return;
      if (bands && w.std && w.std[0][row] !== null) {
        const [x, y] = this.pixel(north, east);
        c.beginPath();
        c.ellipse(x, y, REGION * w.std[1][row] * this.scale, REGION * w.std[0][row] * this.scale, 0, 0, 2 * Math.PI);
        c.fillStyle = MODEL_LOOKS[i].color + "24";
        c.fill();
        stroke(c, { ...MODEL_LOOKS[i], width: 0.8, dash: [3, 3] });
        c.stroke();
      }
      this.outline(c, north, east, psi, MODEL_LOOKS[i], null);
    });
    const [north, east, psi] = [0, 1, 2].map((k) => run.states[k][row]);
    if (north === null || east === null || psi === null) return;
    this.outline(c, north, east, psi, { ...MEASURED, width: 1.4 }, "rgba(17, 17, 17, .18)");
    if (!forces) return;
    for (const { X, Y, foot, look, reach } of forces) {
      const [x, y] = this.pixel(north + foot * Math.cos(psi), east + foot * Math.sin(psi));
      c.strokeStyle = look.color;
      c.lineWidth = 2;
      const [right, up] = [X * Math.sin(psi) + Y * Math.cos(psi), X * Math.cos(psi) - Y * Math.sin(psi)];
      arrow(c, x, y, 60 * reach * right, -60 * reach * up, look.dash);
    }
  },
};

function nearestRow(t, time) {
  let low = 0, high = t.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (t[middle] <= time) low = middle; else high = middle;
  }
  return time - t[low] < t[high] - time ? low : high;
}
