// A review: clip, track, trajectory and residual under one cursor; every edit goes to the server at once. The state below
// is that of one review: page.js opens it in a page, widget.js in a notebook, where each view loads a module of its own.

const $ = (id) => root.getElementById(id);
const TAIL_S = 0.5; // of the path drawn before and after the frame
const CLICK_PX = 4; // of the screen: a pointer that moves less clicks
const GRAB_PX = { mouse: 12, pen: 14, touch: 24 };
const KEPT_IMAGES = 16;
const TOOLS = ["point", "mark", "scale", "pivot", "launch", "plumb", "region", "board", "ignore"];
const POINTS_OF = { scale: 2, plumb: 2, region: 2, board: 4 }; // of tools that take more than one
const COLOURS = ["#56b4e9", "#e69f00", "#2bc48a", "#f27ab8", "#f0e442", "#ff8a5c", "#b3a2ff", "#8ce0e0"];

let root; // a document, or the shadow root of a widget
let host; // the element that carries the colours
let server; // (path, content) => { status, body } with a Blob
let closed = false;
let clip = null;
let state = null;
let fit = null;
let frame = 0; // asked for
let shown = { number: -1, image: null }; // drawn: the track is drawn for this frame, never for another
let view = { zoom: 1, x: 0, y: 0, whole: true }; // px of the screen for one px of the clip; clip px at the stage's corner
let tool = "point";
let body = "1";
let cross = null; // clip px
let begun = []; // the first of several points
let dragging = null;
let asked = -1; // which question is shown
let moved = false; // whether the person has chosen a frame
let playing = false;
let queue = Promise.resolve();
const tracks = new Map();
const images = new Map();
const pointers = new Map();

// ------------------------------------------------------------------------------------------------ server

async function ask(path, content) {
  const { status, body } = await server(path, content);
  if (body.type.startsWith("image/") && status < 400) return body;
  const answer = JSON.parse(await body.text());
  if (status >= 400) throw Object.assign(new Error(answer.error), { status });
  return answer;
}

// Changes are sent one after the other, each with the version that the one before led to.
function change(path, more = {}) {
  queue = queue.then(async () => {
    try {
      take(await ask(path, { version: state.version, ...more }));
      say("");
    } catch (error) {
      say(error.message);
      if (error.status) await reload(); // what was drawn before the answer did not come to be
    }
  });
  return queue;
}

function edit(kind, values) {
  return change("/api/edit", { edit: { kind, ...values } });
}

function take(next) {
  const before = new Map(tracks);
  tracks.clear();
  for (const track of next.tracks) tracks.set(track.body, track.frame ? prepared(track) : before.get(track.body));
  state = next;
  const numbers = tracks.values().next().value?.frame;
  if (numbers && !clip.times.length) clip.frames = Math.max(clip.frames, numbers.at(-1) + 1);
  $("frame").max = Math.max(0, clip.frames - 1);
  if (!tracks.has(body) && !$("body").dataset.fresh) body = tracks.keys().next().value ?? "1";
  showState();
  draw();
  askForFit();
}

function prepared(track) {
  track.row = new Map(track.frame.map((number, row) => [number, row]));
  track.edited = new Set(track.edited);
  track.hand = new Set(track.hand);
  return track;
}

async function reload() {
  take(await ask("/api/state"));
}

async function askForFit(whole = false) {
  const version = state.version;
  if (!tracks.size) return;
  if (!whole) $("fit-status").textContent = "fitting …";
  try {
    const next = await ask(`/api/fit?version=${version}${whole ? "&whole" : ""}`);
    if (next.pending) {
      setTimeout(() => version === state.version && askForFit(whole), 100);
    } else if (next.version === state.version) {
      fit = next;
      showFit();
      draw();
      if (fit.preview) askForFit(true);
    }
  } catch (error) {
    say(error.message);
  }
}

async function watch() {
  try {
    const now = await ask("/api/progress");
    showTracking(now.tracking);
    if (state && now.version !== state.version) {
      await queue;
      if (now.version > state.version) await reload();
    }
  } catch (error) {
    say(error.message);
  }
  if (!closed) setTimeout(watch, state?.tracking.running ? 400 : 2000);
}

// ------------------------------------------------------------------------------------------------ frames

function go(number, byPerson = true) {
  const last = Math.max(0, clip.frames - 1);
  frame = Math.min(Math.max(0, Math.round(number)), last);
  moved = moved || byPerson;
  $("frame").value = frame;
  showFrame();
}

let loading = null;
async function showFrame() {
  if (loading !== null) return; // the loop below goes on to the newest frame
  while (frame !== shown.number) {
    loading = frame;
    try {
      const image = await imageOf(loading);
      shown = { number: loading, image };
    } catch (error) {
      say(error.message);
      shown = { number: loading, image: null };
    }
    draw();
  }
  loading = null;
  showWhere();
}

async function imageOf(number) {
  const width = wanted();
  const key = `${number}/${width}`;
  if (!images.has(key)) {
    images.set(key, await createImageBitmap(await ask(`/frame/${number}.jpg?width=${width}`)));
    for (const old of [...images.keys()].slice(0, -KEPT_IMAGES)) {
      if (images.get(old) !== shown.image) images.get(old).close();
      images.delete(old);
    }
  }
  return images.get(key);
}

// Width to ask for: that of the clip, or less where the stage shows no more.
function wanted() {
  const pixels = clip.width * view.zoom * devicePixelRatio;
  return pixels >= 0.7 * clip.width ? clip.width : Math.min(clip.width, Math.ceil(pixels / 320) * 320);
}

function timeOf(number) {
  const track = tracks.values().next().value;
  const row = track?.row.get(number);
  return clip.times[number] ?? (row === undefined ? null : track.t[row]);
}

function frameAt(t) {
  if (!clip.times.length) {
    const track = tracks.values().next().value;
    return track ? track.frame[nearest(track.t, t)] : 0;
  }
  return nearest(clip.times, t);
}

function nearest(times, t) {
  let low = 0;
  let high = times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle;
    else high = middle;
  }
  return t - times[low] < times[high] - t ? low : high;
}

async function play() {
  playing = !playing;
  $("play").textContent = playing ? "■" : "▶";
  while (playing && frame < clip.frames - 1) {
    const start = performance.now();
    go(frame + 1);
    while (shown.number !== frame && playing) await new Promise((done) => setTimeout(done, 5));
    const step = 1000 * ((timeOf(frame + 1) ?? 0) - (timeOf(frame) ?? 0)) || 40;
    await new Promise((done) => setTimeout(done, Math.max(0, step - (performance.now() - start))));
  }
  playing = false;
  $("play").textContent = "▶";
}

// ------------------------------------------------------------------------------------------------ drawing

function sized(canvas) {
  const box = canvas.getBoundingClientRect();
  const ratio = devicePixelRatio;
  const [width, height] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, box.width, box.height);
  return [pen, box.width, box.height];
}

function colour(name) {
  return getComputedStyle(host).getPropertyValue(`--${name}`).trim();
}

function colourOf(name) {
  return COLOURS[Math.max(0, [...tracks.keys()].indexOf(name)) % COLOURS.length];
}

let drawn = 0;
function draw() {
  if (!drawn) {
    drawn = requestAnimationFrame(() => {
      drawn = 0;
      if (!clip) return;
      drawStage();
      drawStrip();
      drawCurves();
    });
  }
}

function wholeFrame() {
  const box = $("stage").getBoundingClientRect();
  const zoom = Math.min(box.width / clip.width, box.height / clip.height);
  view = { zoom, x: (clip.width - box.width / zoom) / 2, y: (clip.height - box.height / zoom) / 2, whole: true };
}

// x and y are px of the clip whose integers are centres of pixels.
const toScreen = (x, y) => [(x + 0.5 - view.x) * view.zoom, (y + 0.5 - view.y) * view.zoom];
const toClip = (x, y) => [x / view.zoom + view.x - 0.5, y / view.zoom + view.y - 0.5];

function drawStage() {
  if (view.whole) wholeFrame();
  const [pen, width, height] = sized($("stage"));
  if (shown.image) {
    pen.imageSmoothingEnabled = view.zoom < 3;
    pen.drawImage(shown.image, -view.x * view.zoom, -view.y * view.zoom, clip.width * view.zoom, clip.height * view.zoom);
  }
  for (const track of tracks.values()) drawTrack(pen, track);
  drawScene(pen);
  if (cross) {
    const [x, y] = toScreen(...cross);
    outlined(pen, "#fff", () => {
      pen.beginPath();
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
        pen.moveTo(x + 4 * dx, y + 4 * dy);
        pen.lineTo(x + 14 * dx, y + 14 * dy);
      }
      pen.stroke();
    });
  }
  pen.clearRect(-1, height, width, 1);
}

// A line in a colour with a dark edge, to be seen on any background.
function outlined(pen, ink, path, line = 2) {
  pen.lineWidth = line + 2;
  pen.strokeStyle = "rgb(0 0 0 / .65)";
  path();
  pen.lineWidth = line;
  pen.strokeStyle = ink;
  path();
}

function drawTrack(pen, track) {
  const now = timeOf(shown.number);
  if (now === null) return;
  const ink = colourOf(track.body);
  pen.globalAlpha = track.body === body ? 1 : 0.6;
  let from = nearest(track.t, now - TAIL_S);
  const to = nearest(track.t, now + TAIL_S);
  pen.lineWidth = 1.5;
  pen.strokeStyle = ink;
  pen.beginPath();
  for (let open = false; from <= to; from++) {
    if (track.x[from] === null) open = false;
    else {
      const at = toScreen(track.x[from], track.y[from]);
      open ? pen.lineTo(...at) : pen.moveTo(...at);
      open = true;
    }
  }
  pen.stroke();
  for (let row = nearest(track.t, now - TAIL_S); row <= to; row++) if (track.x[row] !== null) drawPoint(pen, track, row, ink);
  const row = track.row.get(shown.number);
  if (row !== undefined && (track.x[row] !== null || dragging?.track === track)) drawBody(pen, track, row, ink);
  pen.globalAlpha = 1;
}

// Measured points are dots; those that a person placed are hollow rings.
function drawPoint(pen, track, row, ink) {
  const [x, y] = toScreen(track.x[row], track.y[row]);
  pen.beginPath();
  pen.arc(x, y, track.edited.has(row) ? 4.5 : 1.8, 0, 2 * Math.PI);
  if (track.edited.has(row)) outlined(pen, ink, () => pen.stroke(), 1.6);
  else {
    pen.fillStyle = ink;
    pen.fill();
  }
}

function drawBody(pen, track, row, ink) {
  const at = dragging?.track === track && dragging.at ? dragging.at : [track.x[row], track.y[row]];
  const [x, y] = toScreen(...at);
  const radius = Math.max(9, (track.radius[row] ?? 0) * view.zoom * 1.15);
  pen.setLineDash(track.edited.has(row) ? [5, 4] : []);
  outlined(pen, ink, () => {
    pen.beginPath();
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    pen.stroke();
  });
  pen.setLineDash([]);
  if (tracks.size > 1) {
    pen.font = "13px system-ui, sans-serif";
    pen.lineWidth = 3;
    pen.strokeStyle = "#000";
    pen.fillStyle = ink;
    pen.strokeText(track.body, x + radius + 3, y - radius + 6);
    pen.fillText(track.body, x + radius + 3, y - radius + 6);
  }
}

function drawScene(pen) {
  if (!state) return;
  const { marks, plumb, roi, scale_points: scale, body_marks: bodies, ignored } = state.request;
  if (plumb) line(pen, pairs(plumb), "#9be7ff");
  if (scale) line(pen, pairs(scale), "#ffe07a", scale.length > 4);
  if (roi) box(pen, roi[0] - 0.5, roi[1] - 0.5, roi[0] + roi[2] - 0.5, roi[1] + roi[3] - 0.5);
  for (const [name, at] of Object.entries(marks)) sign(pen, ...at, name);
  for (const [name, x, y, number] of bodies) if (number === shown.number) sign(pen, x, y, `body ${name}`);
  for (const [x, y, number] of ignored) if (number === shown.number) sign(pen, x, y, "no body");
  if (!begun.length) return;
  for (const at of begun) sign(pen, ...at, "");
  if (cross && tool === "region") box(pen, ...begun[0], ...cross);
  else line(pen, cross ? [...begun, cross] : begun, "#fff");
}

function pairs(numbers) {
  return numbers.flatMap((x, k) => (k % 2 ? [] : [[x, numbers[k + 1]]]));
}

function line(pen, points, ink, around = false) {
  outlined(pen, ink, () => {
    pen.beginPath();
    for (const at of points) pen.lineTo(...toScreen(...at));
    if (around) pen.closePath();
    pen.stroke();
  });
}

function box(pen, x1, y1, x2, y2) {
  const [left, top] = toScreen(Math.min(x1, x2), Math.min(y1, y2));
  const [right, bottom] = toScreen(Math.max(x1, x2), Math.max(y1, y2));
  pen.setLineDash([8, 5]);
  outlined(pen, "#fff", () => pen.strokeRect(left, top, right - left, bottom - top));
  pen.setLineDash([]);
}

function sign(pen, x, y, text) {
  const [left, top] = toScreen(x, y);
  outlined(pen, "#ffe07a", () => {
    pen.beginPath();
    pen.moveTo(left - 8, top - 8);
    pen.lineTo(left + 8, top + 8);
    pen.moveTo(left - 8, top + 8);
    pen.lineTo(left + 8, top - 8);
    pen.stroke();
  });
  pen.font = "13px system-ui, sans-serif";
  pen.lineWidth = 3;
  pen.strokeStyle = "#000";
  pen.fillStyle = "#ffe07a";
  pen.strokeText(text, left + 11, top - 6);
  pen.fillText(text, left + 11, top - 6);
}

// Which frames have the body, which a person edited, and which are doubtful.
function drawStrip() {
  const [pen, width, height] = sized($("strip"));
  const place = (number) => (number / Math.max(1, clip.frames - 1)) * (width - 2) + 1;
  const track = tracks.get(body);
  pen.fillStyle = colour("line");
  pen.fillRect(0, height * 0.35, width, height * 0.3);
  if (track) {
    pen.fillStyle = colour("data");
    track.frame.forEach((number, row) => {
      if (track.x[row] !== null) pen.fillRect(place(number) - 0.5, height * 0.35, Math.max(1, width / clip.frames), height * 0.3);
    });
    pen.strokeStyle = colour("edited");
    pen.lineWidth = 1.5;
    for (const row of track.edited) {
      pen.beginPath();
      pen.arc(place(track.frame[row]), height * 0.5, Math.min(4, height * 0.25), 0, 2 * Math.PI);
      pen.stroke();
    }
  }
  (fit?.questions ?? []).forEach((question, k) => {
    pen.fillStyle = colour(question.answered ? "line" : "doubt");
    const x = place(question.frame);
    pen.beginPath();
    pen.moveTo(x - 5, 0);
    pen.lineTo(x + 5, 0);
    pen.lineTo(x, height * (k === asked ? 0.45 : 0.3));
    pen.fill();
  });
  pen.fillStyle = colour("ink");
  pen.fillRect(place(frame) - 1, 0, 2, height);
}

function curves() {
  if (fit?.curves.length) {
    const curve = fit.curves[Math.min(Number($("quantity").value) || 0, fit.curves.length - 1)];
    return { ...curve, name: curve.name.replace(/^theta/, "θ") };
  }
  const track = tracks.get(body);
  if (!track) return null;
  const name = $("quantity").value === "1" ? "y" : "x";
  return { name, unit: "px", t: track.t, data: track[name], fit: null, residual: null };
}

function drawCurves() {
  const curve = curves();
  $("residual").hidden = $("residual-title").hidden = !curve?.residual; // first: what is hidden has no size
  const [pen, width, height] = sized($("trajectory"));
  const [under, underWidth, underHeight] = sized($("residual"));
  if (!curve) return;
  const edited = editedTimes();
  $("curve-title").textContent = `${curve.name}${curve.unit ? ` in ${curve.unit}` : ""}${curve.fit ? ", with the fit" : ""}`;
  plot(pen, width, height, curve.t, [
    ...(curve.left_out ? [{ values: curve.left_out, ink: colour("soft"), dots: true, rings: edited }] : []),
    { values: curve.data, ink: colour("data"), dots: true, rings: edited },
    ...(curve.fit ? [{ values: curve.fit, ink: colour("fit") }] : []),
  ]);
  if (curve.residual) {
    $("residual-title").textContent = `Fit residual${curve.unit ? ` in ${curve.unit}` : ""}`;
    plot(under, underWidth, underHeight, curve.t, [{ values: curve.residual, ink: colour("fit"), dots: true, rings: edited }], true);
  }
}

function editedTimes() {
  const times = new Set();
  for (const track of tracks.values()) for (const row of track.edited) times.add(track.t[row]);
  return times;
}

const LEFT = 56;
const BELOW = 20;
function spanOf(t) {
  const first = clip.times[0] ?? t[0];
  const last = clip.times.at(-1) ?? t.at(-1);
  return [first, last > first ? last : first + 1];
}

function plot(pen, width, height, t, series, aroundZero = false) {
  const [t0, t1] = spanOf(t);
  let [low, high] = [Infinity, -Infinity];
  for (const { values } of series) {
    for (const value of values) {
      if (value !== null) {
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
  }
  if (aroundZero) high = Math.max(Math.abs(low), Math.abs(high)), (low = -high);
  if (!(high > low)) [low, high] = Number.isFinite(low) ? [low - 1, high + 1] : [-1, 1];
  const margin = 0.06 * (high - low);
  [low, high] = [low - margin, high + margin];
  const X = (time) => LEFT + ((time - t0) / (t1 - t0)) * (width - LEFT - 6);
  const Y = (value) => 6 + ((high - value) / (high - low)) * (height - BELOW - 6);
  axes(pen, width, height, [t0, t1], [low, high], X, Y);
  for (const { values, ink, dots, rings } of series) {
    pen.strokeStyle = pen.fillStyle = ink;
    pen.lineWidth = 1.5;
    if (!dots) {
      pen.beginPath();
      let open = false;
      values.forEach((value, k) => {
        if (value === null) open = false;
        else {
          open ? pen.lineTo(X(t[k]), Y(value)) : pen.moveTo(X(t[k]), Y(value));
          open = true;
        }
      });
      pen.stroke();
      continue;
    }
    values.forEach((value, k) => {
      if (value !== null && !rings.has(t[k])) pen.fillRect(X(t[k]) - 1.25, Y(value) - 1.25, 2.5, 2.5);
    });
    pen.strokeStyle = colour("edited");
    values.forEach((value, k) => {
      if (value === null || !rings.has(t[k])) return;
      pen.beginPath();
      pen.arc(X(t[k]), Y(value), 4, 0, 2 * Math.PI);
      pen.stroke();
    });
  }
  const now = timeOf(shown.number);
  if (now !== null) {
    pen.fillStyle = colour("ink");
    pen.fillRect(X(now) - 0.75, 4, 1.5, height - BELOW - 2);
  }
}

function axes(pen, width, height, [t0, t1], [low, high], X, Y) {
  pen.font = "11px system-ui, sans-serif";
  pen.fillStyle = colour("soft");
  pen.strokeStyle = colour("line");
  pen.lineWidth = 1;
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  for (const value of ticks(low, high, Math.max(3, height / 30))) {
    pen.beginPath();
    pen.moveTo(LEFT, Y(value));
    pen.lineTo(width - 6, Y(value));
    pen.stroke();
    pen.fillText(number(value), LEFT - 6, Y(value));
  }
  pen.textAlign = "center";
  pen.textBaseline = "alphabetic";
  for (const value of ticks(t0, t1, Math.max(2, width / 90))) pen.fillText(`${number(value)} s`, X(value), height - 5);
}

function ticks(low, high, count) {
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((digit) => digit * power).find((value) => value >= raw);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(k * step);
  return found;
}

function number(value) {
  return String(Number(value.toPrecision(4))).replace("-", "\u2212");
}

// ------------------------------------------------------------------------------------------------ words

function say(text, good = false) {
  $("message").hidden = !text;
  $("message").textContent = text;
  $("message").classList.toggle("good", good);
}

function showWhere() {
  const t = timeOf(shown.number);
  const track = tracks.get(body);
  const row = track?.row.get(shown.number);
  $("where").textContent = `frame ${shown.number} of ${clip.frames}${t === null ? "" : `, ${t.toFixed(3)} s`}`;
  const at =
    row === undefined || track.x[row] === null
      ? `body ${body} is not there`
      : `body ${body} at ${track.x[row].toFixed(1)}, ${track.y[row].toFixed(1)} px${track.edited.has(row) ? ", edited" : ""}`;
  $("stage").setAttribute("aria-label", `Frame ${shown.number}: ${at}`);
  $("announce").textContent = `Frame ${shown.number}, ${at}`;
}

function showState() {
  $("undo").disabled = !state.can_undo;
  $("redo").disabled = !state.can_redo;
  $("save").textContent = state.saved === state.version ? "Saved" : "Save";
  const names = [...tracks.keys()];
  if (!names.includes(body)) names.push(body);
  $("body").replaceChildren(...[...names, "new …"].map((name) => option(name, name === "new …" ? "" : name)));
  $("body").value = body;
  const { request } = state;
  const scene = [
    request.phenomenon ? `Phenomenon: ${request.phenomenon}.` : "No phenomenon is chosen: nothing is fitted.",
    request.scale ? `Scale: ${request.scale}.` : "No scale: positions are in px.",
    request.body_marks.length ? `${counted(request.body_marks.length, "mark")} for the tracker.` : "",
    request.ignored.length ? `${counted(request.ignored.length, "mark")} on what is no body.` : "",
    ...[...tracks.values()].flatMap((track) => track.doubts.map((doubt) => `Body ${track.body}: ${doubt}.`)),
  ];
  $("scene").textContent = scene.filter(Boolean).join(" ");
  $("phenomenon").textContent = request.phenomenon ? `Phenomenon: ${request.phenomenon}` : "Phenomenon";
  $("swap").disabled = tracks.size < 2;
  showTracking(state.tracking);
  showWhere();
}

function counted(count, name) {
  return `${count} ${name}${count === 1 ? "" : "s"}`;
}

function showTracking(now) {
  if (state) state.tracking = now;
  $("track").textContent = now.running ? (now.expected ? `Stop (${Math.round((100 * now.done) / now.expected)} %)` : "Stop") : "Track again";
  if (now.problem && now.problem !== showTracking.said) say(`The tracker: ${now.problem}`);
  showTracking.said = now.problem;
  if (now.running && !tracks.size) question(`Following the bodies: ${now.done}${now.expected ? ` of ${now.expected}` : ""} frames.`);
}

function showFit() {
  const seconds = `${fit.seconds.toFixed(2)} s`;
  $("fit-status").textContent = !fit.values.length ? "" : fit.preview ? `preview of some frames in ${seconds}; all frames are being fitted …` : `fitted in ${seconds}`;
  const verdict = fit.verdict.map((line, k) => paragraph(line, k === 0 ? "word" : ""));
  const before = fit.verdict_before.filter((line) => !fit.verdict.includes(line)).map((line) => paragraph(line, "before"));
  if (fit.problem) verdict.push(paragraph(fit.problem, "word"));
  $("verdict").replaceChildren(...before, ...verdict);
  const rows = fit.values.map((value) => [value.main, rowOf(value)]);
  $("values").tBodies[0].replaceChildren(...rows.filter(([main]) => main).map(([, row]) => row));
  $("more-values").querySelector("tbody").replaceChildren(...rows.filter(([main]) => !main).map(([, row]) => row));
  $("more-values").hidden = rows.every(([main]) => main);
  $("values").hidden = !rows.length;
  const names = fit.curves.length ? fit.curves.map((curve) => curve.name) : ["x", "y"];
  if ($("quantity").childElementCount !== names.length || $("quantity").options[0].text !== names[0]) {
    $("quantity").replaceChildren(...names.map((name, k) => option(name, String(k))));
  }
  $("quantity").hidden = names.length < 2;
  if (asked < 0 && !moved) nextQuestion(1, false);
  else showQuestion();
}

function rowOf(value) {
  const row = document.createElement("tr");
  const cells = [value.name.replaceAll("_", " "), value.opened, value.before, value.now];
  cells.forEach((text, k) => {
    const cell = document.createElement(k ? "td" : "th");
    cell.textContent = text;
    if (k === 3 && value.before && value.before !== value.now) cell.className = "changed";
    row.append(cell);
  });
  row.dataset.name = value.name;
  return row;
}

function paragraph(text, kind) {
  const made = document.createElement("p");
  made.textContent = text.replace(/^./, (letter) => letter.toUpperCase());
  made.className = kind;
  return made;
}

function option(text, value) {
  const made = document.createElement("option");
  [made.textContent, made.value] = [text, value];
  return made;
}

function showParts() {
  $("parts").hidden = !clip.parts.length;
  if (!clip.parts.length) return;
  const [pen, width, height] = sized($("parts-bar"));
  let from = 0;
  const items = clip.parts.map((part) => {
    pen.fillStyle = part.inks[host.classList.contains("dark") ? 1 : 0];
    pen.globalAlpha = part.opacity;
    pen.fillRect(from * width, 0, part.share * width, height);
    pen.globalAlpha = 1;
    from += part.share;
    const item = document.createElement("li");
    const swatch = document.createElement("span");
    swatch.className = "swatch";
    [swatch.style.background, swatch.style.opacity] = [pen.fillStyle, part.opacity];
    item.append(swatch, `${part.name} ${part.share < 0.005 ? "under 1" : Math.round(100 * part.share)} %`);
    return item;
  });
  $("parts-list").replaceChildren(...items);
}

// ------------------------------------------------------------------------------------------------ questions

function question(text) {
  $("question-text").textContent = text;
}

function showQuestion() {
  const questions = fit?.questions ?? [];
  const open = questions.filter((one) => !one.answered).length;
  const one = questions[asked];
  $("question").classList.toggle("done", !open);
  $("confirm").disabled = !one || one.answered;
  $("next-question").disabled = $("previous-question").disabled = !questions.length;
  if (!tracks.size) return;
  if (!questions.length) return question("No frame looks doubtful.");
  if (!one) return question(open ? `${open} of ${questions.length} doubtful places are open.` : `All doubtful places (${questions.length}) are answered.`);
  const place = one.doubts.length ? "" : one.first === one.last ? `Frame ${one.first}: ` : `Frames ${one.first} to ${one.last}: `;
  const reason = place ? one.reason : one.reason.replace(/^./, (letter) => letter.toUpperCase());
  const remedy = one.doubts.length && !one.answered ? " Show the body in a frame or two (2), then track again (T)." : "";
  question(`${asked + 1} of ${questions.length}${one.answered ? " (answered)" : ""}. ${place}${reason}.${remedy}`);
}

function nextQuestion(step, byPerson = true) {
  const questions = fit?.questions ?? [];
  if (!questions.length) return showQuestion();
  let next = asked;
  for (let k = 0; k < questions.length; k++) {
    next = (next + step + questions.length) % questions.length;
    if (!questions[next].answered || (byPerson && k === questions.length - 1)) break;
  }
  if (questions[next].answered && !byPerson) return showQuestion();
  asked = next;
  body = questions[asked].body;
  go(questions[asked].frame, byPerson);
  showState();
  showQuestion();
}

function confirmQuestion() {
  const one = fit?.questions[asked];
  if (one && !one.answered) edit("confirm", { body: one.body, first: one.first, last: one.last, doubts: one.doubts });
}

// ------------------------------------------------------------------------------------------------ edits

function click(at, pointer) {
  const [x, y] = at;
  const exact = { zoom: view.zoom, pointer };
  if (POINTS_OF[tool]) {
    begun.push(at);
    if (begun.length === POINTS_OF[tool]) {
      const points = begun;
      begun = [];
      severalPoints(points, exact);
    }
    return draw();
  }
  if (tool === "point") {
    edit("place", { body, frame: shown.number, x, y, at_rest: $("at-rest").checked, ...exact });
    $("at-rest").checked = false; // for one gap
    if ($("step-on").checked) go(frame + 1);
  } else if (tool === "mark") {
    edit("mark", { body, frame: shown.number, x, y, ...exact });
    say(`Marked as body ${body}. Track again follows it (T).`, true);
  } else if (tool === "ignore") {
    edit("ignore", { frame: shown.number, x, y, ...exact });
    say("Marked as no body, and taken out of the tracks. Track again follows the bodies without it (T).", true);
  } else edit("point", { name: tool, at });
}

async function severalPoints(points, exact) {
  const [first, second] = points;
  if (tool === "board") {
    const about = "The first side, then the one after it: 0.2m x 0.125m; or squares between the corners: 8x5 of 25mm";
    const size = await askText("Size of the rectangle", about, "");
    return size ? edit("board", { corners: points.flat(), size, ...exact }) : null;
  }
  if (tool === "plumb") return edit("plumb", { ends: [...first, ...second] });
  if (tool === "region") {
    const [left, top] = [0, 1].map((k) => Math.max(0, Math.floor(Math.min(first[k], second[k]))));
    const size = [clip.width, clip.height].map((most, k) => {
      const start = k ? top : left;
      return Math.max(1, Math.min(most - start, Math.ceil(Math.abs(first[k] - second[k]))));
    });
    return edit("region", { roi: [left, top, ...size] });
  }
  const length = await askText("Length between the two points", "With its unit, and its error if known: 0.84m, 84.0+-0.2cm", "");
  if (length) edit("scale", { ends: [...first, ...second], length, ...exact });
}

function removePoint() {
  edit("delete", { body, first: shown.number, last: shown.number });
  if ($("step-on").checked) go(frame + 1);
}

function freshName() {
  for (let k = 1; ; k++) if (!tracks.has(String(k))) return String(k);
}

async function split() {
  const name = await askText("Split", `From frame ${shown.number} on, body ${body} is another one. Its name:`, freshName());
  if (name) edit("split", { body, frame: shown.number, name });
}

async function swap() {
  const others = [...tracks.keys()].filter((name) => name !== body);
  const other = others.length > 1 ? await askChoice("Swap", `Exchange body ${body}, from frame ${shown.number} on, with:`, others) : others[0];
  if (other) edit("swap", { body, other, frame: shown.number });
}

async function choosePhenomenon() {
  const name = await askChoice("What moves in the clip?", "It decides how the track is read, and which equation is fitted.", clip.phenomena, state.request.phenomenon);
  if (!name) return;
  const tracker = state.request.tracker;
  await edit("phenomenon", { name });
  const anew = state.request.tracker !== tracker || state.request.bodies > tracks.size;
  if (state.request.phenomenon === name && anew && tracks.size && !state.tracking.running) toggleTracking();
}

async function toggleTracking() {
  try {
    showTracking(await ask(state.tracking.running ? "/api/stop" : "/api/track", { version: state.version }));
    say("");
  } catch (error) {
    say(error.message);
  }
}

async function save() {
  await queue;
  say("Saving …", true);
  try {
    const answer = await ask("/api/save", { version: state.version });
    state.saved = state.version;
    showState();
    say(`Saved in ${answer.folder}: ${answer.saved.join(", ")}.`, true);
  } catch (error) {
    say(error.message);
    if (error.status === 409) await reload();
  }
}

// ------------------------------------------------------------------------------------------------ dialogs

function asked_for(title, text, content, value) {
  const dialog = $("dialog");
  $("dialog-title").textContent = title;
  $("dialog-text").textContent = text;
  $("dialog-body").replaceChildren(...content);
  dialog.returnValue = "";
  dialog.showModal();
  return new Promise((done) => {
    dialog.addEventListener("close", () => done(dialog.returnValue === "yes" ? value() : null), { once: true });
  });
}

function askText(title, text, start) {
  const field = document.createElement("input");
  Object.assign(field, { type: "text", value: start, id: "dialog-field", autofocus: true });
  field.setAttribute("aria-label", title);
  field.addEventListener("keydown", (event) => {
    if (event.key !== "Enter") return;
    event.preventDefault();
    $("dialog").close("yes");
  });
  return asked_for(title, text, [field], () => field.value.trim());
}

function askChoice(title, text, choices, chosen) {
  const entries = Array.isArray(choices) ? choices.map((name) => [name, ""]) : Object.entries(choices);
  const labels = entries.map(([name, about], k) => {
    const label = document.createElement("label");
    const radio = document.createElement("input");
    Object.assign(radio, { type: "radio", name: "choice", value: name, checked: chosen ? name === chosen : Array.isArray(choices) && k === 0 });
    const more = document.createElement("small");
    more.textContent = about;
    label.append(radio, ` ${name}`, more);
    return label;
  });
  return asked_for(title, text, labels, () => $("dialog-body").querySelector("input:checked")?.value ?? null);
}

// ------------------------------------------------------------------------------------------------ pointers and keys

function placeOf(event, canvas = $("stage")) {
  const area = canvas.getBoundingClientRect();
  return [event.clientX - area.left, event.clientY - area.top];
}

function zoomAt(x, y, factor) {
  const before = [x / view.zoom + view.x, y / view.zoom + view.y];
  const least = Math.min($("stage").clientWidth / clip.width, $("stage").clientHeight / clip.height) / 2;
  const zoom = Math.min(64, Math.max(least, view.zoom * factor));
  view = { zoom, x: before[0] - x / zoom, y: before[1] - y / zoom, whole: false };
  sharpen();
  draw();
}

// After a zoom the frame is fetched again as large as the stage can show it.
let sharpening = 0;
function sharpen() {
  clearTimeout(sharpening);
  sharpening = setTimeout(async () => {
    if (shown.image && shown.image.width < wanted()) {
      const number = shown.number;
      const image = await imageOf(number).catch(() => null);
      if (image && shown.number === number) shown = { number, image };
      draw();
    }
  }, 120);
}

function bodyAt(x, y, reach) {
  let best = null;
  for (const track of tracks.values()) {
    const row = track.row.get(shown.number);
    if (row === undefined || track.x[row] === null) continue;
    const [left, top] = toScreen(track.x[row], track.y[row]);
    const apart = Math.hypot(left - x, top - y);
    if (apart < Math.max(reach, (track.radius[row] ?? 0) * view.zoom) && (!best || apart < best.apart)) {
      best = { track, row, apart, off: [left - x, top - y] };
    }
  }
  return best;
}

function pointerDown(event) {
  $("stage").focus({ preventScroll: true });
  $("stage").setPointerCapture(event.pointerId);
  const at = placeOf(event);
  pointers.set(event.pointerId, at);
  if (pointers.size === 2) {
    dragging = { pinch: true };
    return;
  }
  const grabbed = tool === "point" && event.button === 0 ? bodyAt(...at, GRAB_PX[event.pointerType] ?? 12) : null;
  dragging = { from: at, start: { ...view }, ...(grabbed ?? {}), far: false };
  if (tool === "region" && event.button === 0) begun = [toClip(...at)];
}

function pointerMove(event) {
  const at = placeOf(event);
  const before = pointers.get(event.pointerId);
  if (before && pointers.size === 2) pinch(event.pointerId, at);
  if (before) pointers.set(event.pointerId, at);
  cross = toClip(...at);
  if (dragging?.from) {
    const [dx, dy] = [at[0] - dragging.from[0], at[1] - dragging.from[1]];
    dragging.far = dragging.far || Math.hypot(dx, dy) > CLICK_PX;
    if (dragging.far && dragging.track) dragging.at = toClip(at[0] + dragging.off[0], at[1] + dragging.off[1]);
    else if (dragging.far && tool !== "region") {
      view = { ...view, x: dragging.start.x - dx / view.zoom, y: dragging.start.y - dy / view.zoom, whole: false };
    }
  }
  draw();
}

function pinch(id, at) {
  const [other] = [...pointers].filter(([key]) => key !== id).map(([, place]) => place);
  const before = pointers.get(id);
  const factor = Math.hypot(at[0] - other[0], at[1] - other[1]) / Math.max(1, Math.hypot(before[0] - other[0], before[1] - other[1]));
  zoomAt((at[0] + other[0]) / 2, (at[1] + other[1]) / 2, factor);
  view.x -= (at[0] - before[0]) / 2 / view.zoom;
  view.y -= (at[1] - before[1]) / 2 / view.zoom;
}

function pointerUp(event) {
  pointers.delete(event.pointerId);
  const done = dragging;
  if (pointers.size) return;
  dragging = null;
  if (event.type !== "pointerup" || event.button !== 0 || !done?.from) return draw();
  const at = placeOf(event);
  if (tool === "region") {
    if (done.far) click(toClip(...at), event.pointerType);
    else begun = [];
  } else if (done.at) {
    body = done.track.body;
    // what is seen until the server has answered
    [done.track.x[done.row], done.track.y[done.row]] = done.at;
    edit("place", { body, frame: shown.number, x: done.at[0], y: done.at[1], zoom: view.zoom, pointer: event.pointerType });
  } else if (!done.far && done.track) {
    body = done.track.body;
    showState();
  } else if (!done.far) click(toClip(...at), event.pointerType);
  draw();
}

function seek(event, canvas) {
  const [x] = placeOf(event, canvas);
  if (canvas.id === "strip") return go(((x - 1) / Math.max(1, canvas.clientWidth - 2)) * (clip.frames - 1));
  const curve = curves();
  if (!curve) return;
  const [t0, t1] = spanOf(curve.t);
  go(frameAt(t0 + ((x - LEFT) / (canvas.clientWidth - LEFT - 6)) * (t1 - t0)));
}

function moveCross(dx, dy, fast) {
  if (!cross) {
    const track = tracks.get(body);
    const row = track?.row.get(shown.number);
    cross = row !== undefined && track.x[row] !== null ? [track.x[row], track.y[row]] : [clip.width / 2, clip.height / 2];
  }
  const step = (fast ? 20 : 2) / view.zoom;
  cross = [cross[0] + dx * step, cross[1] + dy * step];
  $("announce").textContent = `Cross at ${cross[0].toFixed(1)}, ${cross[1].toFixed(1)} px`;
  draw();
}

function centreBody() {
  const track = tracks.get(body);
  const row = track?.row.get(shown.number);
  if (row === undefined || track.x[row] === null) return;
  const stage = $("stage");
  const zoom = Math.max(view.zoom, 2 * Math.min(stage.clientWidth / clip.width, stage.clientHeight / clip.height));
  view = { zoom, x: track.x[row] + 0.5 - stage.clientWidth / 2 / zoom, y: track.y[row] + 0.5 - stage.clientHeight / 2 / zoom, whole: false };
  sharpen();
  draw();
}

function chooseTool(name) {
  tool = name;
  begun = [];
  for (const button of root.querySelectorAll("[data-tool]")) button.setAttribute("aria-pressed", String(button.dataset.tool === name));
  draw();
}

async function newBody() {
  const name = await askText("A new body", "Its name; then place its points, or mark it and track again.", freshName());
  if (name) body = name;
  $("body").dataset.fresh = name ? "1" : "";
  showState();
}

function nextBody() {
  const names = [...tracks.keys()];
  body = names[(names.indexOf(body) + 1) % Math.max(1, names.length)] ?? body;
  showState();
  draw();
}

const middle = () => [$("stage").clientWidth / 2, $("stage").clientHeight / 2];
const KEYS = {
  ArrowLeft: (event) => go(frame - (event.shiftKey ? 10 : 1)),
  ArrowRight: (event) => go(frame + (event.shiftKey ? 10 : 1)),
  Home: () => go(0),
  End: () => go(clip.frames - 1),
  n: (event) => nextQuestion(event.shiftKey ? -1 : 1),
  y: () => confirmQuestion(),
  w: (event) => moveCross(0, -1, event.shiftKey),
  a: (event) => moveCross(-1, 0, event.shiftKey),
  s: (event) => moveCross(0, 1, event.shiftKey),
  d: (event) => moveCross(1, 0, event.shiftKey),
  Enter: () => cross && click(cross, "keys"),
  b: (event) => (event.shiftKey ? newBody() : nextBody()),
  Delete: () => removePoint(),
  Backspace: () => removePoint(),
  c: () => split(),
  x: () => swap(),
  u: () => state.can_undo && change("/api/undo"),
  r: () => state.can_redo && change("/api/redo"),
  "+": () => zoomAt(...middle(), 1.5),
  "=": () => zoomAt(...middle(), 1.5),
  "-": () => zoomAt(...middle(), 1 / 1.5),
  0: () => (wholeFrame(), draw()),
  f: () => centreBody(),
  g: () => ($("step-on").checked = !$("step-on").checked),
  h: () => ($("at-rest").checked = !$("at-rest").checked),
  p: () => choosePhenomenon(),
  t: () => toggleTracking(),
  " ": () => play(),
  "?": () => $("keys").showModal(),
  Escape: () => ((begun = []), (playing = false), draw()),
};

function keyDown(event) {
  if (root.querySelector("dialog[open]") || !state) return;
  const inField = event.target.matches("select, input[type='text']");
  if (event.ctrlKey || event.metaKey) {
    const key = event.key.toLowerCase();
    const command = key === "s" ? save : key === "z" ? KEYS[event.shiftKey ? "r" : "u"] : key === "y" ? KEYS.r : null;
    if (command) event.preventDefault();
    return command?.();
  }
  if (event.altKey || inField) return;
  const onButton = event.target.matches("button, summary, input");
  if (onButton && (event.key === "Enter" || event.key === " ")) return;
  const chosen = TOOLS[Number(event.key) - 1];
  if (chosen) return chooseTool(chosen);
  const action = KEYS[event.key] ?? KEYS[event.key.toLowerCase()];
  if (!action) return;
  event.preventDefault();
  action(event);
}

// ------------------------------------------------------------------------------------------------ start

function listen() {
  const stage = $("stage");
  stage.addEventListener("pointerdown", pointerDown);
  stage.addEventListener("pointermove", pointerMove);
  for (const name of ["pointerup", "pointercancel"]) stage.addEventListener(name, pointerUp);
  stage.addEventListener("pointerleave", () => ((cross = pointers.size ? cross : null), draw()));
  stage.addEventListener("contextmenu", (event) => event.preventDefault());
  stage.addEventListener("wheel", (event) => (event.preventDefault(), zoomAt(...placeOf(event), 1.0015 ** -event.deltaY)), { passive: false });
  for (const id of ["strip", "trajectory", "residual"]) {
    const canvas = $(id);
    canvas.addEventListener("pointerdown", (event) => (canvas.setPointerCapture(event.pointerId), seek(event, canvas)));
    canvas.addEventListener("pointermove", (event) => event.buttons && seek(event, canvas));
  }
  $("frame").addEventListener("input", () => go(Number($("frame").value)));
  $("body").addEventListener("change", () => ($("body").value ? ((body = $("body").value), showState(), draw()) : newBody()));
  $("quantity").addEventListener("change", draw);
  const buttons = {
    back: () => go(frame - 1),
    forth: () => go(frame + 1),
    play,
    "next-question": () => nextQuestion(1),
    "previous-question": () => nextQuestion(-1),
    confirm: confirmQuestion,
    undo: () => change("/api/undo"),
    redo: () => change("/api/redo"),
    track: toggleTracking,
    save,
    help: () => $("keys").showModal(),
    delete: removePoint,
    split,
    swap,
    drop: () => edit("drop", { body }),
    phenomenon: choosePhenomenon,
  };
  for (const [id, action] of Object.entries(buttons)) $(id).addEventListener("click", () => action());
  for (const button of root.querySelectorAll("[data-tool]")) button.addEventListener("click", () => chooseTool(button.dataset.tool));
  root.addEventListener("keydown", keyDown);
  new ResizeObserver(() => (draw(), clip && showParts())).observe(root.querySelector("main"));
  darkPreferred.addEventListener("change", showTheme);
}

const darkPreferred = matchMedia("(prefers-color-scheme: dark)");
function showTheme() {
  host.classList.toggle("dark", host.dataset.dark ? host.dataset.dark === "true" : darkPreferred.matches);
  draw();
  if (clip) showParts();
}

// Open the review in a document or a shadow root; gives the function that ends it. Its colours are set on `element`, dark
// ones as its data-dark says, or else as the reader prefers.
export function open(into, element, asked) {
  [root, host, server] = [into, element, asked];
  showTheme();
  start().catch((error) => say(error.message));
  return () => {
    closed = true;
    playing = false;
    darkPreferred.removeEventListener("change", showTheme);
  };
}

async function start() {
  clip = await ask("/api/clip");
  $("frame").max = Math.max(0, clip.frames - 1);
  $("stage").style.setProperty("--shape", `${clip.width} / ${clip.height}`);
  chooseTool("point");
  listen();
  wholeFrame();
  go(0, false);
  showParts();
  await reload();
  watch();
  if (!state.request.phenomenon) choosePhenomenon();
}
