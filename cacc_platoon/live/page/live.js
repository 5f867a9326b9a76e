"use strict";
// Asks for the newest picture of the platoon and shows it: a table, and one curve a vehicle.

const PERIOD = 200; // from picture to picture [ms]
const KEPT = 1500; // pictures in the plot
const BEHIND = 1.0; // from so much simulated time on a vehicle is one of which nothing is heard [s]
const PLOTS = [
  { key: "spacing_error", name: "Spacing error", unit: "m", leader: false },
  { key: "speed", name: "Speed", unit: "m/s", leader: true },
  { key: "gap", name: "Gap", unit: "m", leader: false },
];
const COLUMNS = [
  { name: "vehicle", unit: "", text: (v) => String(v.vehicle) },
  { name: "gap", unit: "m", text: (v) => fixed(v.gap, 2), mood: (v) => (v.gap !== null && v.gap <= 0 ? "bad" : "") },
  { name: "speed", unit: "m/s", text: (v) => fixed(v.velocity, 3) },
  { name: "spacing error", unit: "m", text: (v) => signed(v.spacing_error, 4) },
  { name: "acceleration", unit: "m/s²", text: (v) => signed(v.acceleration, 3) },
  { name: "V2V", unit: "", text: state, mood: stateMood },
  { name: "age", unit: "s", text: (v) => fixed(v.packet_age, 2) },
  { name: "received", unit: "m/s²", text: (v) => signed(v.received, 3) },
  { name: "lateness", unit: "periods", text: (v) => fixed(v.lateness, 2), optional: (v) => v.lateness !== null },
];
const VIRIDIS = ["#440154", "#482475", "#414487", "#355f8d", "#2a788e", "#21918c", "#22a884", "#44bf70", "#7ad151", "#bddf26"];
const VIRIDIS_IN_THE_DARK = ["#b28cff", "#8f9bff", "#6fb0ff", "#4fc3f0", "#3fd0d8", "#3fd8b8", "#55dd94", "#7fe06c", "#b5e04a", "#eadf3c"];

let curves = [];
let chosen = PLOTS[0];
let picture = null;

const element = (id) => document.getElementById(id);
const dark = () => matchMedia("(prefers-color-scheme: dark)").matches;
const known = (value) => value !== null && value !== undefined;
const fixed = (value, digits) => (known(value) ? value.toFixed(digits) : "");
const signed = (value, digits) => (known(value) ? (value < 0 ? "−" : "+") + Math.abs(value).toFixed(digits) : "");
const minus = (text) => text.replace("-", "−");

const step = () => (picture.sample > 0 ? picture.time / picture.sample : 0);

const seen = () => Math.max(-1, ...picture.vehicles.map((v) => v.sample).filter(known));

function behind(vehicle) {
  return known(vehicle.sample) ? (seen() - vehicle.sample) * step() : null;
}

function state(vehicle) {
  const late = behind(vehicle);
  if (late === null) return "not heard";
  if (late > BEHIND) return `${late.toFixed(0)} s behind`;
  if (vehicle.alarm) return "alarm";
  return vehicle.reception || (known(vehicle.received) ? "received" : "");
}

function stateMood(vehicle) {
  const late = behind(vehicle);
  if (late === null || late > BEHIND) return "warning";
  if (vehicle.alarm || vehicle.reception === "fallback") return "bad";
  return ["degrading", "recovering"].includes(vehicle.reception) ? "warning" : "";
}

function make(tag, text, name) {
  const made = document.createElement(tag);
  made.textContent = text;
  if (name) made.className = name;
  return made;
}

function showHead() {
  const parts = [picture.phase || "nothing heard yet"];
  if (picture.samples && picture.sample >= 0) {
    parts.push(`sample ${picture.sample} of ${picture.samples - 1}`, `${picture.time.toFixed(1)} s`);
  }
  if (known(picture.real_time_factor)) parts.push(`real-time factor ${picture.real_time_factor.toFixed(1)}`);
  if (known(picture.left)) parts.push(`${picture.left.toFixed(0)} s left`);
  if (picture.silence > 2 && picture.phase === "running") parts.push(`silent for ${picture.silence.toFixed(0)} s`);
  element("namespace").textContent = picture.namespace;
  document.title = `${picture.namespace} ${picture.phase || ""}`;
  element("progress").textContent = parts.join(" · ");
  const share = picture.samples > 1 ? Math.max(0, picture.sample) / (picture.samples - 1) : 0;
  element("done").style.width = `${100 * share}%`;
  element("message").textContent = picture.message;
  element("message").hidden = !picture.message;
}

function showTable() {
  const columns = COLUMNS.filter((one) => !one.optional || picture.vehicles.some(one.optional));
  const head = columns.map((one) => {
    const cell = make("th", one.name);
    cell.scope = "col";
    cell.append(make("small", one.unit || "\u00a0"));
    return cell;
  });
  element("head").replaceChildren(...head);
  const rows = picture.vehicles.map((vehicle) => {
    const row = document.createElement("tr");
    row.append(...columns.map((one) => make("td", one.text(vehicle), one.mood ? one.mood(vehicle) : "")));
    return row;
  });
  element("rows").replaceChildren(...rows);
}

function showEvents() {
  const lines = picture.events.map((one) => make("li", `${one.time.toFixed(2)} s  ${one.node}  ${one.kind}  ${one.text}`));
  element("events").replaceChildren(...(lines.length ? lines.reverse() : [make("li", "none yet", "soft")]));
}

function takeCurve() {
  const [newest, last] = [seen(), curves.length ? curves[curves.length - 1].sample : -1];
  if (newest < last) curves = [];
  if (newest === last || newest < 0) return;
  curves.push({
    sample: newest,
    time: newest * step(),
    speed: picture.vehicles.map((v) => v.velocity),
    spacing_error: picture.vehicles.map((v) => v.spacing_error),
    gap: picture.vehicles.map((v) => v.gap),
  });
  if (curves.length > KEPT) curves.shift();
}

function colour(number, count) {
  const scale = dark() ? VIRIDIS_IN_THE_DARK : VIRIDIS;
  return scale[Math.round((number / Math.max(count - 1, 1)) * (scale.length - 1))];
}

function ticks(low, high, wanted) {
  const rough = (high - low) / wanted;
  const power = 10 ** Math.floor(Math.log10(rough));
  const each = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough);
  const found = [];
  for (let k = Math.ceil(low / each - 1e-9); k * each <= high + 1e-9 * each; k += 1) found.push(k * each);
  return { found, digits: Math.max(0, -Math.floor(Math.log10(each) + 1e-9)) };
}

function limits() {
  let [low, high] = [Infinity, -Infinity];
  for (const one of curves) {
    for (const value of one[chosen.key]) {
      if (known(value)) [low, high] = [Math.min(low, value), Math.max(high, value)];
    }
  }
  if (low > high) return null;
  const margin = Math.max(0.05 * (high - low), 1e-3);
  return [low - margin, high + margin];
}

function showPlot() {
  const canvas = element("plot");
  const [width, height, ratio] = [canvas.clientWidth, canvas.clientHeight, devicePixelRatio || 1];
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  const style = getComputedStyle(document.documentElement);
  const [ink, grid] = [style.getPropertyValue("--soft"), style.getPropertyValue("--grid")];
  pen.font = "13px system-ui, 'Liberation Sans', Arial, sans-serif";
  pen.fillStyle = ink;
  const range = limits();
  if (!range || curves.length < 2) {
    pen.fillText("waiting for the vehicles", 12, 24);
    return;
  }
  const box = { left: 62, right: width - 12, top: 12, bottom: height - 42 };
  const [begin, end] = [curves[0].time, curves[curves.length - 1].time];
  const x = (time) => box.left + ((time - begin) / (end - begin || 1)) * (box.right - box.left);
  const y = (value) => box.bottom - ((value - range[0]) / (range[1] - range[0])) * (box.bottom - box.top);
  drawGrid(pen, box, range, [begin, end], x, y, ink, grid);
  const count = curves[curves.length - 1][chosen.key].length;
  for (let number = chosen.leader ? 0 : 1; number < count; number += 1) {
    drawCurve(pen, number, colour(number, count), x, y);
  }
}

function drawGrid(pen, box, range, times, x, y, ink, grid) {
  pen.lineWidth = 1;
  pen.strokeStyle = grid;
  pen.fillStyle = ink;
  const rows = ticks(range[0], range[1], 5);
  pen.textAlign = "right";
  for (const value of rows.found) {
    line(pen, box.left, y(value), box.right, y(value));
    pen.fillText(minus(value.toFixed(rows.digits)), box.left - 8, y(value) + 4);
  }
  const columns = ticks(times[0], times[1], Math.max(2, Math.min(10, (box.right - box.left) / 90)));
  pen.textAlign = "center";
  for (const value of columns.found) {
    line(pen, x(value), box.top, x(value), box.bottom);
    pen.fillText(value.toFixed(columns.digits), x(value), box.bottom + 18);
  }
  pen.fillText("simulated time [s]", (box.left + box.right) / 2, box.bottom + 36);
  pen.save();
  pen.translate(14, (box.top + box.bottom) / 2);
  pen.rotate(-Math.PI / 2);
  pen.fillText(`${chosen.name.toLowerCase()} [${chosen.unit}]`, 0, 0);
  pen.restore();
}

function line(pen, x0, y0, x1, y1) {
  pen.beginPath();
  pen.moveTo(x0, y0);
  pen.lineTo(x1, y1);
  pen.stroke();
}

function drawCurve(pen, number, shade, x, y) {
  pen.strokeStyle = shade;
  pen.lineWidth = 1.5;
  pen.beginPath();
  let drawing = false;
  for (const one of curves) {
    const value = one[chosen.key][number];
    if (!known(value)) {
      drawing = false;
    } else if (drawing) {
      pen.lineTo(x(one.time), y(value));
    } else {
      pen.moveTo(x(one.time), y(value));
      drawing = true;
    }
  }
  pen.stroke();
}

function showKey() {
  const count = picture.vehicles.length;
  const first = chosen.leader ? 0 : 1;
  const numbers = [...picture.vehicles.keys()].slice(first);
  const some = numbers.length <= 14 ? numbers : numbers.filter((_, k) => k % Math.ceil(numbers.length / 12) === 0);
  const entries = some.map((number) => {
    const entry = document.createElement("span");
    entry.style.color = colour(number, count);
    entry.append(make("b", `vehicle ${picture.vehicles[number].vehicle}`));
    return entry;
  });
  element("key").replaceChildren(...entries);
}

function showChoice() {
  const buttons = PLOTS.map((one) => {
    const button = make("button", one.name);
    button.type = "button";
    button.setAttribute("aria-pressed", String(one === chosen));
    button.addEventListener("click", () => {
      chosen = one;
      showChoice();
      if (picture) showKey();
      showPlot();
    });
    return button;
  });
  element("choice").replaceChildren(...buttons);
}

async function get(path) {
  const answer = await fetch(path, { cache: "no-store" });
  if (!answer.ok) throw new Error(answer.statusText);
  return answer.json();
}

async function look() {
  try {
    const found = await get("picture.json");
    if (found.vehicles) {
      picture = found;
      showHead();
      showTable();
      showEvents();
      takeCurve();
      showKey();
      showPlot();
    }
  } catch {
    element("progress").textContent = "platoon watch does not answer";
  }
  setTimeout(look, PERIOD);
}

async function begin() {
  showChoice();
  addEventListener("resize", showPlot);
  try {
    curves = await get("curves.json");
  } catch {
    curves = [];
  }
  look();
}

begin();
