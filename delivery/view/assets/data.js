"use strict";
// What the page holds, decoded when it is needed, and how each series looks: distinct dashes, so that grey suffices.
const VIEW = JSON.parse(document.getElementById("view-data").textContent);
const DEGREES = 180 / Math.PI;
const BAND = 1.645, REGION = 2.146; // 90 % of a normal distribution, in one and in two dimensions
const MEASURED = { color: "#111111", dash: [], width: 1.5 };
const LOOKS = [
  { color: "#d58a00", dash: [7, 3], width: 1.6 },
  { color: "#0072b2", dash: [], width: 2 },
  { color: "#009e73", dash: [2, 2], width: 2 },
  { color: "#a8497f", dash: [9, 3, 2, 3], width: 1.6 },
  { color: "#3a8fc4", dash: [14, 3], width: 1.6 },
  { color: "#5f6770", dash: [1, 4], width: 2 },
];
const ROLE_LOOKS = [
  { color: "#0072b2", dash: [], width: 1.6 },
  { color: "#d58a00", dash: [7, 3], width: 1.6 },
  { color: "#009e73", dash: [2, 2], width: 1.8 },
  { color: "#a8497f", dash: [9, 3, 2, 3], width: 1.6 },
  { color: "#5f6770", dash: [14, 3], width: 1.6 },
  { color: "#111111", dash: [1, 4], width: 1.8 },
  { color: "#8c5a00", dash: [4, 2, 1, 2], width: 1.6 },
  { color: "#3a8fc4", dash: [5, 5], width: 1.6 },
];
const KINDS = { start: 0, calibrated: 1, hybrid: 2, named: 4 };

// Every model has a look of its own; the usual kinds always have the same one.
function chooseLooks(models) {
  const free = LOOKS.map((_, i) => i), given = models.map(() => -1);
  models.forEach((model, i) => {
    const at = free.indexOf(KINDS[model.kind]);
    if (at >= 0) given[i] = free.splice(at, 1)[0];
  });
  return given.map((at) => LOOKS[at >= 0 ? at : free.length ? free.shift() : LOOKS.length - 1]);
}
const MODEL_LOOKS = chooseLooks(VIEW.models);

// The numbers of a base64 text, as `kind` (Int16Array, Float32Array); they are stored with the low byte first.
function numbersOf(text, kind) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return new kind(bytes.buffer);
}

// A column: [offset, scale, 16-bit integers in base64], null where nothing is known; times `factor`.
function decode(column, factor = 1) {
  const steps = numbersOf(column[2], Int16Array), values = new Array(steps.length);
  const offset = factor * column[0], scale = factor * column[1];
  for (let i = 0; i < steps.length; i++) values[i] = steps[i] === -32768 ? null : offset + scale * steps[i];
  return values;
}

const decodeTimes = (text) => Array.from(numbersOf(text, Float32Array));

const parsed = new Map(); // runs that were looked at, the last few
function runOf(number) {
  if (parsed.has(number)) return parsed.get(number);
  const raw = JSON.parse(document.getElementById("run-" + number).textContent);
  const run = { raw, t: decodeTimes(raw.t), states: raw.measured.map((c) => decode(c)), windows: new Map(), forces: new Map() };
  run.inputs = raw.inputs.map((c, i) => decode(c, VIEW.inputs[i].unit === "rad" ? DEGREES : 1));
  run.missing = raw.missing
    ? { t: decodeTimes(raw.missing.t), force: raw.missing.force.map((c) => decode(c)) } : null;
  if (parsed.size > 11) parsed.delete(parsed.keys().next().value);
  parsed.set(number, run);
  return run;
}

// Forces of one model along the motion: role -> X, Y, N; none for a model without forces.
function forcesOf(run, model) {
  if (!run.forces.has(model)) {
    const raw = run.raw.models[model];
    run.forces.set(model, raw ? raw.forces.map((role) => role.map((c) => decode(c))) : []);
  }
  return run.forces.get(model);
}

// Predictions of all models in windows of one length: states, deviations if known, first rows of the windows.
function windowsOf(run, length) {
  if (!run.windows.has(length)) {
    const found = run.raw.models.map((m) => {
      const w = m.windows[length];
      return { starts: w.starts, states: w.states.map((c) => decode(c)), std: w.std ? w.std.map((c) => decode(c)) : null };
    });
    run.windows.set(length, found);
  }
  return run.windows.get(length);
}

function number(value, digits) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = value.toFixed(digits);
  return (/^-0\.?0*$/.test(text) ? text.slice(1) : text).replace("-", "−");
}

function threeFigures(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const power = Math.floor(Math.log10(Math.abs(value)));
  const text = power > 5 || power < -4 ? value.toExponential(2) : value.toFixed(Math.max(0, 2 - power));
  return text.replace("-", "−");
}

function element(tag, text = "", attributes = {}) {
  const made = document.createElement(tag);
  made.textContent = text;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

// A short piece of a line as it is drawn, for legends.
function sample(look, width = 30, height = 12) {
  const canvas = document.createElement("canvas"), ratio = 2;
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  const c = canvas.getContext("2d");
  c.scale(ratio, ratio);
  stroke(c, look);
  c.beginPath();
  c.moveTo(1, height / 2);
  c.lineTo(width - 1, height / 2);
  c.stroke();
  return canvas;
}

function stroke(c, look) {
  c.strokeStyle = look.color;
  c.lineWidth = look.width;
  c.setLineDash(look.dash);
}

// Round steps 1, 2, 5 so that about `count` of them fill `span`.
function roundStep(span, count) {
  const raw = span / count, power = Math.pow(10, Math.floor(Math.log10(raw))), share = raw / power;
  return power * (share < 1.5 ? 1 : share < 3.5 ? 2 : share < 7.5 ? 5 : 10);
}

// The canvas at the resolution of the screen: context and size in CSS pixels.
function prepared(canvas) {
  const box = canvas.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
  const width = Math.max(1, Math.round(box.width)), height = Math.max(1, Math.round(box.height));
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const c = canvas.getContext("2d");
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.clearRect(0, 0, width, height);
  c.setLineDash([]);
  return { c, width, height };
}

function arrow(c, x, y, dx, dy, dash = []) {
  const reach = Math.hypot(dx, dy);
  if (!(reach > 1.5)) return;
  const head = Math.min(8, 0.45 * reach), angle = Math.atan2(dy, dx);
  c.setLineDash(dash);
  c.beginPath();
  c.moveTo(x, y);
  c.lineTo(x + dx, y + dy);
  c.stroke();
  c.setLineDash([]);
  c.beginPath();
  for (const side of [-1, 1]) {
    c.moveTo(x + dx, y + dy);
    c.lineTo(x + dx - head * Math.cos(angle + 0.45 * side), y + dy - head * Math.sin(angle + 0.45 * side));
  }
  c.stroke();
}
