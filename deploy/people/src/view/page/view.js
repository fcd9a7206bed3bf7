"use strict";
// Shows the newest picture that the server sent: the object of `alight status --json`, drawing and history. Every picture is whole: one that is missed is missed.

const $ = (id) => document.getElementById(id);
const DEAD_S = 1.5; // pictures come five times a second
const LATE_S = 2;
let picture = null;
let receivedAt = -Infinity;
let fastest = Infinity; // least difference between our clock and the server's: a picture without delay
let late = 0;

const seconds = () => performance.now() / 1000;
const ago = (s) => (s < 90 ? `${Math.round(s)} s` : s < 5400 ? `${Math.round(s / 60)} min` : `${Math.round(s / 3600)} h`);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`);

// ---- what is written ----

function text(id, value) {
  const at = $(id);
  if (at.textContent !== value) at.textContent = value;
}

function element(tag, className, content) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  made.textContent = content;
  return made;
}

// A screen reader hears what changed in kind; figures in a text change all the time.
const kind = (content) => content.replace(/[0-9.,]+/g, "#");
function speak(id, content) {
  if ($(id).dataset.kind === kind(content)) return;
  $(id).dataset.kind = kind(content);
  $(id).textContent = content;
}

const WORDS = { true: "GO", false: "NO-GO", null: "unknown" };
const CLASSES = { true: "yes", false: "no", null: "unknown" };
function showGo(go, state) {
  $("go").className = CLASSES[go.go];
  text("verdict", WORDS[go.go]);
  text("why", go.why);
  const stages = state ? state.stages : [];
  const bar = stages.map((s) => `${s.is} ${s.name}`).join();
  $("stages").hidden = !stages.length;
  if ($("stages").dataset.bar !== bar) {
    $("stages").dataset.bar = bar;
    $("stages").replaceChildren(...stages.map((s) => element("li", s.is, s.name)));
    $("stages").querySelectorAll(".now").forEach((now) => now.setAttribute("aria-current", "step"));
  }
  speak("spoken", [WORDS[go.go], state ? `${state.name}: ${state.does}` : ""].filter(Boolean).join(". "));
}

// It stays until the next flight ends, without data, too.
let result = null;
function showResult() {
  if (!result) return;
  $("result").hidden = false;
  text("outcome", result.outcome);
  text("how", result.text);
  text("when", `${ago(result.ago_s + seconds() - result.receivedAt)} ago`);
}

function showState(state) {
  $("state").className = !state ? "unknown" : state.stale ? "stale" : "";
  text("name", state ? state.name : "unknown");
  text("since", state ? [state.does, state.since_s > 0 ? `for ${ago(state.since_s)}` : ""].filter(Boolean).join(", ") : "");
  text("waiting", state && state.waiting ? `waits for: ${state.waiting}` : "");
  text("entered", state ? state.entered : "");
}

function showFigures(figures) {
  const tiles = figures.map((f) => {
    const tile = document.createElement("div");
    tile.className = [f.level, f.stale ? "stale" : "", f.value === null ? "unknown" : ""].join(" ");
    tile.append(element("dt", "", f.name), element("dd", "value", f.value === null ? "unknown" : f.value));
    tile.append(element("dd", "note", f.note));
    return tile;
  });
  $("figures").replaceChildren(...tiles);
}

// Findings that are not fine, the worst first.
const LEVELS = ["broken", "warning"];
function alarmsOf(findings) {
  const sentence = (f) => `${f.topic}: ${f.found}${f.remedy ? `. ${f.remedy}` : ""}`;
  return LEVELS.flatMap((level) =>
    findings.filter((f) => f.level === level).map((f) => ({ level, text: sentence(f) }))
  );
}

function showAlarms(alarms) {
  const texts = alarms.map((a) => a.text).join("\n");
  if ($("alarms").dataset.texts !== texts) {
    $("alarms").dataset.texts = texts;
    $("alarms").replaceChildren(...alarms.map((a) => element("p", a.level, a.text)));
  }
  const worst = alarms.filter((a) => a.level === "broken").map((a) => a.text);
  sound(worst);
  speak("alert", worst.join(". "));
  document.title = worst.length ? `! ${worst[0]}` : `Alight: ${picture.state ? picture.state.name : "unknown"}`;
}

function line(when, content) {
  const item = document.createElement("li");
  item.append(element("span", "", when), element("div", "", content));
  return item;
}

function showLists() {
  const log = picture.log.map((l) => line(`${ago(l.ago_s)} ago`, l.text));
  $("log").replaceChildren(...(log.length ? log : [line("", "nothing yet")]));
  const flights = picture.flights.map((f) => line(f.when, `${f.outcome}: ${f.text}`));
  $("flights").replaceChildren(...(flights.length ? flights : [line("", "none in this run")]));
}

// ---- alarms that are heard ----

let audio = null;
let heard = "";
let heardAt = 0;

function beep(at, hertz) {
  const tone = audio.createOscillator();
  const volume = audio.createGain();
  tone.frequency.value = hertz;
  tone.type = "square";
  volume.gain.setValueAtTime(0.25, at);
  volume.gain.exponentialRampToValueAtTime(0.001, at + 0.22);
  tone.connect(volume).connect(audio.destination);
  tone.start(at);
  tone.stop(at + 0.25);
}

// A new alarm sounds at once, one that stays every ten seconds. Figures in its text change all the time.
function sound(alarms) {
  const kinds = kind(alarms.join("\n"));
  if (!audio || !alarms.length) {
    heard = kinds;
    return;
  }
  if (kinds === heard && seconds() - heardAt < 10) return;
  heard = kinds;
  heardAt = seconds();
  for (let k = 0; k < 3; k += 1) beep(audio.currentTime + 0.3 * k, k % 2 ? 660 : 990);
}

// A browser lets a page sound only after a touch.
$("sound").addEventListener("click", () => {
  if (audio) {
    audio.close();
    audio = null;
  } else {
    audio = new AudioContext();
    heardAt = 0;
    beep(audio.currentTime, 880);
  }
  text("sound", audio ? "turn the sound off" : "turn the sound on");
});

// ---- day and night ----

const dark = matchMedia("(prefers-color-scheme: dark)");
const choices = ["auto", "day", "night"];
const next = () => choices[(choices.indexOf(chosen) + 1) % choices.length];
let chosen = new URLSearchParams(location.search).get("colours") || stored() || "auto";

function stored() {
  try {
    return localStorage.getItem("colours");
  } catch {
    return null; // storage may be forbidden
  }
}

function paint() {
  document.documentElement.classList.toggle("night", chosen === "night" || (chosen === "auto" && dark.matches));
  text("colours", next() === "auto" ? "use device colours" : `use ${next()} colours`);
  draw();
}

$("colours").addEventListener("click", () => {
  chosen = next();
  try {
    localStorage.setItem("colours", chosen);
  } catch {
    // it is chosen for this visit
  }
  paint();
});
dark.addEventListener("change", paint);

// ---- what is drawn ----

function canvas(id) {
  const at = $(id);
  const ratio = devicePixelRatio || 1;
  const [width, height] = [at.clientWidth, at.clientHeight];
  if (at.width !== Math.round(width * ratio) || at.height !== Math.round(height * ratio)) {
    at.width = Math.round(width * ratio);
    at.height = Math.round(height * ratio);
  }
  const pen = at.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "15px system-ui, sans-serif";
  pen.lineJoin = "round";
  return { pen, width, height };
}

function say(pen, content, x, y, name, align) {
  pen.fillStyle = colour(name || "soft");
  pen.textAlign = align || "left";
  pen.fillText(content, x, y);
}

const STEPS = [3, 5, 8, 12, 20, 30, 50, 80, 120, 200, 300, 500, 800, 1200, 2000];
const nice = (x) => STEPS.find((s) => s >= x) || 10 ** Math.ceil(Math.log10(x));

function path(pen, points, name, old, width) {
  if (points.length < 2) return;
  pen.beginPath();
  points.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.strokeStyle = colour(name);
  pen.lineWidth = width;
  pen.setLineDash(old ? [4, 6] : []);
  pen.stroke();
  pen.setLineDash([]);
}

// Rings or lines of equal distance, so that a place can be read without a ruler.
function grid(pen, centre, scale, reach, flat) {
  pen.strokeStyle = colour("line");
  pen.lineWidth = 1;
  [0.5, 1].forEach((part) => {
    pen.beginPath();
    if (flat) {
      pen.moveTo(0, centre[1] - part * reach * scale);
      pen.lineTo(4000, centre[1] - part * reach * scale);
    } else {
      pen.arc(centre[0], centre[1], part * reach * scale, 0, 7);
    }
    pen.stroke();
  });
}

function drawAbove(scene) {
  const { pen, width, height } = canvas("above");
  if (!scene) return say(pen, "deck and drone are not known", width / 2, height / 2, "soft", "center");
  const at = scene.drone ? scene.drone.at : [0, 0, 0];
  const size = scene.size_m || [2, 2];
  const reach = nice(Math.max(1.1 * Math.hypot(at[0], at[1]), 1.2 * size[0]));
  const scale = (0.46 * Math.min(width, height)) / reach;
  const centre = [width / 2, height / 2];
  const to = ([forward, right]) => [centre[0] + scale * right, centre[1] - scale * forward];
  text("above-scale", `rings ${reach / 2} and ${reach} m, bow up at ${Math.round(scene.heading_deg)}°`);
  grid(pen, centre, scale, reach, false);
  pen.save();
  pen.translate(...centre);
  pen.rotate((scene.euler_deg[2] * Math.PI) / 180);
  const [w, l] = [Math.max(scale * size[1], 8), Math.max(scale * size[0], 12)];
  pen.strokeStyle = pen.fillStyle = colour("deck");
  pen.globalAlpha = 0.18;
  pen.fillRect(-w / 2, -l / 2, w, l);
  pen.globalAlpha = 1;
  pen.lineWidth = 2;
  pen.setLineDash(scene.size_m && !scene.forecast_stale ? [] : [4, 4]);
  pen.strokeRect(-w / 2, -l / 2, w, l);
  pen.setLineDash([]);
  pen.beginPath();
  pen.moveTo(-w / 2, -l / 2);
  pen.lineTo(0, -l / 2 - Math.max(10, 0.25 * w));
  pen.lineTo(w / 2, -l / 2);
  pen.stroke();
  pen.restore();
  path(pen, scene.forecast.map(to), "forecast", scene.forecast_stale, 3);
  path(pen, scene.plan.map(to), "plan", scene.plan_stale, 3);
  if (scene.drone) drawDrone(pen, to(at), scene.drone, scale, scene.drone.euler_deg[2]);
}

function drawDrone(pen, [x, y], drone, scale, turn) {
  const arm = Math.max(0.35 * scale, 10);
  pen.save();
  pen.translate(x, y);
  pen.rotate((turn * Math.PI) / 180);
  pen.globalAlpha = drone.stale ? 0.4 : 1;
  pen.strokeStyle = pen.fillStyle = colour("drone");
  pen.lineWidth = 3;
  pen.setLineDash(drone.stale ? [3, 4] : []);
  [[1, 1], [1, -1], [-1, 1], [-1, -1]].forEach(([i, j]) => {
    pen.beginPath();
    pen.moveTo(0, 0);
    pen.lineTo(0.7 * i * arm, 0.7 * j * arm);
    pen.arc(0.7 * i * arm, 0.7 * j * arm, 0.3 * arm, 0, 7);
    pen.stroke();
  });
  pen.beginPath();
  pen.moveTo(0, -1.3 * arm);
  pen.lineTo(0.3 * arm, -0.7 * arm);
  pen.lineTo(-0.3 * arm, -0.7 * arm);
  pen.fill();
  pen.restore();
}

function drawSide(scene) {
  const { pen, width, height } = canvas("side");
  if (!scene) return say(pen, "deck and drone are not known", width / 2, height / 2, "soft", "center");
  const at = scene.drone ? scene.drone.at : [0, 0, 0];
  const size = scene.size_m || [2, 2];
  const floor = height - 46;
  const wide = nice(Math.max(2.3 * Math.abs(at[0]), 2 * size[0]));
  const high = nice(Math.max(1.1 * at[2], size[0]));
  const scale = Math.min((0.96 * width) / wide, (floor - 24) / high);
  const centre = [width / 2, floor];
  const to = ([forward, , up]) => [centre[0] + scale * forward, centre[1] - scale * up];
  text("side-scale", `lines at ${high / 2} and ${high} m, bow to the right`);
  grid(pen, centre, scale, high, true);
  const pitch = (scene.euler_deg[1] * Math.PI) / 180;
  const half = Math.max((scale * size[0]) / 2, 10);
  const ends = [-1, 1].map((s) => [centre[0] + s * half * Math.cos(pitch), centre[1] - s * half * Math.sin(pitch)]);
  path(pen, ends, "deck", scene.forecast_stale, 7);
  path(pen, scene.forecast.map(to), "forecast", scene.forecast_stale, 3);
  path(pen, scene.plan.map(to), "plan", scene.plan_stale, 3);
  if (!scene.drone) return;
  const [x, y] = to(at);
  const arm = Math.max(0.4 * scale, 11);
  pen.save();
  pen.translate(x, y);
  pen.rotate((-scene.drone.euler_deg[1] * Math.PI) / 180);
  pen.globalAlpha = scene.drone.stale ? 0.4 : 1;
  path(pen, [[-arm, -3], [arm, -3]], "drone", scene.drone.stale, 4);
  path(pen, [[-arm, -8], [-0.35 * arm, -8]], "drone", false, 3);
  path(pen, [[0.35 * arm, -8], [arm, -8]], "drone", false, 3);
  path(pen, [[-0.4 * arm, 0.7 * arm], [-0.25 * arm, 0], [0.25 * arm, 0], [0.4 * arm, 0.7 * arm]], "drone", false, 3);
  pen.restore();
  say(pen, `${at[2].toFixed(1)} m above the deck`, width - 4, 16, "drone", "right");
}

function drawMotion(motion) {
  const { pen, width, height } = canvas("motion");
  const rows = [
    ["roll", motion.roll_deg, "°", 5, 1],
    ["pitch", motion.pitch_deg, "°", 5, 1],
    ["heave", motion.heave_m, " m", 0.5, 2],
  ];
  const most = 60 / (motion.step_s || 0.25);
  rows.forEach(([name, values, unit, least, digits], row) => {
    const [top, tall] = [(row * height) / 3 + 2, height / 3 - 8];
    const known = values.filter((v) => v !== null);
    const span = Math.max(least, ...known.map((v) => 1.1 * Math.abs(v)));
    const y = (v) => top + tall / 2 - (v / span) * (tall / 2);
    const left = 132;
    const x = (k) => left + ((width - left - 4) * (most - values.length + k)) / most;
    path(pen, [[left, y(0)], [width, y(0)]], "line", false, 1);
    pen.strokeStyle = colour("line");
    pen.strokeRect(left, top, width - left - 1, tall);
    let stroke = [];
    values.forEach((v, k) => {
      if (v === null) {
        path(pen, stroke, "drone", false, 2);
        stroke = [];
      } else {
        stroke.push([x(k), y(v)]);
      }
    });
    path(pen, stroke, "drone", false, 2);
    const last = values.length ? values[values.length - 1] : null;
    say(pen, `${name}, ±${span.toFixed(digits)}${unit}`, 0, top + 15);
    pen.font = "bold 24px system-ui, sans-serif";
    say(pen, last === null ? "unknown" : `${last.toFixed(digits)}${unit}`, 0, top + 44, last === null ? "soft" : "ink");
    pen.font = "15px system-ui, sans-serif";
  });
}

// A direction from the bow as a point of the circle, bow up.
const round = (centre, radius, degrees) => {
  const angle = (degrees * Math.PI) / 180;
  return [centre[0] + radius * Math.sin(angle), centre[1] - radius * Math.cos(angle)];
};

function arrow(pen, from, to, name, dashed) {
  path(pen, [from, to], name, dashed, 4);
  const angle = Math.atan2(to[1] - from[1], to[0] - from[0]);
  const barb = (turn) => [to[0] - 14 * Math.cos(angle + turn), to[1] - 14 * Math.sin(angle + turn)];
  path(pen, [barb(0.5), to, barb(-0.5)], name, false, 4);
}

function drawCompass(compass) {
  $("bow").hidden = !compass;
  if (!compass) return;
  text("heading", `bow up at ${Math.round(compass.heading_deg)}°`);
  text("directions", compass.text);
  const { pen, width, height } = canvas("compass");
  const [centre, radius] = [[width / 2, height / 2], 0.36 * height];
  grid(pen, centre, 1, radius, false);
  const hull = [[0, -0.4], [0.14, -0.12], [0.14, 0.34], [-0.14, 0.34], [-0.14, -0.12], [0, -0.4]];
  path(pen, hull.map(([x, y]) => [centre[0] + x * radius, centre[1] + y * radius]), "deck", false, 3);
  [
    ["wind", compass.wind_from_deg, "drone", false],
    ["waves", compass.waves_from_deg, "forecast", true],
  ].forEach(([name, from, ink, dashed]) => {
    if (from === null) return;
    arrow(pen, round(centre, radius, from), round(centre, 0.5 * radius, from), ink, dashed);
    say(pen, name, ...round(centre, radius + 16, from), ink, "center");
  });
  if (compass.advised_deg === null) return;
  const turn = compass.advised_deg;
  arrow(pen, round(centre, 0.55 * radius, turn), round(centre, radius, turn), "plan", false);
  say(pen, "turn here", ...round(centre, radius + 16, turn), "plan", "center");
}

function drawTrack(track) {
  const known = [...track.drone, ...track.deck].filter(Boolean);
  $("ground").hidden = known.length < 2;
  if (known.length < 2) return;
  const { pen, width, height } = canvas("track");
  const reach = nice(Math.max(5, ...known.map(([n, e]) => 1.05 * Math.max(Math.abs(n), Math.abs(e)))));
  const scale = (0.47 * height) / reach;
  const centre = [width / 2, height / 2];
  text("track-scale", `rings ${reach / 2} and ${reach} m, north up`);
  grid(pen, centre, scale, reach, false);
  [["deck", track.deck], ["drone", track.drone]].forEach(([name, places]) => {
    let stroke = [];
    places.forEach((p) => {
      if (!p) path(pen, stroke, name, false, 3);
      stroke = p ? [...stroke, [centre[0] + scale * p[1], centre[1] - scale * p[0]]] : [];
    });
    path(pen, stroke, name, false, 3);
    if (!stroke.length) return;
    pen.fillStyle = colour(name);
    pen.beginPath();
    pen.arc(...stroke[stroke.length - 1], 6, 0, 7);
    pen.fill();
  });
}

const CAMERA_OLD_S = 2; // of two images a second four are missing
const CAMERA_WAIT_MS = 3000; // a request without an answer is given up
const CAMERA_PAUSE_MS = 1000; // after one that failed
let seen = null; // the image that is visible: its number, text and time on the server's clock
let loading = false;

// What is said is of the image that is visible, which may be an older one than the newest.
function tellCamera() {
  const age = seen && picture ? picture.clock_s - seen.at_s : 0;
  const old = age > CAMERA_OLD_S || age < 0;
  $("camera").classList.toggle("stale", old);
  text("camera-age", old ? `OLD: ${age < 0 ? "from before the server's start" : `${ago(age)} ago`}` : "");
  text("camera-text", seen ? seen.text : "no image yet");
}

// An image takes the place of the visible one when it is there.
function loadImage(camera) {
  const its = { number: camera.number, text: camera.text, at_s: picture.clock_s - camera.age_s };
  const image = new Image();
  const givenUp = setTimeout(() => {
    image.onload = image.onerror = null;
    image.removeAttribute("src"); // which ends the request
    loading = false;
  }, CAMERA_WAIT_MS);
  image.onload = () => {
    clearTimeout(givenUp);
    loading = false;
    seen = its;
    image.id = "camera-image";
    image.alt = `Down from the drone: ${its.text}`;
    $("camera-image").replaceWith(image);
    tellCamera();
  };
  image.onerror = () => {
    clearTimeout(givenUp);
    setTimeout(() => { loading = false; }, CAMERA_PAUSE_MS);
  };
  loading = true;
  image.src = `/camera.jpg?${camera.number}`;
}

// Its image comes by itself, one at a time, and only to a tab that is looked at.
function showCamera(camera) {
  $("camera").hidden = !camera;
  if (!camera) return;
  tellCamera();
  if (document.hidden || loading || (seen && seen.number === camera.number)) return;
  loadImage(camera);
}

// Of three beside each other by two the last has a row of its own.
function fillRows() {
  const shown = ["camera", "bow", "ground"].filter((id) => !$(id).hidden);
  shown.forEach((id, k) => $(id).classList.toggle("lonely", k % 2 === 0 && k === shown.length - 1));
}

function draw() {
  if (!picture) return;
  // The vessel's computer knows no deck and drone beside each other.
  document.querySelectorAll(".scene").forEach((s) => {
    s.hidden = !picture.scene && "vessel" in picture;
    s.classList.toggle("none", !picture.scene);
  });
  drawAbove(picture.scene);
  drawSide(picture.scene);
  drawCompass(picture.compass);
  drawTrack(picture.track);
  showCamera(picture.camera);
  fillRows();
  drawMotion(picture.motion);
}
addEventListener("resize", draw);

// ---- the one order ----

// What the server shows of the last order: empty again once the next flight begins.
let answered = "";
function showOrder(order) {
  $("order").hidden = order.label === null;
  if (order.label !== null) {
    text("ask", order.label);
    text("yes", `yes: ${order.label}`);
    text("no", `go back without ${order.label}`);
    text("question", `Really ${order.label.toLowerCase()}?`);
  }
  if (order.answer !== answered && !$("answer").dataset.own) {
    answered = order.answer;
    text("answer", answered);
  }
}

$("ask").addEventListener("click", () => $("confirm").showModal());
$("no").addEventListener("click", () => $("confirm").close());
$("yes").addEventListener("click", async () => {
  $("confirm").close();
  $("answer").dataset.own = "yes";
  text("answer", "sent, waiting for the answer ...");
  try {
    const answer = await fetch("/order", { method: "POST" });
    text("answer", await answer.text());
  } catch {
    text("answer", "NO ANSWER: whether it was taken is not known; give it by another way");
  }
  delete $("answer").dataset.own;
});

// ---- pictures ----

function connection() {
  showResult();
  const silence = seconds() - receivedAt;
  const dead = silence > DEAD_S;
  document.body.classList.toggle("dead", dead);
  document.body.classList.toggle("late", !dead && late > LATE_S);
  if (!Number.isFinite(silence)) {
    text("connection", "no connection yet");
  } else if (dead) {
    text("connection", `NO DATA for ${ago(silence)}: what is below is old`);
    sound(["NO DATA"]);
    speak("alert", "NO DATA: what the page shows is old");
  } else {
    text("connection", late > LATE_S ? `${ago(late)} LATE: the connection is slow` : "live");
  }
}

function show(data) {
  picture = JSON.parse(data);
  receivedAt = seconds();
  const difference = receivedAt - picture.clock_s;
  fastest = Math.min(fastest, difference);
  // A server that was started anew, on a computer that was, has another clock.
  if (difference - fastest > 3600) fastest = difference;
  late = difference - fastest;
  text("title", picture.title);
  showGo(picture.go, picture.state);
  if (picture.result) result = { ...picture.result, receivedAt };
  showResult();
  showState(picture.state);
  showAlarms(alarmsOf(picture.findings));
  showFigures(picture.figures);
  showLists();
  showOrder(picture.order);
  draw();
  connection();
}

// ---- one connection for all tabs: a browser opens six to a computer, and an order needs one, too ----

const SILENT_S = 1.2; // a tab that has the connection posts five times a second
const tabs = "BroadcastChannel" in window ? new BroadcastChannel("alight") : null;
const me = Math.random();
let source = null;
let newest = null;
let otherTabAt = seconds() - SILENT_S + 0.3; // whoever opens the page first listens for others for so long

function post(message) {
  if (tabs) tabs.postMessage({ from: me, ...message });
}

function connect() {
  source = new EventSource("/events");
  source.addEventListener("message", (event) => {
    newest = event.data;
    post({ data: newest });
    show(newest);
  });
  // A browser tries again by itself, but not where the answer was no stream of events: another tab may.
  source.addEventListener("error", () => {
    if (!source || source.readyState !== EventSource.CLOSED) return;
    disconnect();
    otherTabAt = seconds();
  });
}

function disconnect() {
  if (source) source.close();
  source = null;
}

function takeTurns() {
  if (source) post({});
  else if (seconds() - otherTabAt > SILENT_S + 0.4 * me) connect();
}

if (tabs) {
  tabs.addEventListener("message", ({ data: message }) => {
    if (message.asks) {
      // An old picture is none: whoever asks would take it for what is now.
      if (source) post(seconds() - receivedAt < DEAD_S ? { data: newest } : {});
      return;
    }
    if (message.leaves) {
      otherTabAt = seconds() - SILENT_S; // the others take turns in their order
      return;
    }
    otherTabAt = seconds();
    // Two have the connection: the one with the larger number gives it up.
    if (source && message.from < me) disconnect();
    if (!source && message.data) show(message.data);
  });
  addEventListener("pagehide", () => {
    if (source) post({ leaves: true });
    disconnect();
  });
  post({ asks: true });
}
const turns = setInterval(takeTurns, 250);
setInterval(connection, 500);
paint();

// Browsers keep it only for a page of this computer or by https.
if ("serviceWorker" in navigator) navigator.serviceWorker.register("/worker.js").catch(() => {});
