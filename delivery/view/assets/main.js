"use strict";
// What is chosen, and what follows from it.
const byId = (id) => document.getElementById(id);
const Chosen = {
  run: 0, length: 0, window: -1, row: 0, bands: true, arrows: true, missing: true, playing: false,
  visible: VIEW.models.map(() => true),
  forceModel: Math.max(0, VIEW.models.findIndex((m) => m.kind === "calibrated" && m.roles.length), VIEW.models.findIndex((m) => m.kind === "hybrid" && m.roles.length && !m.label.includes("not"))),
};
const KEYS = [
  ["← →", "one sample back, on (with shift: ten)"], ["space", "play or stop"], ["p n", "previous, next run"],
  ["w", "length of the prediction windows"], ["[ ]", "previous, next window alone; esc: all windows"], ["1 … 9", "a model on or off"],
  ["b", "90 % bands on or off"], ["f", "force arrows on or off"], ["m", "missing force on or off"], ["x", "component of the force"],
  ["+ − 0", "track closer, further, all of it"], ["home end", "start, end"], ["?", "these keys"],
];

const run = () => runOf(Chosen.run);
const windows = () => windowsOf(run(), Chosen.length);

// First and last row of the chosen window, or of all.
function shownRows() {
  const last = run().t.length - 1, starts = windows().length ? windows()[0].starts : [];
  if (Chosen.window < 0 || !starts.length) return [0, last];
  return [starts[Chosen.window], Chosen.window + 1 < starts.length ? starts[Chosen.window + 1] - 1 : last];
}

function drawTrack() {
  Track.draw(run(), windows(), Chosen.visible, shownRows(), Chosen.missing);
  drawNow();
}

function drawNow() {
  const forces = Forces.at(run(), Chosen.forceModel, Chosen.row);
  Track.drawNow(run(), windows(), Chosen.visible, Chosen.row, Chosen.arrows ? forces : null, Chosen.bands);
  Forces.draw(forces);
  Forces.write(forces);
  writeValues();
}

function setRow(row) {
  const last = run().t.length - 1;
  Chosen.row = Math.max(0, Math.min(last, row));
  byId("slider").value = Chosen.row;
  const time = run().t[Chosen.row];
  byId("time").textContent = `${number(time, 1)} of ${number(run().t[last], 1)} s`;
  Charts.mark(time);
  drawNow();
}

function showRun(number, keepLength = true) {
  const began = performance.now();
  Chosen.run = (number + VIEW.runs.length) % VIEW.runs.length;
  if (!keepLength) Chosen.length = 0;
  Chosen.window = -1;
  Chosen.row = 0;
  byId("run").value = Chosen.run;
  byId("slider").max = run().t.length - 1;
  const facts = VIEW.runs[Chosen.run];
  const words = [facts.role === "other" ? "" : facts.role, facts.kind, `${threeFigures(facts.duration)} s`, `${facts.samples} samples`, facts.position ? "" : "no measured position", ...VIEW.notes];
  byId("facts").textContent = words.filter(Boolean).join(" · ");
  byId("missing-label").hidden = !facts.missing;
  document.title = `${facts.name} – ${VIEW.ship}`;
  showWindows();
  queueMicrotask(() => queueMicrotask(() => { // after the charts, which draw in a microtask of their own
    document.documentElement.dataset.switched = (performance.now() - began).toFixed(1);
  }));
  setTimeout(prepareNext, 300);
}

// The runs beside the shown one are decoded while nothing else is to do.
function prepareNext() {
  for (const number of [Chosen.run + 1, Chosen.run - 1]) {
    const near = runOf((number + VIEW.runs.length) % VIEW.runs.length);
    windowsOf(near, Chosen.length);
    forcesOf(near, Chosen.forceModel);
  }
}

function showWindows() {
  const choice = byId("window"), starts = windows().length ? windows()[0].starts : [], t = run().t;
  choice.replaceChildren(element("option", `all ${starts.length}`, { value: -1 }));
  starts.forEach((row, i) => choice.append(element("option", `${i + 1}: from ${number(t[row], 0)} s`, { value: i })));
  if (Chosen.window >= starts.length) Chosen.window = -1;
  choice.value = Chosen.window;
  byId("length").value = Chosen.length;
  redrawAll(true);
}

function redrawAll(fit) {
  const rows = shownRows(), t = run().t;
  Charts.show(run(), Chosen.length, Chosen.forceModel, Chosen.visible, Chosen.bands);
  if (fit) {
    Charts.zoom(t[rows[0]], t[rows[1]]);
    Track.fit(run(), windows(), Chosen.visible, rows);
    if (Chosen.row < rows[0] || Chosen.row > rows[1]) Chosen.row = rows[0];
  }
  Track.draw(run(), windows(), Chosen.visible, rows, Chosen.missing);
  setRow(Chosen.row);
}

function chooseWindow(number) {
  const count = windows().length ? windows()[0].starts.length : 0;
  Chosen.window = Math.max(-1, Math.min(count - 1, number));
  byId("window").value = Chosen.window;
  Chosen.row = shownRows()[0];
  redrawAll(true);
}

function chooseLength(number) {
  Chosen.length = number % VIEW.lengths.length;
  Chosen.window = -1;
  showWindows();
}

function toggleModel(i) {
  if (i >= VIEW.models.length) return;
  Chosen.visible[i] = !Chosen.visible[i];
  byId(`model-${i}`).checked = Chosen.visible[i];
  redrawAll(false);
}

function toggle(name) {
  Chosen[name] = !Chosen[name];
  byId(name).checked = Chosen[name];
  redrawAll(false);
}

function play(on) {
  Chosen.playing = on;
  byId("play").textContent = on ? "■" : "▶";
  if (!on) return;
  const rows = shownRows(), t = run().t, rate = Math.max(1, (t[rows[1]] - t[rows[0]]) / 20); // at most 20 s
  let time = Chosen.row >= rows[1] ? t[rows[0]] : t[Chosen.row], last = performance.now();
  const step = (now) => {
    if (!Chosen.playing) return;
    time += (rate * (now - last)) / 1000;
    last = now;
    setRow(nearestRow(run().t, time));
    if (time >= t[rows[1]]) play(false); else requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

// Measured and predicted states at the chosen time, with deviations where they are known.
const COLUMNS = [["x [m]", 0, 1, 2], ["y [m]", 1, 1, 2], ["psi [deg]", 2, DEGREES, 1], ["u [m/s]", 3, 1, 3], ["v [m/s]", 4, 1, 3], ["r [deg/s]", 5, DEGREES, 2]];
function buildValues() {
  const table = byId("values"), head = element("thead"), body = element("tbody"), row = element("tr");
  row.append(element("th", "at this time"), ...COLUMNS.map(([words]) => element("th", words)), element("th", "off by [m]"));
  head.append(row);
  table.replaceChildren(head, body);
  return [{ label: "measured", look: MEASURED }, ...VIEW.models.map((m, i) => ({ label: m.label, look: MODEL_LOOKS[i] }))].map(({ label, look }) => {
    const line = element("tr"), name = element("th", label), cells = [...COLUMNS, 0].map(() => element("td"));
    name.prepend(sample(look, 26, 10));
    line.append(name, ...cells);
    body.append(line);
    return { line, cells };
  });
}

function writeValues() {
  const row = Chosen.row, measured = run().states;
  Lines.forEach(({ line, cells }, i) => {
    const model = i ? windows()[i - 1] : null, states = model ? model.states : measured;
    line.hidden = Boolean(model) && !Chosen.visible[i - 1];
    COLUMNS.forEach(([, k, factor, digits], column) => {
      const value = states[k][row], std = model && model.std ? model.std[k][row] : null;
      const words = number(value === null ? null : factor * value, digits);
      cells[column].textContent = std ? `${words} ± ${number(factor * BAND * std, digits)}` : words;
    });
    const [north, east] = measured, known = model && north[row] !== null && states[0][row] !== null;
    cells[COLUMNS.length].textContent = known ? number(Math.hypot(states[0][row] - north[row], states[1][row] - east[row]), 2) : "";
  });
}

function chooseForces(model) {
  Chosen.forceModel = model;
  byId("force-model").value = model;
  Forces.buildTable(model);
  Charts.nameForces(model);
}

function controls() {
  VIEW.runs.forEach((facts, i) => byId("run").append(element("option", facts.role === "other" ? facts.name : `${facts.name} (${facts.role})`, { value: i })));
  VIEW.lengths.forEach((length, i) => byId("length").append(element("option", length ? `restart every ${length} s` : "whole run", { value: i })));
  VIEW.models.forEach((model, i) => {
    const label = element("label", "", { title: `${model.run} (${i + 1})` }), box = element("input", "", { type: "checkbox", id: `model-${i}` });
    box.checked = true;
    box.addEventListener("change", () => toggleModel(i));
    label.append(box, sample(MODEL_LOOKS[i]), document.createTextNode(model.label));
    byId("models").append(label);
    if (model.roles.length) byId("force-model").append(element("option", model.label, { value: i }));
  });
  const measured = element("span");
  measured.append(sample(MEASURED), document.createTextNode(" measured"));
  byId("models").prepend(measured);
  byId("force-model").addEventListener("change", (event) => { chooseForces(Number(event.target.value)); redrawAll(false); });
  byId("run").addEventListener("change", (event) => showRun(Number(event.target.value)));
  byId("length").addEventListener("change", (event) => chooseLength(Number(event.target.value)));
  byId("window").addEventListener("change", (event) => chooseWindow(Number(event.target.value)));
  byId("slider").addEventListener("input", (event) => setRow(Number(event.target.value)));
  const clicks = {
    "run-back": () => showRun(Chosen.run - 1), "run-on": () => showRun(Chosen.run + 1),
    "window-back": () => chooseWindow(Chosen.window - 1), "window-on": () => chooseWindow(Chosen.window + 1),
    play: () => play(!Chosen.playing), "help-open": () => byId("help").showModal(),
    "zoom-in": () => { Track.zoom(1.4); drawTrack(); }, "zoom-out": () => { Track.zoom(1 / 1.4); drawTrack(); },
    fit: () => redrawAll(true),
  };
  for (const [id, act] of Object.entries(clicks)) byId(id).addEventListener("click", act);
  for (const name of ["bands", "arrows", "missing"]) byId(name).addEventListener("change", () => toggle(name));
  const rows = KEYS.map(([key, words]) => {
    const row = element("tr"), cell = element("td");
    cell.append(element("kbd", key));
    row.append(cell, element("td", words));
    return row;
  });
  byId("keys").replaceChildren(...rows);
  if (VIEW.diagnosis) {
    byId("diagnosis").hidden = false;
    byId("diagnosis").textContent = `Diagnosis ${VIEW.diagnosis.folder}: ${VIEW.diagnosis.sentence}`;
  }
}

function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || byId("help").open) return;
  const inside = event.target.tagName;
  if (inside === "SELECT" || (inside === "INPUT" && event.target.type === "range" && event.key.startsWith("Arrow"))) return;
  const far = event.shiftKey ? 10 : 1, channel = byId("channel");
  const acts = {
    ArrowLeft: () => setRow(Chosen.row - far), ArrowRight: () => setRow(Chosen.row + far), " ": () => play(!Chosen.playing),
    Home: () => setRow(shownRows()[0]), End: () => setRow(shownRows()[1]), p: () => showRun(Chosen.run - 1), n: () => showRun(Chosen.run + 1),
    w: () => chooseLength(Chosen.length + 1), "[": () => chooseWindow(Chosen.window - 1), "]": () => chooseWindow(Chosen.window + 1),
    Escape: () => chooseWindow(-1), b: () => toggle("bands"), f: () => toggle("arrows"), m: () => toggle("missing"),
    x: () => { if (channel) { channel.value = (Number(channel.value) + 1) % 3; redrawAll(false); } },
    "+": () => { Track.zoom(1.4); drawTrack(); }, "-": () => { Track.zoom(1 / 1.4); drawTrack(); }, 0: () => redrawAll(true),
    "?": () => byId("help").showModal(),
  };
  const act = acts[event.key] || (/^[1-9]$/.test(event.key) ? () => toggleModel(Number(event.key) - 1) : null);
  if (!act || (inside === "BUTTON" && event.key === " ") || (inside === "INPUT" && event.key === " ")) return;
  event.preventDefault();
  act();
}

const Lines = buildValues();
Charts.build(setRow, (low, high) => Charts.zoom(low, high), () => redrawAll(false));
controls();
chooseForces(Chosen.forceModel);
Track.build(() => { if (run()) drawTrack(); });
document.addEventListener("keydown", onKey);
showRun(Math.max(0, VIEW.runs.findIndex((facts) => facts.role === "held out")), false);
document.documentElement.dataset.ready = performance.now().toFixed(1);
