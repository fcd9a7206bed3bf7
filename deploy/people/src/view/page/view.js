"use strict";
// Shows the newest picture of the server: the object of `alight status --json`, drawing and history. Every picture is
// complete, so a missed one needs no repetition.

const $ = (id) => document.getElementById(id);
const DEAD_S = 1.5; // pictures come five times a second
const LATE_S = 2;
let picture = null;
let receivedAt = -Infinity;
let fastest = Infinity; // smallest difference between this clock and the server's, of a picture without delay
let late = 0;

const seconds = () => performance.now() / 1000;
const ago = (s) => (s < 90 ? `${Math.round(s)} s` : s < 5400 ? `${Math.round(s / 60)} min` : `${Math.round(s / 3600)} h`);
let colours = null; // of the chosen palette
const colour = (name) => colours.getPropertyValue(`--${name}`);

// ---- texts ----

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

// A list is rebuilt only when its content has changed.
function rebuild(id, content, build) {
  if ($(id).dataset.content === content) return;
  $(id).dataset.content = content;
  $(id).replaceChildren(...build());
}

// A screen reader reads out changes in kind only, because figures in a text change all the time.
const kind = (content) => content.replace(/[0-9.,]+/g, "#");
function speak(id, content) {
  if ($(id).dataset.kind === kind(content)) return;
  $(id).dataset.kind = kind(content);
  $(id).textContent = content;
}

const CLASSES = { GO: "yes", LANDS: "yes", WAITS: "wait", Landed: "yes", Matched: "yes", "NO-GO": "no", ACT: "no" };
// A landing whose probability is too low is not green.
const colourOf = (go) => (go.verdict === "LANDS" && !go.go ? "wait" : CLASSES[go.verdict] || "unknown");
function showGo(go, state) {
  $("go").className = colourOf(go);
  text("verdict", go.verdict);
  text("why", go.why);
  const stages = state ? state.stages : [];
  rebuild("stages", stages.map((s) => `${s.is} ${s.name}`).join(), () => stages.map((s) => {
    const item = element("li", s.is, s.name);
    if (s.is === "now") item.setAttribute("aria-current", "step");
    return item;
  }));
  const refused = state && state.rejected ? `order rejected: ${state.rejected}` : "";
  text("rejected", refused);
  speak("spoken", [go.verdict, state ? `${state.name}: ${state.sentence}` : "", refused].filter(Boolean).join(". "));
}

// The result stays until the next landing begins, even without data, and always on the second screen.
let result = null;
const ends = (state) => !!result && !!state && state.name.endsWith(result.outcome);
function showResult() {
  const state = picture && picture.state;
  const flies = !!state && state.stages.slice(0, -1).some((s) => s.is === "now");
  document.body.classList.toggle("ended", ends(state));
  $("result").hidden = !result || flies || ends(state);
  if ($("result").hidden) return;
  text("outcome", result.outcome);
  text("how", result.text);
  text("when", `${ago(result.ago_s + seconds() - result.receivedAt)} ago`);
}

// The words of the large sentence change at most once a second, unless the state changes; its figures change at once.
const CALM_S = 1;
let worded = { sentence: "", name: "", at: -Infinity };
function calm(sentence, name) {
  const same = kind(sentence) === kind(worded.sentence) && name === worded.name;
  const early = name === worded.name && seconds() - worded.at < CALM_S;
  if (same) worded.sentence = sentence;
  else if (!early) worded = { sentence, name, at: seconds() };
  return worded.sentence;
}

// The most important sentence is large; the drone's activity and the awaited condition stand below it unless the
// sentence contains them.
function showState(state) {
  $("state").className = !state ? "unknown" : state.stale ? "stale" : "";
  text("name", state ? state.name : "unknown");
  const sentence = calm(ends(state) ? result.text : state ? state.sentence : "", state ? state.name : "");
  text("sentence", sentence);
  $("sentence").className = sentence.length > 60 ? "long" : "";
  const begins = picture.begins_in_s === null ? "" : `the simulated landing is ordered in ${Math.ceil(picture.begins_in_s)} s`;
  const more = !state ? [begins] : [
    begins,
    state.sentence === state.does ? "" : state.does,
    state.name.endsWith("Hold") && !sentence.endsWith(state.entered) ? `because: ${state.entered}` : "",
    state.since_s > 0 ? `for ${ago(state.since_s)}` : "",
  ];
  text("aside", more.filter(Boolean).join("; "));
}

// ---- figures ----

const unknown = (name) => ({ name, value: null, note: "", level: "fine", stale: false });
const figure = (name) => picture.figures.find((f) => f.name === name) || unknown(name);
const short = (f, parts) => ({ ...f, note: f.note.split(", ").slice(0, parts).join(", ").replace(/ \(.*\)$/, "") });

function droneTiles() {
  const battery = figure("battery");
  const notes = battery.note.split(", ");
  const distance = short(figure("distance"), 1); // with the bearing unless it is near
  const lasts = notes.find((n) => n.startsWith("turns back")) || notes.find((n) => n.endsWith("reserve")) || notes[0];
  return [
    { ...distance, note: /bow|ahead|astern/.test(distance.note) ? distance.note.replace(" of the bow", "") : "", is: "keep" },
    { ...battery, note: lasts, is: "keep" },
    short(figure("link"), 1),
    figure("probability"),
    figure("autopilot"),
    figure("deck"),
    { ...figure("wind"), note: "", is: "more" },
  ];
}

// The drones' request to the helm, and the course that the helm states.
function helmTiles(vessel) {
  const course = figure("course");
  const wish = vessel.deck.wants_steady ? "KEEP COURSE AND SPEED" : "nothing";
  return [
    { ...course, name: "asked of the helm", value: wish, note: vessel.deck_owner ? `by drone ${vessel.deck_owner}` : "", is: "keep" },
    { ...course, is: "more" },
  ];
}

const MOST_DRONES = 2; // the second screen shows all
function vesselTiles(vessel) {
  const drones = picture.figures.filter((f) => f.name === "drones");
  const none = [{ ...unknown("drones"), note: "none received" }];
  const advice = picture.compass ? picture.compass.text : "no advice yet";
  return [
    figure("deck"),
    ...helmTiles(vessel),
    ...(drones.length ? drones.slice(0, MOST_DRONES) : none).map((f, k) => ({ ...f, name: `drones: ${drones.length}`, is: k ? "more" : "" })),
    { ...figure("speed"), is: "more" },
    { ...figure("waves"), is: "more" },
    { ...figure("greatest"), name: "greatest of 20 min", is: "more" },
    { ...unknown("wind, waves, heading"), value: advice, is: "more wide" },
  ];
}

function showFigures() {
  const tile = (f) => {
    const made = document.createElement("div");
    made.className = [f.level, f.stale ? "stale" : "", f.value === null ? "unknown" : "", f.is || ""].join(" ");
    made.append(element("dt", "", f.name), element("dd", "value", f.value === null ? "unknown" : f.value));
    if (f.note) made.append(element("dd", "note", f.note));
    return made;
  };
  const tiles = picture.vessel ? vesselTiles(picture.vessel) : picture.figures.length ? droneTiles() : [];
  $("figures").className = picture.vessel ? "many" : "";
  rebuild("figures", JSON.stringify(tiles), () => tiles.map(tile));
}

// ---- warnings: one strip, the worst first, one entry per cause ----

// Within a level, what stops a landing comes first.
const LEVELS = ["broken", "warning"];
function alarmsOf(findings) {
  const of = (level, stops) => findings.filter((f) => f.level === level && f.stops === stops);
  return LEVELS.flatMap((level) => [...of(level, true), ...of(level, false)]);
}

function groups(alarms) {
  const all = new Map();
  alarms.forEach((f) => all.set(f.topic, [...(all.get(f.topic) || []), f]));
  return [...all.values()];
}

const times = (n) => (n > 1 ? ` \u00d7 ${n}` : "");
function showAlarms(alarms) {
  const causes = groups(alarms);
  $("strip").disabled = !causes.length;
  const above = [picture.go.why, picture.state ? picture.state.sentence : ""].filter(Boolean);
  rebuild("strip", JSON.stringify([alarms, above]), () => {
    $("strip").className = "";
    if (!causes.length) return [element("span", "", "no warnings")];
    const [[first, ...alike], ...others] = causes;
    $("strip").className = first.level;
    const rest = others.map((c) => c[0].topic + times(c.length)).join(", ");
    const worst = element("b", "first", first.topic + times(alike.length + 1));
    // The strip does not repeat the boxes above.
    const repeated = above.some((s) => s.includes(first.found) || first.found.endsWith(s));
    const more = repeated ? (above.includes(first.remedy) ? "" : first.remedy) : first.found;
    worst.append(element("span", "", more ? `: ${more}` : ""));
    return [
      worst,
      ...(rest ? [element("span", "", `and ${others.length} more: ${rest}`)] : []),
    ];
  });
  const sentence = (f) => `${f.topic}: ${f.found}${f.remedy ? `. ${f.remedy}` : ""}`;
  rebuild("alarms", JSON.stringify(alarms), () => alarms.map((f) => element("p", f.level, sentence(f))));
  const worst = alarms.filter((f) => f.level === "broken").map(sentence);
  sound(worst);
  speak("alert", worst.join(". "));
  document.title = worst.length ? `! ${worst[0]}` : `Alight: ${picture.state ? picture.state.name : "unknown"}`;
}
// Not modal: an order works while the warnings are shown.
$("strip").addEventListener("click", () => ($("warnings").open ? $("warnings").close() : $("warnings").show()));

function line(when, content) {
  const item = document.createElement("li");
  item.append(element("span", "", when), element("div", "", content));
  return item;
}

// The second screen is filled only while it is visible.
function showDetails() {
  const log = picture.log.map((l) => line(`${ago(l.ago_s)} ago`, l.text));
  $("log").replaceChildren(...(log.length ? log : [line("", "nothing yet")]));
  const flights = picture.flights.map((f) => line(f.when, `${f.outcome}: ${f.text}`));
  $("flights").replaceChildren(...(flights.length ? flights : [line("", "none in this run")]));
  text("directions", picture.compass ? picture.compass.text : "");
  rebuild("all", JSON.stringify(picture.figures), () => picture.figures.map((f) => {
    const row = document.createElement("div");
    const value = [f.value === null ? "unknown" : f.value, f.note, f.stale ? "(old)" : ""].filter(Boolean).join(", ");
    row.append(element("dt", "", f.name), element("dd", "", value));
    return row;
  }));
  drawTrack(picture.track);
  drawMotion(picture.motion);
}

function turn() {
  const second = location.hash === "#details";
  $("fly").hidden = second;
  $("details").hidden = !second;
  text("screen", second ? "back" : "details");
  $("screen").href = second ? "#" : "#details";
  $(second ? "details" : "fly").append($("order"));
  $(second ? "large" : "eye").prepend($("camera-image"));
  draw();
}
addEventListener("hashchange", turn);

// ---- sound ----

let audio = null;
let sounded = "";
let soundedAt = 0;

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

// A new alarm sounds at once, then every ten seconds while it stays. Figures in its text change all the time.
function sound(alarms) {
  const kinds = kind(alarms.join("\n"));
  if (!audio || !alarms.length) {
    sounded = kinds;
    return;
  }
  if (kinds === sounded && seconds() - soundedAt < 10) return;
  sounded = kinds;
  soundedAt = seconds();
  for (let k = 0; k < 3; k += 1) beep(audio.currentTime + 0.3 * k, k % 2 ? 660 : 990);
}

// Browsers allow sound only after a touch.
$("sound").addEventListener("click", () => {
  if (audio) {
    audio.close();
    audio = null;
  } else {
    audio = new AudioContext();
    soundedAt = 0;
    beep(audio.currentTime, 880);
  }
  $("sound").setAttribute("aria-pressed", String(!!audio));
});

// ---- day and night ----

const dark = matchMedia("(prefers-color-scheme: dark)");
const choices = ["auto", "day", "night"];
const next = () => choices[(choices.indexOf(chosen) + 1) % choices.length];
let chosen = new URLSearchParams(location.search).get("colours") || stored() || "auto";

function stored(value) {
  try {
    return value ? localStorage.setItem("colours", value) : localStorage.getItem("colours");
  } catch {
    return null; // storage may be forbidden: the choice lasts for this visit
  }
}

function paint() {
  document.documentElement.classList.toggle("night", chosen === "night" || (chosen === "auto" && dark.matches));
  text("colours", next());
  $("colours").setAttribute("aria-label", `use ${next()} colours`);
  colours = getComputedStyle(document.documentElement);
  draw();
}

$("colours").addEventListener("click", () => {
  chosen = next();
  stored(chosen);
  paint();
});
dark.addEventListener("change", paint);

// ---- drawing ----

function canvas(id) {
  const at = $(id);
  const ratio = devicePixelRatio || 1;
  const [width, height] = [at.clientWidth, at.clientHeight];
  if (!width || !height) return null; // on the screen that is hidden
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

const STEPS = [2, 3, 5, 8, 12, 20, 30, 50, 80, 120, 200, 300, 500, 800, 1200, 2000];
const nice = (x) => STEPS.find((s) => s >= x) || 10 ** Math.ceil(Math.log10(x));

function circle(pen, centre, radius) {
  pen.beginPath();
  pen.arc(...centre, radius, 0, 7);
}

function outline(pen, points) {
  pen.beginPath();
  points.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
}

// Draws with the origin at this point, turned clockwise.
function turned(pen, [x, y], degrees, draw) {
  pen.save();
  pen.translate(x, y);
  pen.rotate(degrees * RAD);
  draw();
  pen.restore();
}

function path(pen, points, name, old, width) {
  if (points.length < 2) return;
  outline(pen, points);
  pen.strokeStyle = colour(name);
  pen.lineWidth = width;
  pen.setLineDash(old ? [4, 6] : []);
  pen.stroke();
  pen.setLineDash([]);
}

// ---- the hero: deck, drone and plan in the deck's frame ----

const RAD = Math.PI / 180;
const drawn = {}; // positions of deck, drone and plan in each view, px, for tests

function font(pen, size, weight) {
  pen.font = `${weight || "normal"} ${size}px system-ui, "DejaVu Sans", sans-serif`;
}

// Text kept inside the canvas.
function label(pen, content, x, y, name, wide, tall) {
  const half = pen.measureText(content).width / 2 + 4;
  say(pen, content, Math.min(Math.max(x, half), wide - half), Math.min(Math.max(y, 16), tall - 6), name, "center");
}

const last = (values) => (values.length ? values[values.length - 1] : null);

// Description of a drawing for a screen reader, at most once a second.
const describedAt = {};
function describe(id, content) {
  if (seconds() - (describedAt[id] || -1) < 1) return;
  describedAt[id] = seconds();
  $(id).setAttribute("aria-label", content);
}

const signed = (x, digits) => x.toFixed(digits).replace(/^-(?=[0.]*$)/, "").replace("-", "\u2212");

function water(pen, width, height, level) {
  pen.globalAlpha = 0.75;
  pen.fillStyle = colour("water");
  pen.fillRect(0, level, width, height - level);
  pen.globalAlpha = 1;
}

// Hull under a deck of this half length, px, tilted by `angle` about the deck's centre (positive: right end up); its
// right end reaches `bow` times as far.
function hull(pen, centre, half, depth, angle, bow, old) {
  const corners = [[-half, 0], [bow * half, 0], [0.9 * half, depth], [-0.9 * half, depth], [-half, 0]];
  turned(pen, centre, -angle, () => {
    outline(pen, corners);
    pen.fillStyle = colour("card");
    pen.fill();
    path(pen, corners, "deck", false, 1.5);
    path(pen, [[-half, 0], [half, 0]], "deck", old, 6);
  });
}

// Drone with its feet at this position.
function drone(pen, at, arm, feet, angle, old) {
  turned(pen, at, -angle, () => {
    path(pen, [[-arm, -feet - 3], [arm, -feet - 3]], "drone", old, 5);
    [-1, 1].forEach((side) => {
      path(pen, [[side * arm, -feet - 3], [side * arm, -feet - 10]], "drone", false, 2);
      path(pen, [[side * arm - 0.45 * arm, -feet - 10], [side * arm + 0.45 * arm, -feet - 10]], "drone", false, 3);
      path(pen, [[side * 0.45 * arm, 0], [side * 0.25 * arm, -feet]], "drone", false, 3);
    });
  });
}

// Height of the feet above the deck, on the scale of the drawing, with the flare's height and the closing speed.
function tape(pen, left, width, y, high, scene) {
  const step = [0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200].find((s) => y(0) - y(s) >= 26) || high;
  path(pen, [[left, 0], [left, y(0)]], "line", false, 1);
  font(pen, 15);
  for (let k = 0; k * step <= high; k += 1) {
    path(pen, [[left, y(k * step)], [left + 8, y(k * step)]], "line", false, 1);
    say(pen, `${+(k * step).toFixed(1)}`, left + 12, y(k * step) + 5);
  }
  if (scene.flare_m && scene.flare_m < high) {
    path(pen, [[0, y(scene.flare_m)], [left, y(scene.flare_m)]], "forecast", true, 1.5);
    say(pen, `flare ${scene.flare_m.toFixed(1)} m`, left - 6, y(scene.flare_m) - 5, "forecast", "right");
  }
  if (!scene.drone) return;
  const up = scene.drone.at[2] - (scene.feet_m || 0);
  const at = Math.min(Math.max(y(up), 26), y(0) - 8);
  pen.fillStyle = colour(scene.drone.stale ? "soft" : "drone");
  outline(pen, [[left, y(up)], [left + 9, at - 22], [left + width, at - 22], [left + width, at + 24], [left + 9, at + 24]]);
  pen.fill();
  font(pen, width > 90 ? 26 : 21, "bold");
  say(pen, `${signed(up, up < 9.95 ? 1 : 0)} m`, left + width - 6, at + 1, "card", "right");
  font(pen, width > 90 ? 15 : 13, "bold");
  const closing = scene.drone.closing_mps;
  const sense = closing > 0.05 ? "\u25bc" : closing < -0.05 ? "\u25b2" : "";
  say(pen, `${sense} ${Math.abs(closing).toFixed(1)} m/s`, left + width - 6, at + 19, "card", "right");
}

// Deck at an angle, with the greatest angle of a landing on both sides of level.
function limits(pen, centre, half, limit) {
  if (!limit) return;
  [-1, 1].forEach((side) => [-limit, limit].forEach((angle) => turned(pen, centre, -angle, () => {
    path(pen, [[side * 1.02 * half, 0], [side * 1.3 * half, 0]], "alarm-back", false, 3);
  })));
}

// Roll as seen from astern: a roll to starboard lowers the right side.
function rollView(pen, wide, tall, roll, limit, old) {
  const centre = [wide / 2, 0.56 * tall];
  const half = 0.34 * wide;
  path(pen, [[0.1 * wide, centre[1]], [0.9 * wide, centre[1]]], "line", true, 1);
  hull(pen, centre, half, 0.5 * half, -roll, 1, old);
  limits(pen, centre, half, limit);
  font(pen, wide < 120 ? 18 : 22, "bold");
  label(pen, `${signed(roll, 1)}\u00b0`, centre[0], centre[1] - 0.62 * half - 14, limit && Math.abs(roll) > limit ? "alarm-back" : "ink", wide, tall);
  font(pen, wide < 120 ? 13 : 15);
  label(pen, wide < 120 ? "roll" : "roll, from astern", centre[0], tall - 9, "soft", wide, tall);
}

function contactTexts(contact) {
  if (!contact) return ["", ""];
  const { in_s: left, tilt_deg: tilt, rise_m: rise } = contact;
  const moved = tilt && `${Math.abs(rise).toFixed(2)} m ${rise < 0 ? "lower" : "higher"}`;
  return [`contact in ${left.toFixed(1)} s`, tilt ? `deck then: pitch ${signed(tilt[1], 1)}\u00b0, ${moved}` : "deck then: not forecast yet"];
}

function drawSide(scene) {
  const made = canvas("side");
  if (!made) return;
  const { pen, height } = made;
  if (!scene) return drawRocking(pen, made.width, height);
  const [roll, pitch] = scene.euler_deg;
  const beside = made.width < 500 ? 92 : 170;
  const width = made.width - beside;
  rollView(pen, beside, height, roll, scene.limit_deg, scene.forecast_stale);
  pen.translate(beside, 0);
  const length = scene.size_m ? scene.size_m[0] : 2;
  const feet = scene.feet_m || 0;
  const at = scene.drone ? scene.drone.at : [0, 0, feet];
  const aside = width < 500 ? 84 : 100;
  const room = width - aside;
  const bottom = height - Math.max(52, 0.2 * height);
  const high = nice(Math.max(1.1 * (at[2] - feet), 0.7 * length));
  const [low, far] = [Math.min(at[0], -0.9 * length), Math.max(at[0], length)];
  const scale = Math.min((0.86 * room) / (far - low), (bottom - 74) / high);
  const centre = [room / 2 - (scale * (low + far)) / 2, bottom];
  const to = ([forward, , up]) => [centre[0] + scale * forward, centre[1] - scale * (up - feet)];
  const y = (up) => centre[1] - scale * up;
  const heave = last(picture.motion.heave_m);
  // The hull floats in the water around it, not at the mean level, which is above the deck in a trough.
  const below = scene.freeboard_m === null ? 40 : Math.max(scale * scene.freeboard_m, 12);
  const half = Math.max((scale * length) / 2, 12);
  hull(pen, centre, half, Math.max(1.4 * below, 16), pitch, 1.25, scene.forecast_stale);
  limits(pen, centre, 1.1 * half, scene.limit_deg);
  if (scene.freeboard_m !== null) water(pen, width, height, Math.min(centre[1] + below, height - 24));
  if (scene.contact && scene.contact.tilt_deg) {
    const tilt = scene.contact.tilt_deg[1] * RAD;
    const ends = [-1.2, 1.2].map((s) => [centre[0] + s * half * Math.cos(tilt), centre[1] - s * half * Math.sin(tilt)]);
    path(pen, ends, "forecast", true, 4);
  }
  const way = scene.plan.map(to);
  path(pen, way, "plan", scene.plan_stale, 4);
  drawn.side = { deck: centre, half, plan: way, drone: to(at) };
  const arm = Math.max(0.4 * scale, 15);
  font(pen, 15);
  if (way.length && width > 400) say(pen, "\u25ac plan", room - 8, scene.contact ? 24 : 44, "plan", "right");
  const abeam = Math.abs(at[1]) > (scene.size_m ? scene.size_m[1] : 2) / 2;
  if (scene.drone) {
    pen.globalAlpha = abeam ? 0.45 : 1;
    drone(pen, to(at), arm, Math.max(scale * feet, 10), scene.drone.euler_deg[1], abeam || scene.drone.stale);
    pen.globalAlpha = 1;
    font(pen, 15, "bold");
    const where = `${Math.abs(at[1]).toFixed(Math.abs(at[1]) < 10 ? 1 : 0)} m to ${at[1] < 0 ? "port" : "starboard"}`;
    if (abeam) label(pen, where, to(at)[0], to(at)[1] + 18, "drone", room, height);
  }
  tape(pen, room, aside, y, Math.floor(centre[1] / scale * 10) / 10, scene);
  const [when, then] = contactTexts(scene.contact);
  font(pen, 19, "bold");
  say(pen, when, 10, 24, "ink");
  font(pen, width < 500 ? 14 : 15);
  if (width > 400) say(pen, then, 10, 44, "forecast");
  const moved = heave === null || width < 400 ? "" : `, heave ${signed(heave, 1)} m`;
  say(pen, `pitch ${signed(pitch, 1)}\u00b0${moved}`, 10, height - 9, "ink");
  const above = scene.drone ? `, drone ${signed(scene.drone.at[2] - feet, 1)} m up, at ${signed(scene.drone.closing_mps, 1)} m/s` : "";
  describe("side", `Deck: roll ${signed(roll, 1)} deg, pitch ${signed(pitch, 1)} deg${moved}${above}`);
}

// Without a place of the drone, and on the vessel's page: roll from astern, pitch from starboard.
function drawRocking(pen, width, height) {
  const { roll_deg: rolls, pitch_deg: pitches, heave_m: heaves } = picture.motion;
  const heave = last(heaves);
  font(pen, 15);
  if (!picture.vessel) label(pen, "the drone's place is not known yet", width / 2, 16, "soft", width, height);
  if (heave === null && !picture.vessel) return;
  // A roll to starboard lowers the right side as seen from astern.
  [["roll, from astern", rolls, -1, 1], ["pitch, bow right", pitches, 1, 1.25]].forEach(([name, values, sense, bow], k) => {
    const angle = last(values);
    const centre = [(0.25 + 0.5 * k) * width, 0.5 * height];
    if (angle !== null) hull(pen, centre, 0.17 * width, 0.22 * height, sense * angle, bow, false);
    font(pen, 26, "bold");
    const value = angle === null ? "unknown" : `${signed(angle, 1)}\u00b0`;
    label(pen, value, centre[0], 50, angle === null ? "soft" : "ink", width, height);
    font(pen, 15);
    label(pen, name, centre[0], 70, "soft", width, height);
  });
  water(pen, width, height, 0.64 * height);
  const moved = heave === null ? "heave unknown" : `heave ${signed(heave, 2)} m`;
  const degrees = (values) => (last(values) === null ? "unknown" : `${signed(last(values), 1)} deg`);
  describe("side", `Deck: roll ${degrees(rolls)}, pitch ${degrees(pitches)}, ${moved}`);
  label(pen, moved, width / 2, height - 12, "ink", width, height);
}

// Point of the circle in a direction from the bow, bow up.
const round = (centre, radius, degrees) => {
  const angle = degrees * RAD;
  return [centre[0] + radius * Math.sin(angle), centre[1] - radius * Math.cos(angle)];
};

function arrow(pen, from, to, name, dashed) {
  path(pen, [from, to], name, dashed, 4);
  const angle = Math.atan2(to[1] - from[1], to[0] - from[0]);
  const barb = (turn) => [to[0] - 12 * Math.cos(angle + turn), to[1] - 12 * Math.sin(angle + turn)];
  path(pen, [barb(0.5), to, barb(-0.5)], name, false, 4);
}

// Wind and waves come from the rim; the advised heading points to it.
function drawDirections(pen, centre, radius, compass, width, height) {
  font(pen, 15, "bold");
  let before = [-99, -99];
  const outside = (name, from, ink) => {
    let [x, y] = round(centre, radius + 12, from);
    x += (pen.measureText(name).width / 2) * Math.sin(from * RAD);
    // Next to another name it moves to the next line.
    if (Math.abs(x - before[0]) < 55 && Math.abs(y - before[1]) < 16) y = before[1] + (y < before[1] ? -16 : 16);
    before = [x, y];
    label(pen, name, x, y + 5, ink, width, height);
  };
  [["wind", compass.wind_from_deg, "drone", false], ["waves", compass.waves_from_deg, "forecast", true]].forEach(([name, from, ink, dashed]) => {
    if (from === null) return;
    arrow(pen, round(centre, radius, from), round(centre, 0.72 * radius, from), ink, dashed);
    outside(name, from, ink);
  });
  if (compass.advised_deg === null) return;
  arrow(pen, round(centre, 0.7 * radius, compass.advised_deg), round(centre, radius, compass.advised_deg), "plan", false);
  outside("turn here", compass.advised_deg, "plan");
}

function rings(pen, centre, scale, reach) {
  pen.strokeStyle = colour("line");
  pen.lineWidth = 1;
  [0.5, 1].forEach((part) => {
    circle(pen, centre, part * reach * scale);
    pen.stroke();
  });
}

function deckAbove(pen, centre, scene, scale) {
  const size = scene.size_m || [2, 2];
  const [w, l] = [Math.max(scale * size[1], 8), Math.max(scale * size[0], 12)];
  const corners = [[-w / 2, -l / 2], [0, -l / 2 - Math.max(8, 0.25 * w)], [w / 2, -l / 2], [w / 2, l / 2], [-w / 2, l / 2], [-w / 2, -l / 2], [w / 2, -l / 2]];
  turned(pen, centre, scene.euler_deg[2], () => {
    pen.fillStyle = colour("water");
    pen.fillRect(-w / 2, -l / 2, w, l);
    path(pen, corners, "deck", !scene.size_m || scene.forecast_stale, 2.5);
  });
  return [w / 2, l / 2];
}

function drawAbove(scene, compass) {
  const made = canvas("above");
  if (!made) return;
  const { pen, width, height } = made;
  if (!scene && !compass) {
    font(pen, 15);
    return label(pen, "heading not known yet", width / 2, height / 2, "soft", width, height);
  }
  const narrow = width < 300;
  const centre = [width / 2, height / 2 - 4];
  const radius = 0.5 * Math.min(width - (narrow ? 0 : 40), height - 20) - 24;
  const others = scene ? [] : compass.drones;
  const at = scene && scene.drone ? scene.drone.at : [0, 0, 0];
  const size = (scene && scene.size_m) || [2, 2];
  const reach = nice(Math.max(1.2 * size[0], ...[at, ...others.map((d) => d.at)].map(([f, r]) => 1.1 * Math.hypot(f, r))));
  const scale = radius / reach;
  rings(pen, centre, scale, reach);
  const to = ([forward, right]) => [centre[0] + scale * right, centre[1] - scale * forward];
  if (compass) drawDirections(pen, centre, radius, compass, width, height);
  font(pen, 15, "bold");
  const heading = scene ? scene.heading_deg : compass.heading_deg;
  say(pen, `bow up, ${String(Math.round(heading) % 360).padStart(3, "0")}\u00b0`, 8, 18, "ink");
  if (!scene) {
    const long = others.length ? size[0] : 0.9 * reach;
    deckAbove(pen, centre, { size_m: [long, 0.4 * long], euler_deg: [0, 0, 0] }, scale);
    others.forEach((d) => {
      const [x, y] = to(d.at);
      path(pen, [[x - 8, y - 8], [x + 8, y + 8]], "drone", d.stale, 3);
      path(pen, [[x - 8, y + 8], [x + 8, y - 8]], "drone", d.stale, 3);
      label(pen, `drone ${d.number}`, x, y - 12, "drone", width, height);
    });
    drawn.above = { deck: centre, drones: others.map((d) => to(d.at)) };
    if (others.length) say(pen, `rings ${reach / 2}, ${reach} m`, 8, height - 9);
    return;
  }
  const halves = deckAbove(pen, centre, scene, scale);
  const speed = Math.hypot(...scene.way_mps);
  if (speed >= 0.3) {
    const course = Math.atan2(scene.way_mps[1], scene.way_mps[0]) / RAD;
    arrow(pen, round(centre, 0.5 * radius, course), round(centre, 0.5 * radius + Math.min(0.45 * radius, 12 + 8 * speed), course), "deck", false);
  }
  font(pen, 15);
  say(pen, narrow ? `ring ${reach} m` : `rings ${reach / 2}, ${reach} m`, 8, height - 9);
  if (speed >= 0.3) say(pen, `way ${speed.toFixed(1)} m/s`, width - 8, height - 9, "deck", "right");
  const way = scene.plan.map(to);
  path(pen, way, "plan", scene.plan_stale, 4);
  drawn.above = { deck: centre, halves, plan: way, drone: to(at) };
  if (scene.drone) drawDrone(pen, to(at), scene.drone, scale);
}

function drawDrone(pen, at, drone, scale) {
  const arm = Math.max(0.35 * scale, 10);
  turned(pen, at, drone.euler_deg[2], () => {
    pen.globalAlpha = drone.stale ? 0.4 : 1;
    [[1, 1], [1, -1], [-1, 1], [-1, -1]].forEach(([i, j]) => {
      path(pen, [[0, 0], [0.7 * i * arm, 0.7 * j * arm]], "drone", drone.stale, 3);
      circle(pen, [0.7 * i * arm, 0.7 * j * arm], 0.3 * arm);
      pen.stroke();
    });
    outline(pen, [[0, -1.3 * arm], [0.3 * arm, -0.7 * arm], [-0.3 * arm, -0.7 * arm]]);
    pen.fillStyle = colour("drone");
    pen.fill();
  });
}

// Unknown values interrupt the line.
function pieces(points) {
  const all = [[]];
  points.forEach((p) => (p ? last(all).push(p) : all.push([])));
  return all;
}

function drawMotion(motion) {
  const made = canvas("motion");
  if (!made) return;
  const { pen, width, height } = made;
  const rows = [
    ["roll", motion.roll_deg, "°", 5, 1],
    ["pitch", motion.pitch_deg, "°", 5, 1],
    ["heave", motion.heave_m, " m", 0.5, 2],
  ];
  const most = 60 / (motion.step_s || 0.25);
  rows.forEach(([name, values, unit, smallest, digits], row) => {
    const [top, tall] = [(row * height) / 3 + 2, height / 3 - 8];
    const known = values.filter((v) => v !== null);
    const span = Math.max(smallest, ...known.map((v) => 1.1 * Math.abs(v)));
    const y = (v) => top + tall / 2 - (v / span) * (tall / 2);
    const left = 132;
    const x = (k) => left + ((width - left - 4) * (most - values.length + k)) / most;
    path(pen, [[left, y(0)], [width, y(0)]], "line", false, 1);
    pen.strokeStyle = colour("line");
    pen.strokeRect(left, top, width - left - 1, tall);
    pieces(values.map((v, k) => v !== null && [x(k), y(v)])).forEach((piece) => path(pen, piece, "drone", false, 2));
    const now = last(values);
    font(pen, 15);
    say(pen, `${name}, ±${span.toFixed(digits)}${unit}`, 0, top + 15);
    font(pen, 24, "bold");
    say(pen, now === null ? "unknown" : `${signed(now, digits)}${unit}`, 0, top + 44, now === null ? "soft" : "ink");
  });
}

function drawTrack(track) {
  const known = [...track.drone, ...track.deck].filter(Boolean);
  $("ground").hidden = known.length < 2;
  if (known.length < 2) return;
  const made = canvas("track");
  if (!made) return;
  const { pen, width, height } = made;
  const reach = nice(Math.max(5, ...known.map(([n, e]) => 1.05 * Math.max(Math.abs(n), Math.abs(e)))));
  const scale = (0.47 * height) / reach;
  const centre = [width / 2, height / 2];
  text("track-scale", `rings ${reach / 2} and ${reach} m, north up`);
  rings(pen, centre, scale, reach);
  [["deck", track.deck], ["drone", track.drone]].forEach(([name, places]) => {
    const way = pieces(places.map((p) => p && [centre[0] + scale * p[1], centre[1] - scale * p[0]]));
    way.forEach((piece) => path(pen, piece, name, false, 3));
    const newest = last(last(way));
    if (!newest) return;
    pen.fillStyle = colour(name);
    circle(pen, newest, 6);
    pen.fill();
  });
}

const CAMERA_OLD_S = 2; // four images are missing, at two a second
const CAMERA_WAIT_MS = 3000; // timeout of a request
const CAMERA_PAUSE_MS = 1000; // pause after a failed request
let shown = null; // number, text and time on the server's clock of the visible image
let loading = false;

// The text describes the visible image, which may be older than the newest.
function showCameraAge() {
  const age = shown && picture ? picture.clock_s - shown.at_s : 0;
  const old = age > CAMERA_OLD_S || age < 0;
  $("camera").classList.toggle("stale", old);
  $("eye").classList.toggle("stale", old);
  text("eye-age", old ? "camera OLD" : "camera");
  text("camera-age", old ? `OLD: ${age < 0 ? "from before the server's start" : `${ago(age)} ago`}` : "");
  text("camera-text", shown ? shown.text : "no image yet");
}

const pause = (ms) => new Promise((over) => setTimeout(over, ms));

// A new image replaces the visible one once it is loaded.
async function loadImage(camera) {
  const its = { number: camera.number, text: camera.text, at_s: picture.clock_s - camera.age_s };
  const image = new Image();
  loading = true;
  image.src = `/camera.jpg?${camera.number}`;
  try {
    await Promise.race([image.decode(), pause(CAMERA_WAIT_MS).then(() => Promise.reject(new Error("late")))]);
    shown = its;
    image.id = "camera-image";
    image.alt = `Down from the drone: ${its.text}`;
    $("camera-image").replaceWith(image);
    showCameraAge();
  } catch {
    image.removeAttribute("src"); // ends the request
    await pause(CAMERA_PAUSE_MS);
  }
  loading = false;
}

// Images are requested one at a time, and only in a visible tab.
function showCamera(camera) {
  $("camera").hidden = !camera;
  $("eye").hidden = !camera || !shown;
  $("over").classList.toggle("both", !$("eye").hidden);
  if (!camera) return;
  showCameraAge();
  if (document.hidden || loading || (shown && shown.number === camera.number)) return;
  loadImage(camera);
}

function draw() {
  if (!picture) return;
  drawSide(picture.scene);
  drawAbove(picture.scene, picture.compass);
  showCamera(picture.camera);
  if (!$("details").hidden) showDetails();
}
new ResizeObserver(draw).observe($("hero"));

// ---- the order: given without confirmation, which would take decisive seconds ----

// The server's answer to the last order; empty once the next flight begins.
let answered = "";
// On the ground, disarmed and without an order there is nothing to abort.
function rests() {
  const [state, autopilot] = [picture.state, picture.autopilot];
  const parked = !!autopilot && !autopilot.armed && autopilot.landed === "OnGround";
  return parked && !!state && ["Idle", "Landed"].includes(state.name) && picture.go.verdict !== "WAITS";
}
function showOrder(order) {
  $("order").hidden = order.label === null || rests();
  if (order.label !== null) text("ask", order.label);
  rebuild("others", order.others.join(), () => order.others.map((name) => {
    const made = element("button", "", name);
    made.type = "button";
    made.addEventListener("click", () => give(name));
    return made;
  }));
  if (order.answer !== answered && !$("answer").dataset.own) {
    answered = order.answer;
    text("answer", answered);
  }
}

$("ask").addEventListener("click", () => give(""));
addEventListener("keydown", (event) => {
  if (event.key !== "F9" || event.repeat || $("order").hidden) return;
  event.preventDefault();
  give("");
});

async function give(name) {
  if ($("answer").dataset.own) return; // an order is under way
  $("answer").dataset.own = "yes";
  text("answer", "sent, waiting for the answer ...");
  try {
    const answer = await fetch("/order", { method: "POST", body: name });
    text("answer", await answer.text());
  } catch {
    text("answer", "NO ANSWER: it is not known whether the order was taken; give it another way");
  }
  delete $("answer").dataset.own;
}

// ---- pictures ----

function connection() {
  showResult();
  const silence = seconds() - receivedAt;
  const over = picture && picture.over;
  const dead = silence > DEAD_S && !over;
  document.body.classList.toggle("dead", dead);
  document.body.classList.toggle("late", !dead && late > LATE_S);
  if (!Number.isFinite(silence)) {
    // A trial is computed before it is shown: until then its server has no picture.
    text("connection", source && source.readyState === EventSource.OPEN ? "connected, no picture yet" : "no connection yet");
  } else if (dead) {
    text("connection", `NO DATA for ${ago(silence)}: what is below is old`);
    sound(["NO DATA"]);
    speak("alert", "NO DATA: what the page shows is old");
  } else {
    text("connection", over || (late > LATE_S ? `${ago(late)} LATE: the connection is slow` : "live"));
  }
}

function show(data) {
  picture = JSON.parse(data);
  receivedAt = seconds();
  const difference = receivedAt - picture.clock_s;
  fastest = Math.min(fastest, difference);
  // A server on a restarted computer has another clock.
  if (difference - fastest > 3600) fastest = difference;
  late = difference - fastest;
  text("title", picture.title);
  connection();
  showGo(picture.go, picture.state);
  if (picture.result) result = { ...picture.result, receivedAt };
  showResult();
  showState(picture.state);
  showAlarms(alarmsOf(picture.findings));
  showFigures();
  showOrder(picture.order);
  draw();
}

// ---- one connection for all tabs: a browser opens six per computer, and an order needs one, too ----

const SILENT_S = 1.2; // the tab with the connection posts five times a second
const tabs = "BroadcastChannel" in window ? new BroadcastChannel("alight") : null;
const me = Math.random();
let source = null;
let newest = null;
let otherTabAt = seconds() - SILENT_S + 0.3; // a new tab listens for others for 0.3 s

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
  // A browser reconnects by itself, unless the answer was no stream of events: then another tab may.
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
      // An old picture counts as none: the receiver would take it for current.
      if (source) post(seconds() - receivedAt < DEAD_S ? { data: newest } : {});
      return;
    }
    if (message.leaves) {
      otherTabAt = seconds() - SILENT_S; // the other tabs take turns
      return;
    }
    otherTabAt = seconds();
    // Two tabs have the connection: the one with the larger number gives it up.
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
turn();

// Browsers register it only for a page of this computer or by https.
if ("serviceWorker" in navigator) navigator.serviceWorker.register("/worker.js").catch(() => {});
