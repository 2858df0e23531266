"use strict";
// The ship from above, bow up, with the force of each component; beside it their numbers.
const Forces = {
  // Largest force and moment of any component over the run: the scale of the arrows.
  largest(run, model) {
    const top = (values) => values.reduce((most, v) => (v === null ? most : Math.max(most, Math.abs(v))), 0);
    const own = forcesOf(run, model);
    return {
      force: Math.max(1e-12, ...own.map((role) => Math.max(top(role[0]), top(role[1])))),
      moment: Math.max(1e-12, ...own.map((role) => top(role[2]))),
    };
  },

  scaleOf(run, model) {
    run.scales = run.scales || new Map();
    if (!run.scales.has(model)) run.scales.set(model, this.largest(run, model));
    return run.scales.get(model);
  },

  at(run, model, row) {
    const own = forcesOf(run, model);
    if (!own.length) return [];
    const { force, moment } = this.scaleOf(run, model);
    return VIEW.models[model].roles.map((role, i) => {
      const [X, Y, N] = own[i].map((column) => column[row]);
      const look = ROLE_LOOKS[i % ROLE_LOOKS.length];
      return { role, X, Y, N, look, foot: (VIEW.places[role] || 0) * VIEW.length, reach: 1 / force, turn: 1 / moment };
    }).filter((one) => one.X !== null && one.Y !== null && one.N !== null);
  },

  draw(found) {
    const { c, width, height } = prepared(document.getElementById("body"));
    const long = 0.6 * height, scale = long / VIEW.length, broad = Math.max(VIEW.breadth * scale, 14) / 2;
    const x = width / 2, y = height / 2, reach = 0.42 * Math.min(width, height);
    c.beginPath();
    [[0.5, 0], [0.32, 1], [-0.5, 1], [-0.5, -1], [0.32, -1]].forEach(([ahead, right], i) => {
      if (i) c.lineTo(x + right * broad, y - ahead * long); else c.moveTo(x + right * broad, y - ahead * long);
    });
    c.closePath();
    c.fillStyle = "#eceff2";
    c.fill();
    stroke(c, { color: "#77808a", dash: [], width: 1 });
    c.stroke();
    found.forEach(({ X, Y, N, foot, look, reach: unit, turn }, i) => {
      const at = y - foot * scale;
      c.strokeStyle = look.color;
      c.lineWidth = 2.4;
      arrow(c, x, at, reach * Y * unit, -reach * X * unit, look.dash);
      this.turned(c, x, y, broad + 9 + 6 * i, N * turn, look);
    });
    c.fillStyle = "#545e68";
    c.font = "11px system-ui";
    c.textAlign = "center";
    c.fillText("bow", x, 12);
  },

  // A moment as an arc about midship, clockwise where it turns the bow to starboard; half a turn is the largest.
  turned(c, x, y, radius, share, look) {
    const angle = Math.PI * Math.max(-1, Math.min(1, share));
    if (Math.abs(angle) < 0.06) return;
    const end = -Math.PI / 2 + angle;
    stroke(c, { ...look, width: 1.6 });
    c.beginPath();
    c.arc(x, y, radius, -Math.PI / 2, end, angle < 0);
    c.stroke();
    const side = Math.sign(angle), along = end + (side * Math.PI) / 2;
    const tip = [x + radius * Math.cos(end), y + radius * Math.sin(end)];
    c.setLineDash([]);
    c.beginPath();
    for (const spread of [-0.5, 0.5]) {
      c.moveTo(...tip);
      c.lineTo(tip[0] - 7 * Math.cos(along + spread), tip[1] - 7 * Math.sin(along + spread));
    }
    c.stroke();
  },

  buildTable(model) {
    const table = document.getElementById("forces"), head = element("thead"), body = element("tbody"), row = element("tr");
    table.replaceChildren(head, body);
    for (const words of ["component", "X [N]", "Y [N]", "N [N m]"]) row.append(element("th", words));
    head.append(row);
    this.cells = new Map();
    const roles = VIEW.models[model] ? VIEW.models[model].roles : [];
    [...roles, ...(roles.length ? ["sum"] : [])].forEach((role, i) => {
      const line = element("tr", "", role === "sum" ? { class: "total" } : {}), name = element("th", role.replace("_", " "));
      if (role !== "sum") { name.prepend(sample(ROLE_LOOKS[i % ROLE_LOOKS.length], 22, 10)); }
      const cells = [element("td"), element("td"), element("td")];
      line.append(name, ...cells);
      body.append(line);
      this.cells.set(role, cells);
    });
  },

  write(found) {
    const sum = [0, 0, 0];
    for (const [role, cells] of this.cells) {
      const own = found.find((one) => one.role === role);
      if (role === "sum") continue;
      const values = own ? [own.X, own.Y, own.N] : [null, null, null];
      values.forEach((value, i) => { cells[i].textContent = threeFigures(value); sum[i] += value === null ? NaN : value; });
    }
    if (this.cells.has("sum")) this.cells.get("sum").forEach((cell, i) => { cell.textContent = threeFigures(sum[i]); });
  },
};
